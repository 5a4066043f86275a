// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// One axis, linear [m] or rotary [rad].
namespace regista::position1d {

inline constexpr std::uint16_t code = 52;

struct State {
  float position = 0;
  float velocity = 0;
  std::uint8_t stalled = 0;
  std::uint8_t status = 0;

  static constexpr Message message{code, Kind::data, 1, "STATE"};
  static constexpr auto fields = Fields{
      Field<&State::position>{"pos", "m or rad"}, Field<&State::velocity>{"vel", "m/s or rad/s"},
      Field<&State::stalled>{"stall", "", "1: the motor runs but the axis does not move"},
      Field<&State::status>{
          "status", "",
          "bits: 0 minimum, 1 centre, 2 maximum limit switch, 3 over-current, 4 trajectory complete, 5 enabled"}};
  friend bool operator==(const State&, const State&) = default;
};

/// Where the axis is on the robot and how large it is; also published when it changes.
struct Geometry {
  Pose3d pose{};
  Size3d size{};

  static constexpr Message message{code, Kind::data, 2, "GEOM"};
  static constexpr auto fields =
      Fields{Field<&Geometry::pose>{"pose", "", "of the device in the robot's frame"}, Field<&Geometry::size>{"size"}};
  friend bool operator==(const Geometry&, const Geometry&) = default;
};

struct VelocityCommand {
  float velocity = 0;
  std::uint8_t motor_on = 1;

  static constexpr Message message{code, Kind::command, 1, "VEL"};
  static constexpr auto fields = Fields{Field<&VelocityCommand::velocity>{"vel", "m/s or rad/s"},
                                        Field<&VelocityCommand::motor_on>{"state", "", "1: motor on"}};
  friend bool operator==(const VelocityCommand&, const VelocityCommand&) = default;
};

/// Go there, no faster than `velocity`.
struct PositionCommand {
  float position = 0;
  float velocity = 0;
  std::uint8_t motor_on = 1;

  static constexpr Message message{code, Kind::command, 2, "POS"};
  static constexpr auto fields =
      Fields{Field<&PositionCommand::position>{"pos", "m or rad"},
             Field<&PositionCommand::velocity>{"vel", "m/s or rad/s", "limit; 0: the device's own"},
             Field<&PositionCommand::motor_on>{"state", "", "1: motor on"}};
  friend bool operator==(const PositionCommand&, const PositionCommand&) = default;
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

/// The axis is here now.
struct SetOdometry {
  float position = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 5, "SET_ODOM"};
  static constexpr auto fields = Fields{Field<&SetOdometry::position>{"pos", "m or rad"}};
  friend bool operator==(const SetOdometry&, const SetOdometry&) = default;
};

struct ResetOdometry {
  std::uint32_t value = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 6, "RESET_ODOM"};
  static constexpr auto fields = Fields{Field<&ResetOdometry::value>{"value", "", "reserved by Player"}};
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
  float speed = 0;
  float acceleration = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 9, "SPEED_PROF"};
  static constexpr auto fields = Fields{Field<&SetSpeedProfile::speed>{"speed", "m/s or rad/s", "largest"},
                                        Field<&SetSpeedProfile::acceleration>{"acc", "m/s^2 or rad/s^2", "largest"}};
  friend bool operator==(const SetSpeedProfile&, const SetSpeedProfile&) = default;
};

}  // namespace regista::position1d

namespace regista {

struct Position1d {
  static constexpr std::uint16_t code = position1d::code;
  static constexpr std::string_view name = "position1d";
  using Messages =
      TypeList<position1d::State, position1d::Geometry, position1d::VelocityCommand, position1d::PositionCommand,
               position1d::GetGeometry, position1d::SetMotorPower, position1d::SetVelocityMode,
               position1d::SetPositionMode, position1d::SetOdometry, position1d::ResetOdometry, position1d::SetSpeedPid,
               position1d::SetPositionPid, position1d::SetSpeedProfile>;
};

}  // namespace regista
