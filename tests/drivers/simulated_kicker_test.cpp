// SPDX-License-Identifier: Apache-2.0
#include "simulated_kicker.hpp"

#include <numbers>

#include "bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;
using kicker::State;

constexpr auto degree = static_cast<float>(std::numbers::pi / 180);

Bench kicker_bench(const std::string& keys = "") {
  return Bench::of<SimulatedKicker>("provides [\"kicker:0\"] " + keys);
}

void charge(Bench& bench) {
  bench.send(kicker::ChargeCommand{.on = 1});
  bench.run(2050ms);
  bench.events();
}

State after(Bench& bench, Duration duration) {
  bench.run(duration);
  return bench.latest<State>();
}

TEST(SimulatedKicker, opens_empty_and_stays_so_until_it_is_told_to_charge) {
  Bench bench = kicker_bench();
  EXPECT_EQ(after(bench, 5s), State{});
}

TEST(SimulatedKicker, charges_with_constant_power_in_two_seconds) {
  Bench bench = kicker_bench();
  bench.send(kicker::ChargeCommand{.on = 1});
  EXPECT_NEAR(after(bench, 500ms).capacitor_v, 100, 2);  // a quarter of the energy, half of the voltage
  EXPECT_EQ(after(bench, 1400ms).charged, 0);
  EXPECT_EQ(after(bench, 150ms).charged, 1);
  EXPECT_NEAR(bench.latest<State>().capacitor_v, 200, 1e-3);
}

TEST(SimulatedKicker, a_hard_kick_empties_it_and_a_soft_one_does_not) {
  Bench hard = kicker_bench();
  charge(hard);
  hard.send(kicker::ChargeCommand{.on = 0});
  hard.send(kicker::KickCommand{.speed_mps = 6.5F});
  EXPECT_EQ(after(hard, 20ms), (State{.kick_count = 1}));

  Bench soft = kicker_bench();
  charge(soft);
  soft.send(kicker::ChargeCommand{.on = 0});
  soft.send(kicker::KickCommand{.speed_mps = 3.25F});
  EXPECT_NEAR(after(soft, 20ms).capacitor_v, 200 * std::sqrt(0.75), 0.1);
  EXPECT_EQ(soft.latest<State>().charged, 0);
}

TEST(SimulatedKicker, refuses_a_kick_without_charge_in_words) {
  Bench bench = kicker_bench();
  bench.send(kicker::KickCommand{.speed_mps = 2});
  EXPECT_EQ(bench.events(), "kicker:0 refused: kick: the capacitor has 0 V of 200 V: send CHARGE 1\n");
  EXPECT_EQ(after(bench, 20ms).kick_count, 0U);

  Bench twice = kicker_bench();
  charge(twice);
  twice.send(kicker::KickCommand{.speed_mps = 6.5F});
  twice.send(kicker::KickCommand{.speed_mps = 6.5F});
  EXPECT_EQ(twice.events(), "kicker:0 refused: kick: the capacitor has 0 V of 200 V: wait until it is charged\n");
  EXPECT_EQ(after(twice, 20ms).kick_count, 1U);
}

TEST(SimulatedKicker, refuses_a_kick_that_is_too_fast_in_words) {
  Bench bench = kicker_bench();
  charge(bench);
  bench.send(kicker::KickCommand{.speed_mps = 8});
  EXPECT_EQ(bench.events(), "kicker:0 refused: kick speed is 8 m/s, must be within [0, 6.5] m/s\n");
  EXPECT_EQ(after(bench, 20ms).kick_count, 0U);
  EXPECT_EQ(bench.latest<State>().charged, 1);
}

TEST(SimulatedKicker, chips_within_its_angles_only) {
  Bench bench = kicker_bench();
  charge(bench);
  bench.send(kicker::ChipCommand{.speed_mps = 3, .angle_rad = 45 * degree});
  EXPECT_EQ(bench.events(), "");
  EXPECT_EQ(after(bench, 3s).kick_count, 1U);
  bench.send(kicker::ChipCommand{.speed_mps = 3, .angle_rad = 10 * degree});
  EXPECT_EQ(bench.events(), "kicker:0 refused: chip angle is 0.1745 rad, must be within [0.5236, 1.047] rad\n");
  EXPECT_EQ(after(bench, 20ms).kick_count, 1U);
}

TEST(SimulatedKicker, a_kick_takes_the_ball_away) {
  Bench bench = kicker_bench();
  charge(bench);
  ASSERT_TRUE(bench.ask(property::SetBool{.key = Text{"ball"}, .value = 1}));
  EXPECT_EQ(after(bench, 20ms).ball_detected, 1);
  bench.send(kicker::KickCommand{.speed_mps = 2});
  EXPECT_EQ(after(bench, 20ms).ball_detected, 0);
}

TEST(SimulatedKicker, its_dribbler_answers_with_its_time_constant_and_stops_without_commands) {
  Bench bench = kicker_bench();
  bench.send(kicker::DribblerCommand{.speed_radps = 100});
  const double before = after(bench, 20ms).dribbler_radps;
  EXPECT_NEAR(after(bench, 100ms).dribbler_radps, 100 - (100 - before) * std::exp(-1), 1e-3);
  EXPECT_NEAR(after(bench, 3s).dribbler_radps, 0, 1e-3);
}

TEST(SimulatedKicker, refuses_a_dribbler_speed_beyond_its_limit) {
  Bench bench = kicker_bench();
  bench.send(kicker::DribblerCommand{.speed_radps = -400});
  EXPECT_EQ(bench.events(), "kicker:0 refused: dribbler speed is -400 rad/s, must be within [-300, 300] rad/s\n");
}

TEST(SimulatedKicker, tells_its_geometry_and_its_limits) {
  Bench bench = kicker_bench("kick_speed 5 chip_angle_min 20 offset 0.09");
  const auto limits = bench.ask(kicker::GetLimits{});
  ASSERT_TRUE(limits);
  EXPECT_EQ(limits->kick_speed_mps, 5);
  EXPECT_FLOAT_EQ(limits->chip_angle_min_rad, 20 * degree);
  EXPECT_FLOAT_EQ(limits->chip_angle_max_rad, 60 * degree);
  const auto geometry = bench.ask(kicker::GetGeometry{});
  ASSERT_TRUE(geometry);
  EXPECT_EQ(geometry->pose.x, 0.09);
}

}  // namespace
}  // namespace regista
