// SPDX-License-Identifier: Apache-2.0
#include "simulated_base.hpp"

#include <numbers>

#include "bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;
using position2d::State;

constexpr double pi = std::numbers::pi;

Bench base(const std::string& keys = "") { return Bench::of<SimulatedBase>("provides [\"position2d:0\"] " + keys); }

State drive(Bench& bench, const BodyVelocity& velocity, Duration duration) {
  bench.drive(position2d::VelocityCommand{.velocity = velocity}, duration);
  return bench.latest<State>();
}

TEST(SimulatedBase, drives_ahead_to_the_left_and_turns_counter_clockwise) {
  Bench ahead = base();
  EXPECT_NEAR(drive(ahead, {.x = 0.5}, 2s).pose.x, 1, 0.1);
  Bench left = base();
  EXPECT_NEAR(drive(left, {.y = 0.5}, 2s).pose.y, 1, 0.1);
  Bench turn = base();
  EXPECT_NEAR(drive(turn, {.w = 1}, 2s).pose.heading, 2, 0.2);
}

TEST(SimulatedBase, keeps_the_limits_of_its_motors) {
  Bench bench = base("motor_speed 0.5 motor_turn 90 motor_accel 1");
  State before = drive(bench, {.x = 30, .y = 40, .w = 50}, 10ms);
  for (const Sample& sample : bench.samples()) EXPECT_NE(std::get_if<State>(&sample.data), nullptr);
  for (int i = 0; i < 200; ++i) {
    const State now = drive(bench, {.x = 30, .y = 40, .w = 50}, 10ms);
    ASSERT_LE(std::hypot(now.velocity.x - before.velocity.x, now.velocity.y - before.velocity.y), 0.01 + 1e-9);
    before = now;
  }
  EXPECT_NEAR(before.velocity.x, 0.3, 1e-3);
  EXPECT_NEAR(before.velocity.y, 0.4, 1e-3);
  EXPECT_NEAR(before.velocity.w, pi / 2, 1e-3);
}

TEST(SimulatedBase, answers_with_its_time_constant) {
  Bench bench = base("time_constant 0.5 motor_accel 1000");
  drive(bench, {.x = 1}, 10ms);  // the beat that meets the command begins with it
  const double before = bench.latest<State>().velocity.x;
  EXPECT_NEAR(drive(bench, {.x = 1}, 500ms).velocity.x, 1 - (1 - before) * std::exp(-1), 1e-6);
}

TEST(SimulatedBase, stands_when_nobody_commands_it) {
  Bench bench = base();
  drive(bench, {.x = 1}, 1s);
  bench.run(2s);
  EXPECT_NEAR(bench.latest<State>().velocity.x, 0, 1e-6);
}

TEST(SimulatedBase, goes_to_a_pose_without_overshoot) {
  for (const std::string keys : {"", "holonomic no", "time_constant 0.5", "time_constant 0"}) {
    Bench bench = base(keys);
    const position2d::PositionCommand goal{.pose = {.x = 1, .y = 0.5, .heading = pi / 2}};
    bench.send(goal);
    double farthest = 0;
    for (int i = 0; i < 3000; ++i) {
      bench.run(10ms);
      farthest = std::max(farthest, bench.latest<State>().pose.x);
    }
    const State there = bench.latest<State>();
    EXPECT_NEAR(distance(there.pose, goal.pose), 0, 2e-3) << keys;
    EXPECT_NEAR(angle_between(there.pose.heading, pi / 2), 0, 2e-3) << keys;
    EXPECT_LE(farthest, 1 + 2e-3) << keys;
  }
}

TEST(SimulatedBase, goes_to_a_pose_no_faster_than_told) {
  Bench bench = base();
  bench.send(position2d::PositionCommand{.pose = {.x = 2}, .velocity = {.x = 0.3}});
  bench.run(3s);
  EXPECT_NEAR(bench.latest<State>().velocity.x, 0.3, 1e-6);
}

TEST(SimulatedBase, steers_like_a_car_to_the_left) {
  Bench bench = base("size [0.5 0.3 0.2]");
  bench.drive(position2d::CarCommand{.speed_mps = 0.5, .steering_rad = pi / 4}, 1s);
  EXPECT_NEAR(bench.latest<State>().velocity.x, 0.5, 1e-6);
  EXPECT_NEAR(bench.latest<State>().velocity.w, 1, 1e-6);  // on a circle of the base's length
}

TEST(SimulatedBase, turns_the_shorter_way_to_a_heading) {
  Bench bench = base();
  ASSERT_TRUE(bench.ask(position2d::SetOdometry{.pose = {.heading = 3}}));
  bench.drive(position2d::VelocityHeadingCommand{.speed_mps = 0, .heading_rad = -3}, 100ms);
  EXPECT_GT(bench.latest<State>().velocity.w, 0);
  bench.drive(position2d::VelocityHeadingCommand{.speed_mps = 0, .heading_rad = -3}, 5s);
  EXPECT_NEAR(bench.latest<State>().pose.heading, -3, 1e-3);
}

TEST(SimulatedBase, sets_its_odometry_while_it_drives) {
  Bench bench = base();
  drive(bench, {.x = 1}, 1s);
  ASSERT_TRUE(bench.ask(position2d::SetOdometry{.pose = {.x = 5, .y = 6, .heading = pi / 2}}));
  const State state = drive(bench, {.x = 1}, 100ms);
  EXPECT_NEAR(state.pose.x, 5, 1e-6);
  EXPECT_NEAR(state.pose.y, 6.1, 0.011);
  EXPECT_NEAR(state.velocity.x, 1, 1e-6);
  ASSERT_TRUE(bench.ask(position2d::ResetOdometry{}));
  bench.run(10ms);
  EXPECT_NEAR(distance(bench.latest<State>().pose, {}), 0, 0.011);
}

TEST(SimulatedBase, refuses_to_move_with_its_motors_off) {
  Bench bench = base();
  drive(bench, {.x = 1}, 1s);
  ASSERT_TRUE(bench.ask(position2d::SetMotorPower{.on = 0}));
  bench.events();
  EXPECT_EQ(drive(bench, {.x = 1}, 1s).velocity, BodyVelocity{});
  EXPECT_NE(bench.events().find("position2d:0 refused: the motors are off: ask for MOTOR_POWER 1"), std::string::npos);
  ASSERT_TRUE(bench.ask(position2d::SetMotorPower{.on = 1}));
  EXPECT_GT(drive(bench, {.x = 1}, 1s).velocity.x, 0.9);
}

TEST(SimulatedBase, tells_its_size) {
  Bench bench = base("size [0.5 0.3 0.2]");
  const auto geometry = bench.ask(position2d::GetGeometry{});
  ASSERT_TRUE(geometry);
  EXPECT_EQ(geometry->size, (Size3d{.width = 0.3, .length = 0.5, .height = 0.2}));
}

TEST(SimulatedBase, repeats_its_noise_with_the_seed_and_only_then) {
  const auto run = [](const std::string& seed) {
    Bench bench = base("noise 0.1 drift 0.1 turn_drift 0.1 seed " + seed);
    return drive(bench, {.x = 1}, 1s);
  };
  EXPECT_EQ(run("7"), run("7"));
  EXPECT_NE(run("7").pose, run("8").pose);
  EXPECT_NE(run("7").velocity, run("8").velocity);
}

TEST(SimulatedBase, odometry_drifts_away_from_the_truth) {
  Bench bench = base("drift 0.1 turn_drift 0.1 time_constant 0 motor_accel 1e6");
  drive(bench, {.x = 1}, 2s);
  Pose2d truth;
  Pose2d odometry;
  for (const Sample& sample : bench.samples()) {
    if (const auto* state = std::get_if<State>(&sample.data)) (sample.port == 1 ? truth : odometry) = state->pose;
  }
  EXPECT_NEAR(truth.x, 2, 0.011);
  EXPECT_EQ(truth.y, 0);
  EXPECT_GT(distance(truth, odometry), 0.02);
}

TEST(SimulatedBase, publishes_a_velocity_with_the_noise_that_is_asked_for) {
  Bench bench = base();
  ASSERT_TRUE(bench.ask(property::SetDouble{.key = Text{"noise"}, .value = 0.2}));
  bench.run(20s);
  double squares = 0;
  int count = 0;
  for (const Sample& sample : bench.samples()) {
    if (sample.port != 0) continue;  // the truth has no noise
    const auto* state = std::get_if<State>(&sample.data);
    squares += state->velocity.x * state->velocity.x;
    ++count;
  }
  EXPECT_NEAR(std::sqrt(squares / count), 0.2, 0.02);
  EXPECT_EQ(bench.latest<State>().pose, Pose2d{});

  const auto refused = bench.ask(property::SetDouble{.key = Text{"noise"}, .value = 2});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, std::errc::result_out_of_range);
}

TEST(SimulatedBase, complains_about_its_keys_in_words) {
  const auto complaint = [](const std::string& keys) -> std::string {
    try {
      (void)base(keys);
    } catch (const ConfigError& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_NE(complaint("size [1 2]").find("'size' must be three lengths"), std::string::npos);
  EXPECT_NE(complaint("motor_speed 0").find("'motor_speed' is 0, must be at least 0.001 m"), std::string::npos);
}

}  // namespace
}  // namespace regista
