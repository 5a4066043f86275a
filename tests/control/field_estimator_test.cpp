// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/control/field_estimator.hpp>

#include <numbers>
#include <random>

namespace regista::control {
namespace {

using namespace std::chrono_literals;

/// A robot on a circle, its nose along the way: everything about it in closed form.
struct Circle {
  double radius_m = 0.5, w = 2;
  [[nodiscard]] Pose2d at(double t) const {
    return {.x = radius_m * std::sin(w * t), .y = radius_m * (1 - std::cos(w * t)), .heading = wrap_angle(w * t)};
  }
  [[nodiscard]] BodyVelocity velocity() const { return {.x = radius_m * w, .w = w}; }
  [[nodiscard]] InertialMeasurement inertial() const {
    return {.accel_x_mps2 = 0, .accel_y_mps2 = radius_m * w * w, .rate_radps = w};
  }
};

TEST(FieldEstimator, starts_at_the_origin_and_goes_where_it_is_placed) {
  FieldEstimator estimator;
  EXPECT_EQ(estimator.estimate().pose, Pose2d{});
  estimator.place({.x = 1, .y = -2, .heading = 3});
  EXPECT_EQ(estimator.estimate().pose, (Pose2d{.x = 1, .y = -2, .heading = 3}));
}

TEST(FieldEstimator, follows_a_circle_with_late_poses_as_if_they_came_in_time) {
  const Circle circle;
  FieldEstimator estimator;
  std::mt19937_64 random{1};
  std::normal_distribution<double> noise{0, 1};
  double worst_m = 0, worst_rad = 0;
  for (int i = 1; i <= 2500; ++i) {
    const double t = 0.002 * i;
    estimator.predict(circle.inertial(), 2ms);
    estimator.correct(circle.velocity());
    if (i % 8 == 0 && t > 0.06) {  // seen 60 ms ago: 60 mm and 7° back
      Pose2d seen = circle.at(t - 0.06);
      seen.x += 0.004 * noise(random);
      seen.y += 0.004 * noise(random);
      seen.heading += 0.01 * noise(random);
      (void)estimator.correct(seen, 60ms);
    }
    if (t < 1) continue;
    worst_m = std::max(worst_m, distance(estimator.estimate().pose, circle.at(t)));
    worst_rad = std::max(worst_rad, std::abs(angle_between(estimator.estimate().pose.heading, circle.at(t).heading)));
  }
  EXPECT_LT(worst_m, 0.012);
  EXPECT_LT(worst_rad, 0.02);
  EXPECT_NEAR(estimator.estimate().velocity.w, circle.w, 0.05);
}

TEST(FieldEstimator, refuses_a_pose_that_jumps_and_believes_it_when_it_lasts) {
  FieldEstimator estimator;
  for (int i = 0; i < 100; ++i) {
    estimator.predict({}, 2ms);
    (void)estimator.correct(Pose2d{}, 0ms);
  }
  const Pose2d elsewhere{.x = 1, .heading = 1.5};
  for (int i = 0; i < 7; ++i) {
    estimator.predict({}, 16ms);
    const auto fix = estimator.correct(elsewhere, 10ms);
    EXPECT_EQ(fix.position.verdict, Verdict::outlier);
    EXPECT_EQ(fix.heading.verdict, Verdict::outlier);
    EXPECT_LT(estimator.estimate().pose.x, 0.01);
  }
  estimator.predict({}, 16ms);
  const auto fix = estimator.correct(elsewhere, 10ms);
  EXPECT_EQ(fix.position.verdict, Verdict::restarted);
  EXPECT_EQ(fix.heading.verdict, Verdict::restarted);
  EXPECT_NEAR(estimator.estimate().pose.x, 1, 1e-6);
}

/// Which part of what the wheels say differently is believed, in the mean: after a second at a steady speed and 0.1 s
/// at `accel_mps2`, on a body that shakes by `vibration_mps2`.
double trust(double vibration_mps2, double accel_mps2) {
  std::mt19937_64 random{1};
  std::normal_distribution<double> noise;
  double sum = 0;
  constexpr int runs = 40;
  for (int run = 0; run < runs; ++run) {
    FieldEstimator estimator{{.wheels_slip_s = 0.3}};
    double speed = 0;
    for (int i = 0; i < 550; ++i) {
      const double accel = i < 500 ? 0 : accel_mps2;
      speed += 0.002 * accel;
      estimator.predict(
          {.accel_x_mps2 = accel + vibration_mps2 * noise(random), .accel_y_mps2 = vibration_mps2 * noise(random)},
          2ms);
      if (i < 549) estimator.correct(BodyVelocity{.x = speed});
    }
    const double before = estimator.estimate().velocity.x;
    estimator.correct(BodyVelocity{.x = before + 0.1});
    sum += (estimator.estimate().velocity.x - before) / 0.1;
  }
  return sum / runs;
}

TEST(FieldEstimator, doubts_wheels_that_push_and_not_those_that_shake) {
  const double steady = trust(0, 0);
  std::printf("wheels are believed by %.2f %%; shaken by 2 and 5 m/s² by %.2f and %.2f %%; pushed by 3 m/s² %.2f %%\n",
              100 * steady, 100 * trust(2, 0), 100 * trust(5, 0), 100 * trust(0, 3));
  EXPECT_GT(trust(2, 0), 0.5 * steady);
  EXPECT_GT(trust(5, 0), 0.25 * steady);
  EXPECT_LT(trust(0, 3), 0.1 * steady);
  EXPECT_LT(trust(2, 3), 0.15 * steady);
  EXPECT_NEAR(trust(0, 1000) / trust(0, 5), 1, 0.2) << "there is a limit";
}

TEST(FieldEstimator, names_the_value_that_cannot_be) {
  EXPECT_THROW(FieldEstimator{{.fix_sd_m = 0}}, std::invalid_argument);
  EXPECT_THROW(FieldEstimator{{.wheels_sd_mps = -1}}, std::invalid_argument);
}

}  // namespace
}  // namespace regista::control
