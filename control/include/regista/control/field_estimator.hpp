// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/control/orientation_filter.hpp>
#include <regista/control/rollback.hpp>
#include <regista/control/translation_filter.hpp>
#include <regista/control/velocity_profile.hpp>

namespace regista::control {

/// What an inertial measurement unit says of the body, its zero subtracted.
struct InertialMeasurement {
  double accel_x_mps2 = 0;  ///< ahead
  double accel_y_mps2 = 0;  ///< to the left
  double rate_radps = 0;    ///< counter-clockwise
};

struct FieldEstimatorConfig {
  TranslationConfig translation{.acceleration_density = 5e-4};
  OrientationConfig orientation{.rate_density = 1e-6, .bias_density = 1e-7};
  double fix_sd_m = 0.004;      ///< of each coordinate that a camera sees
  double fix_sd_rad = 0.010;    ///< of the heading that a camera sees
  double wheels_sd_mps = 0.15;  ///< of each component of the wheels' velocity, at rest or at a steady speed
  /// What the body's acceleration, less its vibration, adds to it, squares summed [m/s per m/s²]. A wheel pushes by
  /// slipping, all of them the same way, which goes on for longer than a measurement: 0.3 s stands for both. 0: they
  /// never slip.
  double wheels_slip_s = 0;
  double wheels_slip_most_mps = 1;  ///< no acceleration adds more
};

/// Where an omnidirectional robot is on the field, and how it moves: predicted by accelerometer and gyro, corrected by
/// the wheels' velocity and by poses that a camera saw some time ago.
class FieldEstimator {
 public:
  struct Fix {
    Correction position;
    Correction heading;
  };

  /// At the origin, at rest. Throws std::invalid_argument that names the value which cannot be.
  explicit FieldEstimator(const FieldEstimatorConfig& config = {});

  /// It is here now, and all else is forgotten.
  void place(const Pose2d& pose);

  void predict(const InertialMeasurement& measured, Duration dt);
  Correction correct(const BodyVelocity& wheels);
  /// A pose of `age` before the end of the last step.
  Fix correct(const Pose2d& seen, Duration age);

  [[nodiscard]] MotionState estimate() const;
  /// Filters of position and heading, with what they count.
  [[nodiscard]] const TranslationFilter& translation() const { return translation_.filter(); }
  [[nodiscard]] const OrientationFilter& orientation() const { return orientation_.filter(); }

 private:
  static constexpr std::size_t history = 256;  // 0.5 s at 500 Hz

  FieldEstimatorConfig config_;
  Rollback<TranslationFilter, history> translation_;
  Rollback<OrientationFilter, history> orientation_;
  FieldAcceleration pushed_;  ///< low-pass
};

}  // namespace regista::control
