// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/control/posture_regulator.hpp>

#include <random>
#include <stdexcept>

namespace regista::control {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double dt_s = 0.002;

Pose2d driven(const Pose2d& pose, const BodyVelocity& command, double s = dt_s) {
  const double half_turn = 0.5 * command.w * s;
  return {.x = pose.x + command.x * s * std::cos(pose.heading + half_turn),
          .y = pose.y + command.x * s * std::sin(pose.heading + half_turn),
          .heading = wrap_angle(pose.heading + 2 * half_turn)};
}

class Gains : public testing::TestWithParam<PostureRegulatorConfig> {};
INSTANTIATE_TEST_SUITE_P(, Gains, testing::Values(PostureRegulatorConfig::quick(), PostureRegulatorConfig::sharp()));

TEST_P(Gains, a_goal_ahead_is_driven_at_and_one_behind_backed_at) {
  PostureRegulator regulator{GetParam()};
  EXPECT_GT(regulator.step({}, {.x = 1}).command.x, 0);
  EXPECT_NEAR(regulator.step({}, {.x = 1}).command.w, 0, 1e-12);
  EXPECT_GT(regulator.step({}, {.x = 1, .y = 0.5, .heading = 0.5}).command.w, 0);
  EXPECT_LT(regulator.step({}, {.x = -1, .y = 0.1}).command.x, 0);
}

TEST_P(Gains, reach_the_goal_within_the_tolerance_from_anywhere) {
  std::mt19937 random{1};
  std::uniform_real_distribution<double> unit{-1, 1};
  for (int i = 0; i < 200; ++i) {
    PostureRegulator regulator{GetParam()};
    Pose2d pose{.x = 3 * unit(random), .y = 3 * unit(random), .heading = pi * unit(random)};
    const Pose2d goal{.x = unit(random), .y = unit(random), .heading = pi * unit(random)};
    bool arrived = false;
    for (double t = 0; t < 60 && !arrived; t += dt_s) {
      const auto output = regulator.step(pose, goal);
      ASSERT_LE(std::abs(output.command.x), GetParam().speed_limit_mps + 1e-12);
      ASSERT_LE(std::abs(output.command.w), GetParam().turn_rate_limit_radps + 1e-12);
      arrived = output.arrived;
      pose = driven(pose, output.command);
    }
    ASSERT_TRUE(arrived) << "run " << i;
    ASSERT_LE(distance(pose, goal), 0.05);
    ASSERT_LE(std::abs(angle_between(pose.heading, goal.heading)), 0.05);
  }
}

// V' = -k1 ρ² cos² γ - k2 γ², against the difference quotient of V along the motion of the base.
TEST_P(Gains, make_the_lyapunov_function_fall_as_derived) {
  auto config = GetParam();
  config.speed_limit_mps = config.turn_rate_limit_radps = 1e6;
  std::mt19937 random{2};
  std::uniform_real_distribution<double> unit{-1, 1};
  PostureRegulator regulator{config};
  const auto value = [&](const PostureRegulator::Output& at) {
    return 0.5 * (at.rho_m * at.rho_m + at.gamma_rad * at.gamma_rad + config.k3 * at.delta_rad * at.delta_rad);
  };
  for (int i = 0; i < 10'000; ++i) {
    const Pose2d pose{.x = 3 * unit(random), .y = 3 * unit(random), .heading = pi * unit(random)};
    const Pose2d goal{.heading = pi * unit(random)};
    const auto here = regulator.step(pose, goal);
    const bool near_a_cut = std::abs(here.gamma_rad) > 3.1 || std::abs(here.delta_rad) > 3.1;
    if (here.rho_m < 0.2 || near_a_cut) continue;
    constexpr double h = 1e-6;
    const auto next = regulator.step(driven(pose, here.command, h), goal);
    const auto last = regulator.step(driven(pose, here.command, -h), goal);
    const double derived =
        -config.k1 * std::pow(here.rho_m * std::cos(here.gamma_rad), 2) - config.k2 * here.gamma_rad * here.gamma_rad;
    ASSERT_NEAR((value(next) - value(last)) / (2 * h), derived, 1e-4 * (1 + std::abs(derived)));
  }
}

TEST(PostureRegulator, is_smooth_where_the_bearing_goes_through_zero) {
  PostureRegulator regulator{PostureRegulatorConfig::quick()};
  const double right = regulator.step({.heading = 1e-9}, {.x = 1, .heading = 0.3}).command.w;
  const double ahead = regulator.step({}, {.x = 1, .heading = 0.3}).command.w;
  const double left = regulator.step({.heading = -1e-9}, {.x = 1, .heading = 0.3}).command.w;
  EXPECT_NEAR(right, ahead, 1e-7);
  EXPECT_NEAR(left, ahead, 1e-7);
}

TEST(PostureRegulator, at_the_very_place_only_turns) {
  PostureRegulator regulator{PostureRegulatorConfig::quick()};
  const auto output = regulator.step({.x = 1, .y = 1}, {.x = 1, .y = 1, .heading = 1});
  EXPECT_EQ(output.command.x, 0);
  EXPECT_GT(output.command.w, 0);
  EXPECT_TRUE(regulator.step({.x = 1}, {.x = 1}).arrived);
  EXPECT_EQ(regulator.step({.x = 1}, {.x = 1}).command, BodyVelocity{});
}

TEST(PostureRegulator, keeps_its_path_when_it_must_be_slow) {
  auto slow = PostureRegulatorConfig::quick();
  slow.speed_limit_mps = 0.1;
  auto fast = slow;
  fast.speed_limit_mps = fast.turn_rate_limit_radps = 100;
  const Pose2d goal{.x = 2, .y = 1, .heading = 1};
  const auto a = PostureRegulator{slow}.step({}, goal).command;
  const auto b = PostureRegulator{fast}.step({}, goal).command;
  EXPECT_NEAR(a.w / a.x, b.w / b.x, 1e-12);
}

TEST(PostureRegulator, stands_when_it_is_told_no_numbers) {
  PostureRegulator regulator{PostureRegulatorConfig::quick()};
  const auto output = regulator.step({.y = std::nan("")}, {.x = 1});
  EXPECT_TRUE(output.refused);
  EXPECT_EQ(output.command, BodyVelocity{});
  EXPECT_EQ(regulator.refused(), 1U);
}

TEST(PostureRegulator, names_the_gain_that_it_refuses) {
  try {
    PostureRegulator regulator{{.k3 = -1}};
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "k3 is -1: give a finite number above 0");
  }
}

}  // namespace
}  // namespace regista::control
