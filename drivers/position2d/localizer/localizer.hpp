// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/control/calibration.hpp>
#include <regista/control/pose_ekf.hpp>
#include <regista/control/rollback.hpp>
#include <regista/device/driver.hpp>

namespace regista {

/// Where a base that does not move sideways is: its wheels, a gyro, a heading and fixes from outside, fused by
/// control::PoseEkf, each measurement at the time when it was true. It drives nothing, and refuses to be driven.
///
/// `requires ["position2d:0"]`, the wheels, and where there are any an `imu`, and a `localize` whose first hypothesis
/// is a fix: that of a `gps` driver, or of a camera. Here or on other servers. `provides ["position2d:1"
/// "localize:1"]`: pose and velocity, and the pose with its covariance, in the frame of the fixes. Both are silent
/// while the pose means nothing: before there is a position and a heading, when it is lost, and without wheels.
///
/// Of the IMU it takes imu::Calibrated (the gyro), imu::State (the heading), imu::Euler and imu::FullState (both).
///
/// Properties, to read: `explain` (a line for each sensor: what was taken and refused, how far it was off, how old the
/// last is), `status` (waiting, tracking, lost, no wheels), `position_sd` [m], `heading_sd` [rad]. localize's SET_POSE
/// and position2d's SET_ODOM put the base somewhere.
///
/// | Key                 | Value                                                                     | Default       |
/// |---------------------|---------------------------------------------------------------------------|---------------|
/// | `wheels_sd`         | [length/s] of the speed that the wheels tell                              | 0.03 m/s      |
/// | `wheels_turn_sd`    | [angle/s] of the turn rate that they tell                                 | 0.1 rad/s     |
/// | `wheels_timeout`    | [s] without them: nothing is published                                    | 0.5           |
/// | `gyro_sd`           | [angle/s]                                                                 | 0.007 rad/s   |
/// | `imu_heading`       | boolean: the IMU's yaw is a heading in the field, as a compass gives it   | no            |
/// | `heading_sd`        | [angle] of it                                                             | 0.05 rad      |
/// | `heading_rate`      | [Hz] at which it is taken at most: its errors repeat, they are not noise  | 5             |
/// | `compass`           | [angle] five: A to E of its deviation, see control::CompassCalibration    | 0 0 0 0 0     |
/// | `fix_sd`            | [length] of each coordinate of a fix, where its covariance says less      | 0.05 m        |
/// | `start`             | [length length angle] where the base is at first                          |               |
/// | `gate`              | standard deviations at which a measurement is an outlier                  | 4             |
/// | `restart_after`     | outliers in a row that are believed after all                             | 8             |
/// | `align`             | [length] of way that gives the heading where no sensor does               | 5 m           |
/// | `accel_density`, `turn_density` | [m²/s³, rad²/s³] how suddenly the base moves, as white noise  | 0.5, 0.5      |
/// | `slip_density`      | [m²/s] of what wheels do not see, and of an error of the fixes that wanders | 1e-4        |
/// | `lost`, `lost_heading` | [length, angle] sd at which the pose means nothing any more            | 5 m, 0.8 rad  |
class Localizer final : public Driver {
 public:
  explicit Localizer(Setup& setup);

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override {}

 private:
  static constexpr std::size_t history =
      1024;  // 2 s of 50 Hz beats, 100 Hz wheels, 100 Hz gyro, and a prediction before each
  using Filter = control::Rollback<control::PoseEkf, history>;

  void listen_to_imu();
  void take(const control::PoseEkf::Measurement& measurement, Time measured);
  void take_gyro(double w_radps, Time measured);
  void take_heading(double yaw_rad, Time measured);
  void take_fix(const localize::State& state, Time measured);
  void advance(Time now);
  Result<Empty> place(const Pose2d& pose, double position_sd_m, double heading_sd_rad);
  [[nodiscard]] control::PoseEkf fresh() const;
  [[nodiscard]] bool believable() const;
  void tell_changes();
  [[nodiscard]] std::string explain() const;

  Port<Position2d> pose_;
  Port<Localize> belief_;
  Required<Position2d> wheels_;
  std::optional<Required<Imu>> imu_;
  std::optional<Required<Localize>> fixes_;
  Property<std::string> explain_text_;
  Property<std::string> status_text_;
  Property<double> position_sd_m_;
  Property<double> heading_sd_rad_;

  // As configured.
  control::PoseEkfConfig ekf_config_;
  double wheels_sd_mps_;
  double wheels_turn_sd_radps_;
  Duration wheels_timeout_;
  double gyro_sd_radps_;
  bool uses_heading_;
  double heading_sd_of_imu_rad_;
  Duration heading_period_;
  control::CompassCalibration compass_;
  double fix_sd_m_;
  std::optional<Pose2d> start_;

  Filter filter_;
  std::optional<Time> advanced_;  ///< where the filter is
  std::optional<Time> wheels_seen_;
  std::optional<Time> imu_seen_;
  std::optional<Time> fix_seen_;
  std::optional<Time> heading_taken_;
  std::uint8_t stalled_ = 0;
  std::string told_status_;
  std::uint64_t told_restarts_ = 0;
  Duration since_explained_{};
};

}  // namespace regista
