// SPDX-License-Identifier: Apache-2.0
#include "motor_board.hpp"

#include <cmath>

#include "bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;

Bench board_bench(const std::string& keys = "") {
  return Bench::of<MotorBoardDriver>("provides [\"actarray:0\" \"power:0\"] port \"simulated\" " + keys);
}

/// Repeated for its lease.
void turn(Bench& bench, const std::vector<float>& speeds, Duration duration) {
  bench.drive(actarray::MultiSpeedCommand{.speeds = speeds}, duration);
}

// Speeds that a soccer robot's four wheels can have together: 4 ahead, 2 to the left, 1 around.
TEST(MotorBoardDriver, turns_each_wheel_at_its_own_speed) {
  Bench bench = board_bench();
  const std::vector<float> speeds{-1, -5, 3, 7};
  turn(bench, speeds, 3s);
  const auto wheels = bench.latest<actarray::State>().actuators;
  ASSERT_EQ(wheels.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(wheels[i].speed, speeds[i], 1) << i;
    EXPECT_NEAR(wheels[i].position, 2.5 * speeds[i], 0.3 * std::abs(2.5 * speeds[i]) + 1) << i;
  }
  EXPECT_EQ(wheels[3].state, actarray::ActuatorState::moving);
}

TEST(MotorBoardDriver, turns_one_wheel_or_all) {
  Bench bench = board_bench();
  bench.drive(actarray::SpeedCommand{.joint = -1, .speed = 4}, 3s);
  for (const auto& wheel : bench.latest<actarray::State>().actuators) EXPECT_NEAR(wheel.speed, 4, 1);
  bench.drive(actarray::SpeedCommand{.joint = 2, .speed = 8}, 300ms);
  const auto wheels = bench.latest<actarray::State>().actuators;
  EXPECT_GT(wheels[2].speed, wheels[0].speed + 0.5);
}

TEST(MotorBoardDriver, stops_all_wheels_when_its_client_falls_silent) {
  Bench bench = board_bench();
  turn(bench, {5, 5, 5, 5}, 500ms);
  bench.run(1500ms);
  for (const auto& wheel : bench.latest<actarray::State>().actuators) EXPECT_NEAR(wheel.speed, 0, 0.01);
}

TEST(MotorBoardDriver, has_as_many_wheels_as_the_cfg_says) {
  Bench bench = board_bench("wheels 2");
  turn(bench, {5, -5}, 500ms);
  EXPECT_EQ(bench.latest<actarray::State>().actuators.size(), 2U);
  EXPECT_EQ(bench.ask(actarray::GetGeometry{})->actuators.size(), 2U);
  bench.events();
  turn(bench, {5, -5, 5}, 10ms);
  EXPECT_EQ(bench.events(), "actarray:0 refused: there are 2 wheels, and 3 speeds\n");
}

TEST(MotorBoardDriver, names_a_wheel_that_is_not_there) {
  Bench bench = board_bench();
  bench.send(actarray::SpeedCommand{.joint = 4, .speed = 1});
  EXPECT_EQ(bench.events(), "actarray:0 refused: there is no wheel 4, only 0 to 3, and -1 for all\n");
}

TEST(MotorBoardDriver, goes_no_faster_than_its_limit) {
  Bench bench = board_bench("wheel_speed 6");
  turn(bench, {50, 50, 50, 50}, 1s);
  for (const auto& wheel : bench.latest<actarray::State>().actuators) EXPECT_LT(wheel.speed, 7);
}

TEST(MotorBoardDriver, without_power_turns_nothing) {
  Bench bench = board_bench();
  ASSERT_TRUE(bench.ask(actarray::SetPower{.on = 0}));
  bench.send(actarray::SpeedCommand{.joint = -1, .speed = 1});
  EXPECT_EQ(bench.events(), "actarray:0 refused: the motors are off: ask for POWER 1\n");
  bench.run(100ms);
  EXPECT_EQ(bench.latest<actarray::State>().motors_on, 0);
}

TEST(MotorBoardDriver, tells_the_battery) {
  Bench bench = board_bench();
  bench.run(100ms);
  EXPECT_NEAR(bench.latest<power::State>().voltage_v, 12.6, 0.1);
}

}  // namespace
}  // namespace regista
