// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/control/imu_calibration.hpp>

#include <numbers>
#include <random>

namespace regista::control {
namespace {

using namespace std::chrono_literals;

constexpr double g = 9.80665;

/// What a chip reads that is turned by `chip_from_body`, with bias and noise.
struct Chip {
  Eigen::Matrix3d chip_from_body = Eigen::Matrix3d::Identity();
  Eigen::Vector3d bias_radps = {0.02, -0.01, 0.03};
  std::mt19937_64 random{1};

  ImuSample read(const Eigen::Vector3d& accel, const Eigen::Vector3d& rate) {
    std::normal_distribution<double> noise{0, 0.01};
    const Eigen::Vector3d some{noise(random), noise(random), noise(random)};
    return {.accel_mps2 = chip_from_body * (accel + Eigen::Vector3d{0, 0, g}) + 3 * some,
            .rate_radps = chip_from_body * rate + bias_radps + some / 2};
  }
  ImuSample at_rest() { return read({0, 0, 0}, {0, 0, 0}); }
};

TEST(ImuCalibration, is_ready_after_a_second_at_rest) {
  ImuCalibration calibration;
  Chip chip;
  for (int i = 0; i < 499; ++i) calibration.step(chip.at_rest(), true, 2ms);
  EXPECT_FALSE(calibration.ready());
  calibration.step(chip.at_rest(), true, 2ms);
  EXPECT_TRUE(calibration.ready());
}

TEST(ImuCalibration, takes_a_small_tilt_and_the_gyros_bias_away) {
  Chip chip;
  chip.chip_from_body = Eigen::AngleAxisd{0.1, Eigen::Vector3d{1, 2, 0}.normalized()}.toRotationMatrix();
  ImuCalibration calibration;
  for (int i = 0; i < 1000; ++i) calibration.step(chip.at_rest(), true, 2ms);
  Eigen::Vector3d accel = Eigen::Vector3d::Zero(), rate = Eigen::Vector3d::Zero();
  for (int i = 0; i < 1000; ++i) {
    calibration.step(chip.read({1, -2, 0}, {0, 0, 3}), false, 2ms);
    accel += calibration.calibrated().accel_mps2 / 1000;
    rate += calibration.calibrated().rate_radps / 1000;
  }
  EXPECT_NEAR(accel.x(), 1, 0.01);
  EXPECT_NEAR(accel.y(), -2, 0.01);
  EXPECT_NEAR(accel.z(), g, 0.01);
  EXPECT_NEAR(rate.z(), 3, 0.002);
}

TEST(ImuCalibration, turns_a_chip_that_is_mounted_sideways_and_upside_down) {
  // Upside down, its x to the robot's right: x_chip = -y, y_chip = -x, z_chip = -z.
  Chip chip;
  chip.chip_from_body << 0, -1, 0, -1, 0, 0, 0, 0, -1;
  ImuCalibration calibration{{.mount = {.roll = std::numbers::pi, .yaw = -std::numbers::pi / 2}}};
  for (int i = 0; i < 500; ++i) calibration.step(chip.at_rest(), true, 2ms);
  calibration.step(chip.read({1, 0, 0}, {0, 0, 2}), false, 2ms);
  EXPECT_NEAR(calibration.calibrated().accel_mps2.x(), 1, 0.2);
  EXPECT_NEAR(calibration.calibrated().accel_mps2.y(), 0, 0.2);
  EXPECT_NEAR(calibration.calibrated().rate_radps.z(), 2, 0.05);
}

TEST(ImuCalibration, waits_while_the_wheels_turn_or_somebody_carries_the_robot) {
  ImuCalibration calibration;
  Chip chip;
  for (int i = 0; i < 1000; ++i) calibration.step(chip.at_rest(), i % 100 != 0, 2ms);
  EXPECT_FALSE(calibration.ready());
  for (int i = 0; i < 1000; ++i) {
    const double swing = std::sin(0.02 * i);
    calibration.step(chip.read({0, 2 * swing, 0}, {0.5 * swing, 0, 0}), true, 2ms);
  }
  EXPECT_FALSE(calibration.ready());
}

TEST(ImuCalibration, follows_a_bias_that_drifts_from_rest_to_rest) {
  ImuCalibration calibration;
  Chip chip;
  for (int i = 0; i < 500; ++i) calibration.step(chip.at_rest(), true, 2ms);
  chip.bias_radps.z() += 0.05;
  for (int i = 0; i < 500; ++i) calibration.step(chip.at_rest(), true, 2ms);
  calibration.step(chip.at_rest(), false, 2ms);
  EXPECT_NEAR(calibration.calibrated().rate_radps.z(), 0, 0.02);
}

TEST(ImuCalibration, takes_no_sample_that_is_no_number) {
  ImuCalibration calibration;
  calibration.step({.accel_mps2 = {0, 0, std::nan("")}}, true, 2ms);
  EXPECT_EQ(calibration.refused(), 1U);
  EXPECT_TRUE(calibration.calibrated().accel_mps2.allFinite());
  EXPECT_THROW(ImuCalibration{{.rest = {}}}, std::invalid_argument);
}

}  // namespace
}  // namespace regista::control
