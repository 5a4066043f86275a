// SPDX-License-Identifier: Apache-2.0
#include "regista/control/kinematics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

namespace regista::control {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

Kinematics ssl_robot() { return Kinematics::omni({pi / 4, 3 * pi / 4, -3 * pi / 4, -pi / 4}, 0.08); }

TEST(DifferentialKinematics, forward_turns_both_wheels_forward) {
  const WheelSpeeds wheels = Kinematics::differential(0.5).wheels({.x = 1});
  EXPECT_GT(wheels[0], 0);
  EXPECT_GT(wheels[1], 0);
}

TEST(DifferentialKinematics, counter_clockwise_turns_the_left_wheel_backward) {
  const WheelSpeeds wheels = Kinematics::differential(0.5).wheels({.w = 1});
  EXPECT_DOUBLE_EQ(wheels[0], -0.25);
  EXPECT_DOUBLE_EQ(wheels[1], 0.25);
}

TEST(DifferentialKinematics, never_moves_sideways) {
  EXPECT_EQ(Kinematics::differential(0.5).wheels({.y = 1})[0], 0);
  EXPECT_NEAR(Kinematics::differential(0.5).body({0.3, -0.7}).y, 0, 1e-15);
}

TEST(SkidSteerKinematics, turns_left_and_right_pairs_against_each_other) {
  const WheelSpeeds wheels = Kinematics::skid_steer(0.8).wheels({.x = 1, .w = 1});
  EXPECT_DOUBLE_EQ(wheels[0], 0.6);
  EXPECT_DOUBLE_EQ(wheels[1], 1.4);
  EXPECT_DOUBLE_EQ(wheels[2], 0.6);
  EXPECT_DOUBLE_EQ(wheels[3], 1.4);
}

TEST(SkidSteerKinematics, averages_each_side_and_shows_their_disagreement_as_slip) {
  const Kinematics base = Kinematics::skid_steer(0.8);
  const WheelSpeeds wheels{0.9, 1.0, 1.1, 1.0};
  EXPECT_NEAR(base.body(wheels).x, 1.0, 1e-12);
  EXPECT_NEAR(base.body(wheels).w, 0.0, 1e-12);
  EXPECT_NEAR(base.slip(wheels), 0.1 / std::numbers::sqrt2, 1e-12);
}

TEST(OmniKinematics, forward_turns_the_left_wheels_backward) {
  const WheelSpeeds wheels = ssl_robot().wheels({.x = 1});
  EXPECT_LT(wheels[0], 0);  // front left
  EXPECT_LT(wheels[1], 0);  // rear left
  EXPECT_GT(wheels[2], 0);
  EXPECT_GT(wheels[3], 0);
}

TEST(OmniKinematics, leftward_turns_the_front_wheels_forward) {
  const WheelSpeeds wheels = ssl_robot().wheels({.y = 1});
  EXPECT_GT(wheels[0], 0);
  EXPECT_LT(wheels[1], 0);
  EXPECT_LT(wheels[2], 0);
  EXPECT_GT(wheels[3], 0);
}

TEST(OmniKinematics, counter_clockwise_turns_all_wheels_forward_at_radius_times_w) {
  for (const double speed : ssl_robot().wheels({.w = 10})) EXPECT_NEAR(speed, 0.8, 1e-12);
}

TEST(OmniKinematics, body_of_wheels_is_the_identity_for_any_wheels) {
  std::mt19937 random{5};
  std::uniform_real_distribution<double> uniform{-1, 1};
  for (int trial = 0; trial < 1000; ++trial) {
    const std::size_t count = 3 + static_cast<std::size_t>(trial) % 6;
    std::vector<double> angles;
    for (std::size_t i = 0; i < count; ++i) {
      angles.push_back((static_cast<double>(i) + 0.3 * uniform(random)) * 2 * pi / static_cast<double>(count));
    }
    const Kinematics base = Kinematics::omni(angles, 0.05 + 0.04 * uniform(random));
    const BodyVelocity velocity{.x = 3 * uniform(random), .y = 3 * uniform(random), .w = 10 * uniform(random)};
    const BodyVelocity back = base.body(base.wheels(velocity));
    EXPECT_NEAR(back.x, velocity.x, 1e-12);
    EXPECT_NEAR(back.y, velocity.y, 1e-12);
    EXPECT_NEAR(back.w, velocity.w, 1e-11);
    EXPECT_NEAR(base.slip(base.wheels(velocity)), 0, 1e-12);
  }
}

TEST(OmniKinematics, one_slipping_wheel_of_four_shows_a_quarter_of_its_speed) {
  // Equal wheels at ±45° and ±135°: the one pattern that no motion makes is (1, -1, 1, -1) / 2, so an error of one
  // wheel leaves a residual of half its size, spread over four.
  WheelSpeeds wheels = ssl_robot().wheels({.x = 0.5, .y = 0.2, .w = 1});
  wheels[2] += 0.4;
  EXPECT_NEAR(ssl_robot().slip(wheels), 0.1, 1e-12);
}

TEST(OmniKinematics, three_wheels_cannot_show_slip) {
  const Kinematics base = Kinematics::omni({0, 2 * pi / 3, -2 * pi / 3}, 0.1);
  EXPECT_NEAR(base.slip({1, -3, 2}), 0, 1e-12);
}

TEST(Saturation, keeps_direction_and_curvature) {
  const Kinematics base = ssl_robot();
  const BodyVelocity wanted{.x = 2, .y = -1, .w = 12};
  const WheelSpeeds wheels = saturated(base.wheels(wanted), 1.5);
  for (const double speed : wheels) EXPECT_LE(std::abs(speed), 1.5 + 1e-12);
  const BodyVelocity got = base.body(wheels);
  EXPECT_LT(got.x, wanted.x);
  EXPECT_NEAR(got.y / got.x, wanted.y / wanted.x, 1e-12);
  EXPECT_NEAR(got.w / got.x, wanted.w / wanted.x, 1e-11);
}

TEST(Saturation, leaves_what_is_within_the_limit) {
  const WheelSpeeds wheels = saturated({0.5, -1.5}, 1.5);
  EXPECT_EQ(wheels[0], 0.5);
  EXPECT_EQ(wheels[1], -1.5);
}

TEST(Kinematics, refuses_what_cannot_be_built_and_says_why) {
  EXPECT_THROW(Kinematics::differential(0), std::invalid_argument);
  EXPECT_THROW(Kinematics::differential(nan), std::invalid_argument);
  EXPECT_THROW(Kinematics::skid_steer(-1), std::invalid_argument);
  EXPECT_THROW(Kinematics::omni({0, 1}, 0.1), std::invalid_argument);
  EXPECT_THROW(Kinematics::omni({0, 1, nan}, 0.1), std::invalid_argument);
  EXPECT_THROW(Kinematics::omni({0, 1, 2, 3, 4, 5, 6, 7, 8}, 0.1), std::invalid_argument);
  EXPECT_THROW(Kinematics::omni({0, 0, pi, pi}, 0.1), std::invalid_argument);  // no wheel drives it ahead
  try {
    Kinematics::differential(-0.3);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "track_m is -0.3: give a finite number above 0");
  }
}

}  // namespace
}  // namespace regista::control
