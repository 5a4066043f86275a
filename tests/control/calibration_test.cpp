// SPDX-License-Identifier: Apache-2.0
#include "regista/control/calibration.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

#include "regista/control/kinematics.hpp"
#include "regista/control/odometry.hpp"

namespace regista::control {
namespace {

using namespace std::chrono_literals;
constexpr double pi = std::numbers::pi;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

struct Base {
  double left_radius_m = 0.0976;
  double right_radius_m = 0.1010;
  double track_m = 0.62;
};

/// Thirty seconds of driving with a reference five times a second.
std::vector<WheelSample> drive(const Base& base, double w_amplitude, double noise, double speed_mps = 0.4) {
  std::mt19937 random{3};
  std::normal_distribution<double> normal;
  const Kinematics kinematics = Kinematics::differential(base.track_m);
  Pose2d pose{.x = 3, .y = -1, .heading = 3};
  WheelSample sample{.left_rad = 100, .right_rad = -7, .reference = {}};
  std::vector<WheelSample> run;
  for (int i = 0; i < 1500; ++i) {
    const double t = 0.02 * i;
    const BodyVelocity velocity{.x = speed_mps, .w = w_amplitude * std::sin(0.5 * t)};
    const WheelSpeeds wheels = kinematics.wheels(velocity);
    pose = travelled(pose, velocity, 20ms);
    sample.left_rad += wheels[0] * 0.02 / base.left_radius_m;
    sample.right_rad += wheels[1] * 0.02 / base.right_radius_m;
    sample.reference.reset();
    if (i % 10 == 0) {
      sample.reference = {.x = pose.x + noise * normal(random),
                          .y = pose.y + noise * normal(random),
                          .heading = wrap_angle(pose.heading + noise * normal(random))};
    }
    run.push_back(sample);
  }
  return run;
}

TEST(WheelCalibration, finds_radii_and_track_exactly_without_noise) {
  const auto result = calibrate_wheels(drive({}, 1.2, 0));
  ASSERT_TRUE(result) << result.error().message();
  EXPECT_NEAR(result->left_radius_m, 0.0976, 1e-9);
  EXPECT_NEAR(result->right_radius_m, 0.1010, 1e-9);
  EXPECT_NEAR(result->track_m, 0.62, 1e-8);
  EXPECT_NEAR(result->position_residual_m, 0, 1e-9);
}

TEST(WheelCalibration, finds_them_within_three_of_its_standard_deviations_with_noise) {
  const auto result = calibrate_wheels(drive({}, 1.2, 0.01));
  ASSERT_TRUE(result) << result.error().message();
  EXPECT_LT(result->left_radius_sd_m, 0.0005);
  EXPECT_LT(result->track_sd_m, 0.005);
  EXPECT_NEAR(result->left_radius_m, 0.0976, 3 * result->left_radius_sd_m);
  EXPECT_NEAR(result->right_radius_m, 0.1010, 3 * result->right_radius_sd_m);
  EXPECT_NEAR(result->track_m, 0.62, 3 * result->track_sd_m);
  EXPECT_NEAR(result->heading_residual_rad, 0.01, 0.002);
  EXPECT_NEAR(result->position_residual_m, 0.01 * std::numbers::sqrt2, 0.002);
}

TEST(WheelCalibration, finds_the_factor_that_was_corrected_by_hand) {
  // Kvalheim et al. multiplied their odometry by 1.19: wheels that much larger than the drawing says.
  const Base oslo{.left_radius_m = 1.19 * 0.1, .right_radius_m = 1.19 * 0.1, .track_m = 0.6};
  const auto result = calibrate_wheels(drive(oslo, 0.8, 0.005));
  ASSERT_TRUE(result) << result.error().message();
  EXPECT_NEAR(result->left_radius_m / 0.1, 1.19, 0.005);
}

TEST(WheelCalibration, refuses_a_run_that_cannot_tell) {
  EXPECT_FALSE(calibrate_wheels({}));
  EXPECT_FALSE(calibrate_wheels(drive({}, 0, 0)));       // straight
  EXPECT_FALSE(calibrate_wheels(drive({}, 0, 0.01)));    // straight, with noise that looks like turns
  EXPECT_FALSE(calibrate_wheels(drive({}, 1.0, 0, 0)));  // on the spot
  auto bad = drive({}, 1.2, 0);
  bad[700].left_rad = nan;
  EXPECT_FALSE(calibrate_wheels(bad));
}

TEST(WheelCalibration, says_when_a_wheel_counts_backwards) {
  auto run = drive({}, 1.2, 0.01);
  for (WheelSample& sample : run) sample.left_rad = -sample.left_rad;
  const auto result = calibrate_wheels(run);
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().message().find("backwards"), std::string::npos);
}

std::vector<CompassSample> circle(double offset, double noise, double arc = 2 * pi) {
  std::mt19937 random{8};
  std::normal_distribution<double> normal;
  std::vector<CompassSample> run;
  for (int i = 0; i < 360; ++i) {
    const double m = wrap_angle(-2.0 + arc * i / 360);
    // 6-7° of error, as Lien measured
    const double error = offset + 0.10 * std::sin(m) - 0.03 * std::cos(m) + 0.02 * std::sin(2 * m);
    run.push_back({.measured_rad = m, .reference_rad = wrap_angle(m - error + noise * normal(random))});
  }
  return run;
}

TEST(CompassCalibration, removes_the_error_of_a_recorded_circle) {
  for (const double offset : {0.0, 0.2, pi, -3.1}) {
    const auto compass = CompassCalibration::fit(circle(offset, 0));
    ASSERT_TRUE(compass) << compass.error().message();
    for (const auto& [measured, reference] : circle(offset, 0)) {
      EXPECT_NEAR(angle_between(compass->corrected(measured), reference), 0, 1e-12);
    }
  }
}

TEST(CompassCalibration, averages_noise) {
  const auto compass = CompassCalibration::fit(circle(0.1, 0.02));
  ASSERT_TRUE(compass);
  for (const auto& [measured, reference] : circle(0.1, 0)) {
    // sd 0.02 sqrt(5 / 360) = 0.0024 on average
    EXPECT_NEAR(angle_between(compass->corrected(measured), reference), 0, 0.008);
  }
}

TEST(CompassCalibration, refuses_an_incomplete_circle_and_says_where) {
  const auto compass = CompassCalibration::fit(circle(0, 0, 1.3 * pi));
  ASSERT_FALSE(compass);
  EXPECT_NE(compass.error().message().find("turn a full circle"), std::string::npos);
  EXPECT_FALSE(CompassCalibration::fit({}));
  auto bad = circle(0, 0);
  bad[5].reference_rad = nan;
  EXPECT_FALSE(CompassCalibration::fit(bad));
}

TEST(CompassCalibration, refuses_a_deviation_steeper_than_the_heading) {
  EXPECT_THROW(CompassCalibration({0, 0.7, 0, 0.3, 0}), std::invalid_argument);
  EXPECT_THROW(CompassCalibration({nan, 0, 0, 0, 0}), std::invalid_argument);
  EXPECT_NO_THROW(CompassCalibration({0.1, 0.1, 0.1, 0.05, 0}));
}

struct Dimensions {
  double left_m;
  double right_m;
  double track_m;
};

/// Where a base that believes in `nominal` ends after a square of 4 m that its odometry sees closed.
SquareError square(const Dimensions& nominal, const Dimensions& real, double direction) {
  Pose2d pose;
  const auto move = [&](double way_m, double turn_rad) {
    const double left_rad = (way_m - turn_rad * nominal.track_m / 2) / nominal.left_m;
    const double right_rad = (way_m + turn_rad * nominal.track_m / 2) / nominal.right_m;
    const double left = left_rad * real.left_m;
    const double right = right_rad * real.right_m;
    pose = travelled(pose, {.x = (left + right) / 2, .w = (right - left) / real.track_m}, std::chrono::seconds{1});
  };
  for (int side = 0; side < 4; ++side) {
    move(4, 0);
    move(0, direction * std::numbers::pi / 2);
  }
  return {pose.x, pose.y};
}

TEST(Umbmark, leaves_a_tenth_of_the_error) {
  const Dimensions real{0.1003, 0.0997, 0.404};
  const Dimensions nominal{0.1, 0.1, 0.4};
  const SquareError cw = square(nominal, real, -1);
  const SquareError ccw = square(nominal, real, 1);
  EXPECT_GT(std::hypot(ccw.x_m, ccw.y_m), 0.1);
  const auto found = umbmark(0.1, 0.1, 0.4, 4, cw, ccw);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->track_m, real.track_m, 4e-4);
  EXPECT_NEAR(found->right_radius_m / found->left_radius_m, real.right_m / real.left_m, 6e-4);
  EXPECT_NEAR(found->right_radius_m + found->left_radius_m, 0.2, 1e-5);
  const Dimensions corrected{found->left_radius_m, found->right_radius_m, found->track_m};
  for (const double direction : {-1.0, 1.0}) {
    const SquareError before = square(nominal, real, direction);
    const SquareError after = square(corrected, real, direction);
    EXPECT_LT(std::hypot(after.x_m, after.y_m), 0.1 * std::max(0.1, std::hypot(before.x_m, before.y_m)));
  }
}

TEST(Umbmark, refuses_errors_that_no_dimension_explains) {
  EXPECT_FALSE(umbmark(0.1, 0.1, 0.4, 4, {1.1, 0}, {}));
  EXPECT_FALSE(umbmark(0.1, 0.1, 0.4, 0, {}, {}));
  EXPECT_FALSE(umbmark(0.1, 0.1, 0.4, 4, {std::nan(""), 0}, {}));
}

}  // namespace
}  // namespace regista::control
