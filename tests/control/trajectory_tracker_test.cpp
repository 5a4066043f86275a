// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/control/trajectory_tracker.hpp>

#include <algorithm>
#include <stdexcept>

namespace regista::control {
namespace {

using namespace std::chrono_literals;

constexpr Duration dt = 10ms;

TrajectoryTrackerConfig with_feed_forward() {
  TrajectoryTrackerConfig config = TrajectoryTrackerConfig::published();
  config.feed_forward = 1;
  return config;
}

/// A base that does what it is told, at a constant part of it.
Pose2d driven(const Pose2d& pose, const BodyVelocity& command, double obeys = 1) {
  const double s = obeys * seconds(dt);
  return pose * Pose2d{.x = command.x * s, .y = command.y * s, .heading = command.w * s};
}

TEST(TrajectoryTracker, a_target_to_the_left_of_a_robot_that_faces_left_is_straight_ahead) {
  TrajectoryTracker tracker{with_feed_forward()};
  const Pose2d start{.heading = std::numbers::pi / 2};
  const Pose2d target{.y = 1, .heading = std::numbers::pi / 2};
  (void)tracker.step(start, target, dt);
  const auto output = tracker.step(start, target, dt);
  EXPECT_GT(output.command.x, 0);
  EXPECT_NEAR(output.command.y, 0, 1e-12);
  EXPECT_NEAR(output.command.w, 0, 1e-12);
}

TEST(TrajectoryTracker, brings_robots_that_obey_or_fall_short_to_the_target) {
  for (const double obeys : {1.0, 0.8, 1.2}) {
    for (const auto& config : {TrajectoryTrackerConfig::published(), with_feed_forward()}) {
      TrajectoryTracker tracker{config};
      Pose2d pose{.x = -0.4, .y = 0.3, .heading = 3};
      const Pose2d target{.x = 0.5, .y = -0.2, .heading = -2};
      bool ended = false;
      for (int i = 0; i < 1500; ++i) {
        const auto output = tracker.step(pose, target, dt);
        ASSERT_LE(std::hypot(output.command.x, output.command.y), config.speed_limit_mps + 1e-12);
        ASSERT_LE(std::abs(output.command.w), config.turn_rate_limit_radps);
        pose = driven(pose, output.command, obeys);
        ended = output.plan_ended;
      }
      EXPECT_TRUE(ended);
      EXPECT_LT(distance(pose, target), 1e-3) << obeys << " " << config.feed_forward;
      EXPECT_NEAR(angle_between(pose.heading, target.heading), 0, 1e-3);
    }
  }
}

TEST(TrajectoryTracker, fed_forward_it_stays_on_the_plan) {
  TrajectoryTracker tracker{with_feed_forward()};
  Pose2d pose;
  double worst_m = 0;
  for (int i = 0; i < 500; ++i) {
    const auto output = tracker.step(pose, {.x = 1, .y = 1}, dt);
    worst_m = std::max(worst_m, distance(pose, output.reference.pose));
    pose = driven(pose, output.command);
  }
  EXPECT_LT(worst_m, 0.01);  // a step at full speed is 6 mm
}

TEST(TrajectoryTracker, a_new_target_on_the_way_makes_no_jump_of_the_reference) {
  TrajectoryTracker tracker{with_feed_forward()};
  Pose2d pose;
  MotionState before;
  for (int i = 0; i < 600; ++i) {
    const Pose2d target = i < 80 ? Pose2d{.x = 2} : i < 200 ? Pose2d{.x = 1, .y = 1} : Pose2d{.x = 0.5, .heading = 1};
    const auto output = tracker.step(pose, target, dt);
    if (i > 0) {
      ASSERT_LE(distance(before.pose, output.reference.pose), 0.6 * seconds(dt) + 1e-9);
      ASSERT_LE(
          std::hypot(output.reference.velocity.x - before.velocity.x, output.reference.velocity.y - before.velocity.y),
          1.5 * seconds(dt) + 1e-9);
    }
    before = output.reference;
    pose = driven(pose, output.command);
  }
  EXPECT_LT(distance(pose, {.x = 0.5}), 1e-2);
}

TEST(TrajectoryTracker, a_robot_that_is_carried_off_starts_anew_from_where_it_is) {
  TrajectoryTracker tracker{with_feed_forward()};
  (void)tracker.step({}, {.x = 1}, dt);
  const Pose2d elsewhere{.x = 3, .y = 2};
  EXPECT_EQ(tracker.step(elsewhere, {.x = 1}, dt).reference.pose, elsewhere);
}

TEST(TrajectoryTracker, stands_when_it_is_told_no_numbers_and_then_goes_on) {
  TrajectoryTracker tracker{with_feed_forward()};
  (void)tracker.step({}, {.x = 1}, dt);
  for (const auto& output :
       {tracker.step({.x = std::nan("")}, {.x = 1}, dt), tracker.step({}, {.heading = INFINITY}, dt)}) {
    EXPECT_TRUE(output.refused);
    EXPECT_EQ(output.command, BodyVelocity{});
  }
  EXPECT_EQ(tracker.refused(), 2U);
  EXPECT_GT(tracker.step({}, {.x = 1}, dt).command.x, 0);
}

TEST(TrajectoryTracker, names_the_value_that_it_refuses) {
  auto config = TrajectoryTrackerConfig::published();
  config.feed_forward = 1.5;
  EXPECT_THROW(TrajectoryTracker{config}, std::invalid_argument);
  config = TrajectoryTrackerConfig::published();
  config.profile.speed_mps = 0;
  EXPECT_THROW(TrajectoryTracker{config}, std::invalid_argument);
  EXPECT_THROW(TrajectoryTracker{TrajectoryTrackerConfig{}}, std::invalid_argument);
}

TEST(TrajectoryTracker, goes_on_at_the_velocity_that_the_robot_has) {
  TrajectoryTracker tracker{TrajectoryTrackerConfig::fed_forward()};
  tracker.reset({.x = 0.5});
  const auto output = tracker.step({}, {.x = 2}, dt);
  EXPECT_NEAR(output.command.x, 0.5, 1e-9);
}

TEST(TrajectoryTracker, slows_down_to_a_new_limit_without_a_jump) {
  const auto config = TrajectoryTrackerConfig::fed_forward();
  TrajectoryTracker tracker{config};
  Pose2d pose;
  double before = 0;
  for (int i = 0; i < 400; ++i) {
    if (i == 100) tracker.limit_profile(0.2, 1);
    const double is = tracker.step(pose, {.x = 2}, dt).command.x;
    // A tenth for the feedback, which sees each step a beat late.
    EXPECT_LE(std::abs(is - before), 1.1 * config.profile.acceleration_mps2 * seconds(dt)) << i;
    EXPECT_TRUE(i <= 150 || is <= 0.2 + 1e-9) << i;
    before = is;
    pose.x += is * seconds(dt);
  }
  EXPECT_THROW(tracker.limit_profile(0, 1), std::invalid_argument);
}

}  // namespace
}  // namespace regista::control
