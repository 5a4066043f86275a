// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/control/waypoint_law.hpp>

#include <random>
#include <stdexcept>

namespace regista::control {
namespace {

constexpr double pi = std::numbers::pi;
constexpr WaypointLawConfig config{.speed_mps = 1, .turn_rate_limit_radps = 1.5};

Pose2d driven(const Pose2d& pose, const BodyVelocity& command, double dt_s) {
  const double half_turn = 0.5 * command.w * dt_s;
  return {.x = pose.x + command.x * dt_s * std::cos(pose.heading + half_turn),
          .y = pose.y + command.x * dt_s * std::sin(pose.heading + half_turn),
          .heading = wrap_angle(pose.heading + 2 * half_turn)};
}

TEST(WaypointLaw, turns_towards_the_goal) {
  const WaypointLaw law{config};
  EXPECT_NEAR(law.step({}, {.x = 5}).command.w, 0, 1e-12);
  EXPECT_NEAR(law.step({}, {.x = 5}).command.x, 1, 1e-12);
  EXPECT_GT(law.step({}, {.x = 5, .y = 5, .heading = pi / 4}).command.w, 0);
  EXPECT_LT(law.step({}, {.x = 5, .y = -5, .heading = -pi / 4}).command.w, 0);
}

TEST(WaypointLaw, swings_out_to_the_right_to_arrive_facing_left) {
  EXPECT_LT(WaypointLaw{config}.step({}, {.x = 5, .heading = pi / 2}).command.w, 0);
}

// z' = -k2 (v / r) z, against the difference quotient along the motion of the base.
TEST(WaypointLaw, takes_the_heading_to_the_curve_as_derived) {
  const WaypointLaw law{config};
  const auto off_curve = [](const Pose2d& pose, const Pose2d& goal) {
    const double line_of_sight = std::atan2(goal.y - pose.y, goal.x - pose.x);
    const double theta = angle_between(line_of_sight, goal.heading);
    return angle_between(line_of_sight, pose.heading) + std::atan(config.k1 * theta);
  };
  std::mt19937 random{1};
  std::uniform_real_distribution<double> unit{-1, 1};
  for (int i = 0; i < 10'000; ++i) {
    const Pose2d pose{.x = 5 * unit(random), .y = 5 * unit(random), .heading = pi * unit(random)};
    const Pose2d goal{.heading = pi * unit(random)};
    const auto output = law.step(pose, goal);
    const double line_of_sight = std::atan2(-pose.y, -pose.x);
    const bool near_a_cut = std::abs(angle_between(line_of_sight, goal.heading)) > 3.1 ||
                            std::abs(angle_between(line_of_sight, pose.heading)) > 3.1 || std::abs(line_of_sight) > 3.1;
    if (output.distance_m < 0.2 || near_a_cut) continue;
    constexpr double h = 1e-6;
    const double rate =
        (off_curve(driven(pose, output.command, h), goal) - off_curve(driven(pose, output.command, -h), goal)) /
        (2 * h);
    ASSERT_NEAR(rate, -config.k2 * output.command.x / output.distance_m * off_curve(pose, goal), 1e-6);
  }
}

TEST(WaypointLaw, reaches_the_goal_in_its_direction_from_anywhere_never_backing) {
  const WaypointLaw law{config};
  std::mt19937 random{2};
  std::uniform_real_distribution<double> unit{-1, 1};
  for (int i = 0; i < 200; ++i) {
    Pose2d pose{.x = 10 * unit(random), .y = 10 * unit(random), .heading = pi * unit(random)};
    const Pose2d goal{.x = unit(random), .y = unit(random), .heading = pi * unit(random)};
    double t = 0;
    for (; t < 120 && distance(pose, goal) > 0.02; t += 0.01) {
      const auto [command, distance_m, curvature, refused] = law.step(pose, goal);
      ASSERT_GE(command.x, 0);
      ASSERT_LE(command.x, config.speed_mps / (1 + config.beta * std::pow(std::abs(curvature), config.lambda)) + 1e-12);
      ASSERT_LE(command.x, config.k3 * distance_m + 1e-12);
      ASSERT_LE(std::abs(command.w), config.turn_rate_limit_radps + 1e-9);
      pose = driven(pose, command, 0.01);
    }
    ASSERT_LT(t, 120) << "run " << i;
    ASSERT_NEAR(angle_between(pose.heading, goal.heading), 0, 0.2) << "run " << i;
  }
}

TEST(WaypointLaw, stands_at_the_goal_and_when_it_is_told_no_numbers) {
  const WaypointLaw law{config};
  EXPECT_EQ(law.step({.x = 1}, {.x = 1, .heading = 1}).command, BodyVelocity{});
  EXPECT_TRUE(law.step({.x = std::nan("")}, {}).refused);
  EXPECT_EQ(law.step({.x = std::nan("")}, {}).command, BodyVelocity{});
}

TEST(WaypointLaw, names_the_value_that_it_refuses) {
  try {
    WaypointLaw law{{.speed_mps = 1}};
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "turn_rate_limit_radps is 0: give a finite number above 0");
  }
}

}  // namespace
}  // namespace regista::control
