// SPDX-License-Identifier: Apache-2.0
#include "regista/control/odometry.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>

namespace regista::control {
namespace {

using namespace std::chrono_literals;
constexpr double pi = std::numbers::pi;

TEST(Odometry, ahead_is_along_the_heading) {
  const Pose2d end = travelled({.x = 1, .y = 2, .heading = pi / 2}, {.x = 0.5}, 2s);
  EXPECT_NEAR(end.x, 1, 1e-15);
  EXPECT_NEAR(end.y, 3, 1e-15);
}

TEST(Odometry, turning_left_while_ahead_leads_to_the_left) {
  const Pose2d end = travelled({}, {.x = 1, .w = 0.5}, 1s);
  EXPECT_GT(end.y, 0);  // the published formula of Oslo's report has the opposite sign
  EXPECT_GT(end.heading, 0);
}

TEST(Odometry, a_quarter_circle_ends_at_its_radius) {
  const Pose2d end = travelled({}, {.x = pi / 2, .w = pi / 2}, 1s);
  EXPECT_NEAR(end.x, 1, 1e-15);
  EXPECT_NEAR(end.y, 1, 1e-15);
  EXPECT_NEAR(end.heading, pi / 2, 1e-15);
}

TEST(Odometry, one_long_step_equals_many_short_ones_sideways_too) {
  const BodyVelocity velocity{.x = 0.7, .y = -0.4, .w = 1.3};
  const Pose2d whole = travelled({.heading = 2}, velocity, 4s);
  Pose2d parts{.heading = 2};
  for (int i = 0; i < 4000; ++i) parts = travelled(parts, velocity, 1ms);
  EXPECT_NEAR(whole.x, parts.x, 1e-12);
  EXPECT_NEAR(whole.y, parts.y, 1e-12);
  EXPECT_NEAR(whole.heading, parts.heading, 1e-12);
}

TEST(Odometry, is_smooth_through_zero_turn_rate) {
  // y of the arc is v (1 - cos wt) / w = v t (wt)/2 (1 - (wt)²/12 + ...): compared with its series on both sides of
  // every switch between formulas.
  for (const double turn : {0.0, 1e-300, 1e-12, 1e-8, 1e-4, 0.01, 0.1999, 0.2, 0.2001, 0.21}) {
    for (const double sign : {-1.0, 1.0}) {
      const double w = sign * turn;
      const Pose2d end = travelled({}, {.x = 1, .w = w}, 1s);
      const double w2 = w * w;
      EXPECT_NEAR(end.y, w / 2 * (1 - w2 / 12 * (1 - w2 / 30 * (1 - w2 / 56 * (1 - w2 / 90)))), 1e-12 * turn) << w;
      EXPECT_NEAR(end.x, 1 - w2 / 6 * (1 - w2 / 20 * (1 - w2 / 42 * (1 - w2 / 72))), 1e-14) << w;
    }
  }
}

TEST(Odometry, wraps_the_heading) {
  Odometry odometry;
  odometry.reset({.heading = 3});
  EXPECT_NEAR(odometry.step({.w = 1}, 1s).heading, 4 - 2 * pi, 1e-12);
}

TEST(Odometry, refuses_and_counts_what_is_not_a_velocity) {
  Odometry odometry;
  odometry.step({.x = 1}, 1s);
  const Pose2d before = odometry.pose();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(odometry.step({.x = nan}, 1s), before);
  EXPECT_EQ(odometry.step({.y = -1e300}, 1s), before);
  EXPECT_EQ(odometry.step({.w = std::numeric_limits<double>::infinity()}, 1s), before);
  EXPECT_EQ(odometry.step({.x = 1}, -1s), before);
  odometry.reset({.x = nan});
  EXPECT_EQ(odometry.pose(), before);
  EXPECT_EQ(odometry.refused(), 5u);
}

TEST(Odometry, refuses_a_negative_noise) { EXPECT_THROW(Odometry{{.position_m2_per_m = -1}}, std::invalid_argument); }

TEST(Odometry, covariance_agrees_with_a_thousand_noisy_robots) {
  const OdometryNoise noise{.position_m2_per_m = 1e-3, .heading_rad2_per_m = 4e-3, .heading_rad2_per_rad = 2e-3};
  const BodyVelocity velocity{.x = 0.5, .y = 0.1, .w = 0.4};
  constexpr int steps = 60;
  constexpr int robots = 4000;
  Odometry odometry{noise};
  for (int i = 0; i < steps; ++i) odometry.step(velocity, 50ms);

  std::mt19937 random{11};
  std::normal_distribution<double> normal;
  double xx = 0, xy = 0, xh = 0, yy = 0, yh = 0, hh = 0;
  for (int robot = 0; robot < robots; ++robot) {
    Pose2d pose;
    for (int i = 0; i < steps; ++i) {
      const double way = std::hypot(velocity.x, velocity.y) * 0.05;
      const double turn_sd = std::sqrt(4e-3 * way + 2e-3 * velocity.w * 0.05);
      BodyVelocity noisy = velocity;
      noisy.w += turn_sd * normal(random) / 0.05;
      pose = travelled(pose, noisy, 50ms);
      pose.x += std::sqrt(1e-3 * way) * normal(random);
      pose.y += std::sqrt(1e-3 * way) * normal(random);
    }
    const double x = pose.x - odometry.pose().x;
    const double y = pose.y - odometry.pose().y;
    const double h = angle_between(odometry.pose().heading, pose.heading);
    xx += x * x / robots, xy += x * y / robots, xh += x * h / robots;
    yy += y * y / robots, yh += y * h / robots, hh += h * h / robots;
  }
  // A sample variance of 4000 scatters by 2.2 %; five of those, and second-order effects.
  const PoseCovariance& c = odometry.covariance();
  EXPECT_NEAR(c.xx / xx, 1, 0.12);
  EXPECT_NEAR(c.yy / yy, 1, 0.12);
  EXPECT_NEAR(c.hh / hh, 1, 0.12);
  EXPECT_NEAR(c.xh, xh, 0.12 * std::sqrt(xx * hh));
  EXPECT_NEAR(c.yh, yh, 0.12 * std::sqrt(yy * hh));
  EXPECT_NEAR(c.xy, xy, 0.12 * std::sqrt(xx * yy));
}

}  // namespace
}  // namespace regista::control
