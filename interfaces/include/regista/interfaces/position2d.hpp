// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// A base that moves in the plane.
namespace regista::position2d {

inline constexpr std::uint16_t code = 4;

/// Odometry: the pose in the odometry frame and the velocity of the body.
struct State {
  Pose2d pose{};
  BodyVelocity velocity{};
  std::uint8_t stalled = 0;

  static constexpr Message message{code, Kind::data, 1, "STATE"};
  static constexpr auto fields =
      Fields{Field<&State::pose>{"pos", "", "in the odometry frame"}, Field<&State::velocity>{"vel", "", "of the body"},
             Field<&State::stalled>{"stall", "", "1: the motors run but the base does not move"}};
  friend bool operator==(const State&, const State&) = default;
};

/// Where the base is on the robot and how large it is; also published when it changes.
struct Geometry {
  Pose3d pose{};
  Size3d size{};

  static constexpr Message message{code, Kind::data, 2, "GEOM"};
  static constexpr auto fields =
      Fields{Field<&Geometry::pose>{"pose", "", "of the device in the robot's frame"}, Field<&Geometry::size>{"size"}};
  friend bool operator==(const Geometry&, const Geometry&) = default;
};

/// Drive at this velocity. On a device of role `sensor` it is a measured pose instead, and `age_s` tells how old.
struct VelocityCommand {
  BodyVelocity velocity{};
  std::uint8_t motors_on = 1;
  std::optional<double> age_s{};

  static constexpr Message message{code, Kind::command, 1, "VEL"};
  static constexpr auto fields =
      Fields{Field<&VelocityCommand::velocity>{"vel"}, Field<&VelocityCommand::motors_on>{"state", "", "1: motors on"},
             Field<&VelocityCommand::age_s>{"age", "s", "since the measurement was taken"}};
  friend bool operator==(const VelocityCommand&, const VelocityCommand&) = default;
};

/// Go to this pose, no faster than `velocity`.
struct PositionCommand {
  Pose2d pose{};
  BodyVelocity velocity{};
  std::uint8_t motors_on = 1;

  static constexpr Message message{code, Kind::command, 2, "POS"};
  static constexpr auto fields = Fields{Field<&PositionCommand::pose>{"pos", "", "in the odometry frame"},
                                        Field<&PositionCommand::velocity>{"vel", "", "limits; 0: the device's own"},
                                        Field<&PositionCommand::motors_on>{"state", "", "1: motors on"}};
  friend bool operator==(const PositionCommand&, const PositionCommand&) = default;
};

/// Drive like a car.
struct CarCommand {
  double speed_mps = 0;
  double steering_rad = 0;

  static constexpr Message message{code, Kind::command, 3, "CAR"};
  static constexpr auto fields = Fields{Field<&CarCommand::speed_mps>{"velocity", "m/s", "ahead"},
                                        Field<&CarCommand::steering_rad>{"angle", "rad", "counter-clockwise"}};
  friend bool operator==(const CarCommand&, const CarCommand&) = default;
};

/// Drive ahead while turning to a heading. On a device of role `sensor` it is a kick: speed and chip angle.
struct VelocityHeadingCommand {
  double speed_mps = 0;
  double heading_rad = 0;

  static constexpr Message message{code, Kind::command, 4, "VEL_HEAD"};
  static constexpr auto fields =
      Fields{Field<&VelocityHeadingCommand::speed_mps>{"velocity", "m/s", "ahead"},
             Field<&VelocityHeadingCommand::heading_rad>{"angle", "rad", "in the odometry frame"}};
  friend bool operator==(const VelocityHeadingCommand&, const VelocityHeadingCommand&) = default;
};

struct GetGeometry {
  using Reply = Geometry;
  static constexpr Message message{code, Kind::request, 1, "GET_GEOM"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const GetGeometry&, const GetGeometry&) = default;
};

struct SetMotorPower {
  std::uint8_t on = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 2, "MOTOR_POWER"};
  static constexpr auto fields = Fields{Field<&SetMotorPower::on>{"state", "", "1: on"}};
  friend bool operator==(const SetMotorPower&, const SetMotorPower&) = default;
};

struct SetVelocityMode {
  std::uint32_t value = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 3, "VELOCITY_MODE"};
  static constexpr auto fields = Fields{Field<&SetVelocityMode::value>{"value", "", "driver specific"}};
  friend bool operator==(const SetVelocityMode&, const SetVelocityMode&) = default;
};

struct SetPositionMode {
  std::uint32_t position = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 4, "POSITION_MODE"};
  static constexpr auto fields =
      Fields{Field<&SetPositionMode::position>{"state", "", "0: velocity control, 1: position control"}};
  friend bool operator==(const SetPositionMode&, const SetPositionMode&) = default;
};

/// The base is here now.
struct SetOdometry {
  Pose2d pose{};

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 5, "SET_ODOM"};
  static constexpr auto fields = Fields{Field<&SetOdometry::pose>{"pose", "", "in the odometry frame"}};
  friend bool operator==(const SetOdometry&, const SetOdometry&) = default;
};

/// The base is at the origin of its odometry frame now.
struct ResetOdometry {
  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 6, "RESET_ODOM"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const ResetOdometry&, const ResetOdometry&) = default;
};

struct SetSpeedPid {
  float kp = 0;
  float ki = 0;
  float kd = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 7, "SPEED_PID"};
  static constexpr auto fields =
      Fields{Field<&SetSpeedPid::kp>{"kp"}, Field<&SetSpeedPid::ki>{"ki"}, Field<&SetSpeedPid::kd>{"kd"}};
  friend bool operator==(const SetSpeedPid&, const SetSpeedPid&) = default;
};

struct SetPositionPid {
  float kp = 0;
  float ki = 0;
  float kd = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 8, "POSITION_PID"};
  static constexpr auto fields =
      Fields{Field<&SetPositionPid::kp>{"kp"}, Field<&SetPositionPid::ki>{"ki"}, Field<&SetPositionPid::kd>{"kd"}};
  friend bool operator==(const SetPositionPid&, const SetPositionPid&) = default;
};

struct SetSpeedProfile {
  float speed_mps = 0;
  float acceleration_mps2 = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 9, "SPEED_PROF"};
  static constexpr auto fields = Fields{Field<&SetSpeedProfile::speed_mps>{"speed", "m/s", "largest"},
                                        Field<&SetSpeedProfile::acceleration_mps2>{"acc", "m/s^2", "largest"}};
  friend bool operator==(const SetSpeedProfile&, const SetSpeedProfile&) = default;
};

}  // namespace regista::position2d

namespace regista {

struct Position2d {
  static constexpr std::uint16_t code = position2d::code;
  static constexpr std::string_view name = "position2d";
  using Messages = TypeList<position2d::State, position2d::Geometry, position2d::VelocityCommand,
                            position2d::PositionCommand, position2d::CarCommand, position2d::VelocityHeadingCommand,
                            position2d::GetGeometry, position2d::SetMotorPower, position2d::SetVelocityMode,
                            position2d::SetPositionMode, position2d::SetOdometry, position2d::ResetOdometry,
                            position2d::SetSpeedPid, position2d::SetPositionPid, position2d::SetSpeedProfile>;
};

}  // namespace regista
