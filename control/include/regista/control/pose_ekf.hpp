// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <regista/control/kalman_filter.hpp>
#include <regista/control/measurement.hpp>
#include <regista/control/odometry.hpp>
#include <regista/core/geometry.hpp>
#include <regista/core/time.hpp>
#include <string>
#include <variant>

namespace regista::control {

/// White noise densities and limits; the defaults suit a field robot of walking pace.
struct PoseEkfConfig {
  double acceleration_density = 0.5;  ///< of the forward speed's derivative [m²/s³]
  double turn_density = 0.5;          ///< of the turn rate's derivative [rad²/s³]
  double bias_density = 1e-8;         ///< of the gyro bias' derivative [rad²/s³]
  double slip_density = 1e-4;         ///< of what moves the base otherwise, sideways say [m²/s]
  double initial_speed_sd_mps = 1;
  double initial_turn_sd_radps = 1;
  double initial_bias_sd_radps = 0.05;
  double gate = 4;                  ///< standard deviations (Mahalanobis) at which a measurement is an outlier
  std::uint32_t restart_after = 8;  ///< refused positions, or headings, in a row
  double align_distance_m = 5;      ///< way between two positions that gives the heading where no sensor does
  double lost_position_sd_m = 5;    ///< of x and y together
  double lost_heading_sd_rad = 0.8;
};

/// Pose, forward speed, turn rate and gyro bias of a base that does not move sideways (differential, skid-steered),
/// from whatever is there of wheels, gyro, heading (IMU or compass, see CompassCalibration) and positions (GPS or
/// vision), each at its own rate and gated on its own, so that a wrong heading does not cost the position beside it.
///
/// Waits for a position and a heading. Where no heading comes, the way between two positions gives it, from the
/// same way as the wheels saw it.
///
/// Model: constant speed and turn rate over a step, along the exact arc; white noise on their derivatives, on the bias'
/// and on the position. Noise within a step acts along and about the middle heading of the step; its lateral effect
/// (turn_density v² t⁵ / 20) is left out. Lien (2013) prints this model without the time step in x and y.
class PoseEkf {
 public:
  struct Input {};  ///< none: all sensors are measurements
  using Measurement = std::variant<WheelMeasurement, GyroMeasurement, HeadingMeasurement, PositionMeasurement>;

  /// All that changes from step to step.
  struct State {
    KalmanFilter<6> kalman;  ///< x, y, heading (wrapped), speed, turn rate, bias
    SensorRecord wheels;
    SensorRecord gyro;
    SensorRecord heading;
    SensorRecord position;
    Pose2d anchor;  ///< of the first position, while the heading is unknown
    bool located = false;
    bool oriented = false;
  };

  struct Estimate {
    Pose2d pose;
    PoseCovariance covariance;
    double speed_mps = 0;
    double w_radps = 0;
    double bias_radps = 0;
    double speed_sd_mps = 0;
    double w_sd_radps = 0;
    double bias_sd_radps = 0;
  };

  enum class Status : std::uint8_t { waiting, tracking, lost };

  /// What was fused, what was refused, and why.
  struct Explanation {
    Status status = Status::waiting;
    bool located = false;   ///< a position came
    bool oriented = false;  ///< a heading came, or was found from the way
    double position_sd_m = 0;
    double heading_sd_rad = 0;
    SensorRecord wheels;
    SensorRecord gyro;
    SensorRecord heading;
    SensorRecord position;
  };

  /// Throws std::invalid_argument, naming the value, for what is not positive (densities may be 0).
  explicit PoseEkf(const PoseEkfConfig& config = {});

  /// Start from a pose that somebody knows. Throws std::invalid_argument unless all are finite and the standard
  /// deviations positive.
  void reset(const Pose2d& pose, double position_sd_m, double heading_sd_rad);

  /// A negative `dt` does nothing.
  void predict(Input input, Duration dt);

  Correction correct(const Measurement& measurement);

  /// The pose means something from the status `tracking` on.
  [[nodiscard]] Estimate estimate() const;
  [[nodiscard]] Status status() const;
  [[nodiscard]] Explanation explain() const;

  [[nodiscard]] const State& state() const { return state_; }
  void restore(const State& state) { state_ = state; }

 private:
  Correction take(const WheelMeasurement& measurement);
  Correction take(const GyroMeasurement& measurement);
  Correction take(const HeadingMeasurement& measurement);
  Correction take(const PositionMeasurement& measurement);
  Correction align(const PositionMeasurement& measurement);
  void turn_about_anchor(double heading_rad, double variance);
  void place(const PositionMeasurement& measurement);

  PoseEkfConfig config_;
  State state_;
};

/// A line for each sensor, for people. Allocates: not for a step.
[[nodiscard]] std::string to_string(const PoseEkf::Explanation& explanation);

}  // namespace regista::control
