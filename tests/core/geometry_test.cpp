// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/core/geometry.hpp>

#include <limits>
#include <random>

namespace regista {
namespace {

constexpr double pi = std::numbers::pi;

TEST(WrapAngle, has_one_name_for_backwards) {
  EXPECT_EQ(wrap_angle(-pi), pi);
  EXPECT_EQ(wrap_angle(pi), pi);
  EXPECT_EQ(wrap_angle(3 * pi), pi);
}

TEST(WrapAngle, keeps_the_direction_of_any_angle) {
  std::mt19937 random{1};
  std::uniform_real_distribution<double> angles{-1000, 1000};
  for (int i = 0; i < 10'000; ++i) {
    const double angle = angles(random);
    const double wrapped = wrap_angle(angle);
    ASSERT_GT(wrapped, -pi);
    ASSERT_LE(wrapped, pi);
    ASSERT_NEAR(std::cos(wrapped), std::cos(angle), 1e-12);
    ASSERT_NEAR(std::sin(wrapped), std::sin(angle), 1e-12);
  }
}

TEST(WrapAngle, passes_nan_on) {
  EXPECT_TRUE(std::isnan(wrap_angle(std::numeric_limits<double>::infinity())));
  EXPECT_TRUE(std::isnan(wrap_angle(std::numeric_limits<double>::quiet_NaN())));
}

TEST(AngleBetween, takes_the_short_way_through_backwards) {
  EXPECT_NEAR(angle_between(3.0, -3.0), 2 * pi - 6.0, 1e-15);
  EXPECT_NEAR(angle_between(-3.0, 3.0), 6.0 - 2 * pi, 1e-15);
}

TEST(Velocity, driving_ahead_while_facing_left_moves_along_field_y) {
  const FieldVelocity field = to_field(BodyVelocity{.x = 1}, pi / 2);
  EXPECT_NEAR(field.x, 0, 1e-15);
  EXPECT_NEAR(field.y, 1, 1e-15);
}

TEST(Velocity, comes_back_from_the_other_frame_unchanged) {
  std::mt19937 random{2};
  std::uniform_real_distribution<double> values{-5, 5};
  for (int i = 0; i < 1000; ++i) {
    const BodyVelocity v{values(random), values(random), values(random)};
    const double heading = values(random);
    const BodyVelocity back = to_body(to_field(v, heading), heading);
    ASSERT_NEAR(back.x, v.x, 1e-14);
    ASSERT_NEAR(back.y, v.y, 1e-14);
    ASSERT_EQ(back.w, v.w);
  }
}

TEST(Pose2d, a_ball_ahead_of_a_robot_that_faces_left_is_on_the_robots_left_in_the_field) {
  const Pose2d field_from_ball = Pose2d{.x = 1, .y = 2, .heading = pi / 2} * Pose2d{.x = 0.5};
  EXPECT_NEAR(field_from_ball.x, 1, 1e-15);
  EXPECT_NEAR(field_from_ball.y, 2.5, 1e-15);
  EXPECT_NEAR(field_from_ball.heading, pi / 2, 1e-15);
}

TEST(Pose2d, its_inverse_leads_back) {
  std::mt19937 random{3};
  std::uniform_real_distribution<double> values{-3, 3};
  for (int i = 0; i < 1000; ++i) {
    const Pose2d pose{values(random), values(random), values(random)};
    for (const Pose2d& identity : {inverse(pose) * pose, pose * inverse(pose)}) {
      ASSERT_NEAR(identity.x, 0, 1e-14);
      ASSERT_NEAR(identity.y, 0, 1e-14);
      ASSERT_NEAR(identity.heading, 0, 1e-14);
    }
  }
}

}  // namespace
}  // namespace regista
