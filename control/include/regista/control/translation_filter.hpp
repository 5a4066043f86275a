// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <regista/control/kalman_filter.hpp>
#include <regista/control/measurement.hpp>
#include <regista/core/time.hpp>
#include <variant>

namespace regista::control {

/// Acceleration seen from the field, without gravity.
struct FieldAcceleration {
  double x = 0;  ///< [m/s²]
  double y = 0;  ///< [m/s²]
};

/// The defaults are Holtzhausen's (2013): spectral density over measurement variance is 40 s⁻³. He gives no units; with
/// vision of 4 mm (a moving robot in the league), that is 6.4e-4 m²/s³.
struct TranslationConfig {
  /// White noise on the acceleration, its two-sided power spectral density [m²/s³]: how wrong the input is.
  double acceleration_density = 40 * 0.004 * 0.004;
  double initial_speed_sd_mps = 1;
  double gate = 4;  ///< standard deviations (Mahalanobis) at which a measurement is an outlier
  double max_speed_mps = std::numeric_limits<double>::infinity();  ///< a fix further from the last one is refused
  std::uint32_t restart_after = 8;                                 ///< refused fixes in a row
  double lost_sd_m = 0.05;                                         ///< of each coordinate: 2 s without a fix
};

/// Position and velocity of a body on the field, from accelerations, positions and, if any, velocities.
/// x and y have the same model and the same sensors, hence one covariance of two states.
/// Model: constant acceleration over a step; q = density [[t³/3, t²/2], [t²/2, t]] (Zarchan and Musoff, "Fundamentals
/// of Kalman Filtering", ch. 4; Holtzhausen prints T³/2 and T² in places where T³/3 and T²/2 follow).
class TranslationFilter {
 public:
  using Input = FieldAcceleration;
  using Measurement = std::variant<PositionMeasurement, VelocityMeasurement>;

  /// All that changes from step to step.
  struct State {
    KalmanFilter<2, 2> kalman;  ///< rows: position, velocity; columns: x, y
    Input input;                ///< the last good one
    Eigen::RowVector2d fix{0, 0};
    SensorRecord position;
    SensorRecord velocity;
    std::uint64_t refused_inputs = 0;
    bool initialised = false;
  };

  struct Estimate {
    double x = 0;   ///< [m]
    double y = 0;   ///< [m]
    double vx = 0;  ///< [m/s]
    double vy = 0;  ///< [m/s]
    double position_sd_m = 0;
    double speed_sd_mps = 0;  ///< both of each coordinate
  };

  /// Throws std::invalid_argument, naming the value, for what is not positive (the density may be 0).
  explicit TranslationFilter(const TranslationConfig& config = {});

  /// An input that is not finite is counted and replaced by the last good one; a negative `dt` does nothing.
  void predict(const Input& acceleration, Duration dt);

  /// The first position initialises; velocities before it wait.
  Correction correct(const Measurement& measurement);

  [[nodiscard]] Estimate estimate() const;
  /// Not initialised yet, or less certain than `lost_sd_m`.
  [[nodiscard]] bool lost() const;

  [[nodiscard]] const State& state() const { return state_; }
  void restore(const State& state) { state_ = state; }

 private:
  Correction take(const PositionMeasurement& measurement);
  Correction take(const VelocityMeasurement& measurement);
  void start_at(const PositionMeasurement& measurement);

  TranslationConfig config_;
  State state_;
};

}  // namespace regista::control
