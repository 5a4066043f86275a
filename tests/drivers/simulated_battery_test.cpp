// SPDX-License-Identifier: Apache-2.0
#include "simulated_battery.hpp"

#include "bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;
using power::State;

// Without resistance and with one voltage, everything below is plain arithmetic: 10 V · 1 Ah = 36 kJ.
constexpr auto one_voltage = "provides [\"power:0\"] full_voltage 10 empty_voltage 10 capacity 1 ";
const std::string plain = std::string{one_voltage} + "resistance 0 ";

TEST(SimulatedBattery, drains_at_rest) {
  Bench bench = Bench::of<SimulatedBattery>(plain + "idle_power 36");
  bench.run(10s);
  const State state = bench.latest<State>();
  EXPECT_EQ(state.valid, 31U);
  EXPECT_NEAR(state.charge_percent, 99, 2e-3);
  EXPECT_NEAR(state.energy_j, 35640, 1);
  EXPECT_NEAR(state.power_w, 36, 1e-3);
  EXPECT_NEAR(state.voltage_v, 10, 1e-6);
}

TEST(SimulatedBattery, drains_faster_with_the_speed_of_its_base) {
  Bench bench = Bench::of<SimulatedBattery>(plain + "requires [\"position2d:0\"] idle_power 10 drive_power 40");
  Link base;
  bench.host().required().at(0).link = &base;
  ASSERT_TRUE(base.up.put(Mailbox<Outbound, 256>::no_lane, [](Outbound& out) {
    out = Sample{.measured = {}, .data = position2d::State{.velocity = {.x = 0.3, .y = -0.4}}};
  }));
  bench.run(100ms);
  EXPECT_NEAR(bench.latest<State>().power_w, 10 + 40 * 0.5, 1e-3);
}

TEST(SimulatedBattery, sags_under_load) {
  Bench bench = Bench::of<SimulatedBattery>(std::string{one_voltage} + "resistance 0.1 idle_power 99");
  bench.run(1s);
  // Where u = 10 V - 0.1 Ω · 99 W / u.
  EXPECT_NEAR(bench.latest<State>().voltage_v, 5 + std::sqrt(25 - 9.9), 1e-3);
}

TEST(SimulatedBattery, is_empty_at_last_and_draws_nothing_then) {
  Bench bench = Bench::of<SimulatedBattery>(plain + "charge 0.1 idle_power 36");
  bench.run(2s);
  EXPECT_EQ(bench.latest<State>().charge_percent, 0);
  EXPECT_EQ(bench.latest<State>().power_w, 0);
}

TEST(SimulatedBattery, charges_when_allowed_and_stops_when_full) {
  Bench bench = Bench::of<SimulatedBattery>(plain + "charge 99 idle_power 0 charging_power 36");
  ASSERT_TRUE(bench.ask(power::SetChargingPolicy{.enable_input = 1}));
  bench.run(5s);
  EXPECT_NEAR(bench.latest<State>().charge_percent, 99.5, 2e-2);
  EXPECT_EQ(bench.latest<State>().charging, 1);
  bench.run(10s);
  EXPECT_EQ(bench.latest<State>().charge_percent, 100);
  EXPECT_EQ(bench.latest<State>().power_w, 0);
}

TEST(SimulatedBattery, refuses_to_charge_others) {
  Bench bench = Bench::of<SimulatedBattery>(plain);
  const auto refused = bench.ask(power::SetChargingPolicy{.enable_output = 1});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "this battery cannot charge others: ask for enable_output 0");
}

}  // namespace
}  // namespace regista
