// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <regista/control/field_estimator.hpp>
#include <regista/control/imu_calibration.hpp>
#include <regista/control/kinematics.hpp>
#include <regista/control/trajectory_tracker.hpp>
#include <regista/device/driver.hpp>
#include <regista/motor_board/client.hpp>
#include <variant>

#include "imu_chips.hpp"

namespace regista {

/// A soccer robot of the Small Size League: four omni wheels, kicker and battery on a motor board, an IMU, and a camera
/// above the field that says where it is. Drives at velocities and to poses; fuses, plans and corrects by itself.
///
/// `provides ["position2d:0" "position2d:1" "kicker:0" "power:0" "imu:0"]`, or the first few of one interface:
/// - the first position2d drives. Its frame is the field's; without a camera, where it was when it was opened.
/// - the second takes measurements: VEL is the pose that a camera saw, with its age; VEL_HEAD kicks, with speed and
///   angle, once each. It sends the last pose seen.
///
/// Properties, to read: `vision` (waiting, good, stale, stopped, lost, unused), `vision.rejected`, `vision.restarts`,
/// `imu.calibrated`, `slipping`, `board.refused`.
///
/// | Key                | Value                                                                     | Default       |
/// |--------------------|---------------------------------------------------------------------------|---------------|
/// | `port`             | "/dev/ttyACM0", "/dev/spidev0.0", "simulated": the motor board            | must be there |
/// | `baud`             | [bits/s] of it                                                            | 1000000       |
/// | `seed`             | of a simulated board, a whole number                                      | 1             |
/// | `wheel_angles`     | [angle] four, counter-clockwise from ahead, in the board's order          | 45 135 225 315° |
/// | `wheel_distance`   | [length] from the middle to the wheels                                    | 0.08 m        |
/// | `wheel_radius`     | [length]                                                                  | 0.035 m       |
/// | `wheel_speed`      | [length/s] of the rim: above it, all wheels are slowed by one factor      | 2.5 m/s       |
/// | `ticks`            | edges that the board counts in one turn of a wheel                        | 144           |
/// | `size`             | [length width height]                                                     | 0.18 0.18 0.15 m
/// | | `imu`              | "board", "none", or an i2c-dev such as "/dev/i2c-1" (ADXL345, ITG-3200)   | "board"       |
/// | `imu_mount`        | [angle] roll pitch yaw of the chip's axes in the body, within 20°         | 0 0 0         |
/// | `imu_rest`         | [s] at rest until it is calibrated                                        | 1             |
/// | `vision_sd`        | [length] of a pose that a camera saw                                      | 0.004 m       |
/// | `vision_turn_sd`   | [angle] likewise                                                          | 0.01 rad      |
/// | `vision_age`       | [s] of a pose that does not tell its own                                  | 0.03          |
/// | `vision_stale`     | [s] without a pose: `vision` says so                                      | 0.1           |
/// | `vision_timeout`   | [s] without a pose: position control stops; 0: it never does              | 0.5           |
/// | `vision_lost`      | [s] without a pose: destinations are given up                             | 2             |
/// | `gate`             | standard deviations at which a pose is rejected                           | 4             |
/// | `restart_after`    | rejected poses in a row that are believed after all                       | 8             |
/// | `wheels_sd`        | [length/s] of the velocity that the wheels tell                           | 0.15 m/s      |
/// | `wheels_slip`      | [m/s per m/s²] what acceleration adds to it: by slipping, wheels push     | 0.3           |
/// | `accel_density`    | [m²/s³] how wrong the accelerometer is, as white noise                    | 5e-4          |
/// | `gyro_density`     | [rad²/s] likewise                                                         | 1e-6          |
/// | `gyro_bias_density`| [rad²/s³] of the drift of its bias                                        | 1e-7          |
/// | `speed`, `accel`   | [length/s, /s²] of moves to a pose                                        | 0.6, 1.5 m    |
/// | `turn_speed`, `turn_accel` | [angle/s, /s²] likewise                                           | 2, 6 rad      |
/// | `gain`, `integral` | [1/s, 1/s²] on the distance from the plan                                 | 15, 0         |
/// | `turn_gain`, `turn_integral` | [1/s, 1/s²] on the heading                                      | 10, 0         |
/// | `feed_forward`     | share of the planned velocity that is commanded, 0 to 1                   | 1             |
/// | `command_speed`    | [length/s] of plan and correction together                                | 5/3 `speed`   |
/// | `command_turn`     | [angle/s] likewise                                                        | `turn_speed`  |
/// | `slip`             | [length/s] by which wheels disagree when one slips: they are not believed | 0.2 m/s       |
/// | `kick_speed`, `chip_speed` | [length/s] largest                                                | 6.5, 4 m/s    |
/// | `chip_angle_min`, `chip_angle_max` | above the floor                                           | 30, 60°       |
/// | `dribbler_speed`   | [angle/s] largest                                                         | 300 rad/s     |
/// | `kicker_offset`, `kicker_width` | [length] of the plate                                        | 0.08, 0.08 m  |
class SslRobot final : public Driver {
 public:
  /// The board and the IMU that the `.cfg` names.
  explicit SslRobot(Setup& setup);
  /// With this cable to the board, and this bus to the IMU if it is not the board's. `estimator` is what the `.cfg`
  /// does not say.
  SslRobot(Setup& setup, std::unique_ptr<motor_board::BoardLink> link, std::unique_ptr<I2cBus> bus,
           const control::FieldEstimatorConfig& estimator = {});

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override;
  void close() noexcept override;

 private:
  using Target =
      std::variant<position2d::VelocityCommand, position2d::PositionCommand, position2d::VelocityHeadingCommand>;
  enum class Vision : std::uint8_t { unused, waiting, good, stale, stopped, lost };

  struct Seen {
    Pose2d pose;
    Time captured;
  };

  void take_commands();
  void take_kicks();
  Result<> see(const position2d::VelocityCommand& pose);
  Result<> kick(double speed_mps, double angle_rad);
  Result<Empty> set_odometry(const Pose2d& pose);

  Result<> read_imu(const Tick& tick);
  void estimate(const Tick& tick);
  void read_wheels();
  void fuse(const Seen& seen, Time now);
  void watch_vision(Time now);
  void turn_vision(Vision vision);
  void forget_target();
  [[nodiscard]] bool to_a_pose() const { return std::holds_alternative<position2d::PositionCommand>(target_); }
  [[nodiscard]] Error no_vision() const;
  [[nodiscard]] BodyVelocity plan(const Tick& tick);
  [[nodiscard]] MotorBoardCommand command() const;

  Port<Position2d> base_;
  Port<Position2d> camera_;
  Port<Kicker> kicker_;
  Port<Power> power_;
  Port<Imu> imu_;
  Property<std::string> vision_text_;
  Property<std::int32_t> rejected_;
  Property<std::int32_t> restarts_;
  Property<bool> calibrated_;
  Property<bool> slipping_;
  Property<std::int32_t> refused_;

  // As configured.
  control::Kinematics kinematics_;
  double wheel_radius_m_;
  double wheel_speed_mps_;
  double rim_per_edge_m_;
  double slip_mps_;
  Size3d size_;
  control::FieldEstimatorConfig with_imu_;
  control::FieldEstimatorConfig without_imu_;
  control::ImuCalibrationConfig calibration_config_;
  bool uses_imu_;
  Duration vision_age_;
  Duration vision_stale_;
  Duration vision_timeout_;
  Duration vision_lost_;
  control::TrajectoryTrackerConfig tracker_config_;
  kicker::Limits kick_limits_;
  kicker::Geometry plate_;

  motor_board::BoardClient board_;
  std::optional<ImuChips> chips_;

  // Of the robot, as it seems.
  control::FieldEstimator estimator_;
  control::ImuCalibration imu_calibration_;
  BodyVelocity wheels_;                         ///< as they turned last
  std::optional<MotorBoardTelemetry> counted_;  ///< where `wheels_` starts to count
  std::optional<MotorBoardTelemetry> watched_;  ///< where slip starts to be looked for
  std::optional<Seen> seen_;                    ///< not fused yet
  std::optional<Time> fused_;                   ///< capture of the last pose that was believed
  std::string vision_lost_text_;
  Vision vision_ = Vision::waiting;

  // What it is to do.
  control::TrajectoryTracker tracker_;
  Target target_;
  BodyVelocity command_;
  bool powered_ = true;
  bool charging_ = false;
  bool may_kick_ = true;  ///< not after CHARGE 0, which is also what a stop says, before CHARGE 1
  double dribbler_radps_ = 0;
  std::uint16_t kicks_before_ = 0;  ///< the driver opened
  Duration slow_{};                 ///< since what changes slowly was published
};

/// Of the wheels that the `.cfg` tells of. Throws ConfigError.
control::Kinematics ssl_kinematics(const Section& config);

}  // namespace regista
