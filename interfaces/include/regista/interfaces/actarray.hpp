// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// Several actuators that move together: the joints of an arm, the wheels of a base.
namespace regista::actarray {

inline constexpr std::uint16_t code = 53;

/// Of one actuator.
enum class ActuatorState : std::uint8_t { idle = 1, moving = 2, braked = 3, stalled = 4 };
enum class ActuatorType : std::uint8_t { linear = 1, rotary = 2 };

struct Actuator {
  float position = 0;
  float speed = 0;
  float acceleration = 0;
  float current_a = 0;
  ActuatorState state{};

  static constexpr auto fields = Fields{
      Field<&Actuator::position>{"position", "m or rad"}, Field<&Actuator::speed>{"speed", "m/s or rad/s"},
      Field<&Actuator::acceleration>{"acceleration", "m/s^2 or rad/s^2"}, Field<&Actuator::current_a>{"current", "A"},
      Field<&Actuator::state>{"state", "", "1 idle, 2 moving, 3 braked, 4 stalled"}};
  friend bool operator==(const Actuator&, const Actuator&) = default;
};

struct State {
  std::vector<Actuator> actuators{};
  std::uint8_t motors_on = 0;

  static constexpr Message message{code, Kind::data, 1, "STATE"};
  static constexpr auto fields = Fields{Field<&State::actuators>{"actuators"}, Field<&State::motors_on>{"motor_state"}};
  friend bool operator==(const State&, const State&) = default;
};

struct ActuatorGeometry {
  ActuatorType type{};
  float length_m = 0;
  Orientation3d orientation{};
  Point3d axis{};
  float min = 0;
  float centre = 0;
  float max = 0;
  float home = 0;
  float speed = 0;
  std::uint8_t has_brakes = 0;

  static constexpr auto fields = Fields{Field<&ActuatorGeometry::type>{"type", "", "1 linear, 2 rotary"},
                                        Field<&ActuatorGeometry::length_m>{"length", "m"},
                                        Field<&ActuatorGeometry::orientation>{"orientation"},
                                        Field<&ActuatorGeometry::axis>{"axis", "", "of motion"},
                                        Field<&ActuatorGeometry::min>{"min", "m or rad"},
                                        Field<&ActuatorGeometry::centre>{"centre", "m or rad"},
                                        Field<&ActuatorGeometry::max>{"max", "m or rad"},
                                        Field<&ActuatorGeometry::home>{"home", "m or rad"},
                                        Field<&ActuatorGeometry::speed>{"config_speed", "m/s or rad/s", "largest"},
                                        Field<&ActuatorGeometry::has_brakes>{"hasbrakes"}};
  friend bool operator==(const ActuatorGeometry&, const ActuatorGeometry&) = default;
};

struct Geometry {
  std::vector<ActuatorGeometry> actuators{};
  Point3d base_position{};
  Orientation3d base_orientation{};

  static constexpr auto fields =
      Fields{Field<&Geometry::actuators>{"actuators"}, Field<&Geometry::base_position>{"base_pos"},
             Field<&Geometry::base_orientation>{"base_orientation"}};
  friend bool operator==(const Geometry&, const Geometry&) = default;
};

struct PositionCommand {
  std::int32_t joint = 0;
  float position = 0;

  static constexpr Message message{code, Kind::command, 1, "POS"};
  static constexpr auto fields = Fields{Field<&PositionCommand::joint>{"joint", "", "-1: all"},
                                        Field<&PositionCommand::position>{"position", "m or rad"}};
  friend bool operator==(const PositionCommand&, const PositionCommand&) = default;
};

struct MultiPositionCommand {
  std::vector<float> positions{};

  static constexpr Message message{code, Kind::command, 2, "MULTI_POS"};
  static constexpr auto fields = Fields{Field<&MultiPositionCommand::positions>{"positions", "m or rad"}};
  friend bool operator==(const MultiPositionCommand&, const MultiPositionCommand&) = default;
};

struct SpeedCommand {
  std::int32_t joint = 0;
  float speed = 0;

  static constexpr Message message{code, Kind::command, 3, "SPEED"};
  static constexpr auto fields =
      Fields{Field<&SpeedCommand::joint>{"joint", "", "-1: all"}, Field<&SpeedCommand::speed>{"speed", "m/s or rad/s"}};
  friend bool operator==(const SpeedCommand&, const SpeedCommand&) = default;
};

struct MultiSpeedCommand {
  std::vector<float> speeds{};

  static constexpr Message message{code, Kind::command, 4, "MULTI_SPEED"};
  static constexpr auto fields = Fields{Field<&MultiSpeedCommand::speeds>{"speeds", "m/s or rad/s"}};
  friend bool operator==(const MultiSpeedCommand&, const MultiSpeedCommand&) = default;
};

struct HomeCommand {
  std::int32_t joint = 0;

  static constexpr Message message{code, Kind::command, 5, "HOME", Flow::edge};
  static constexpr auto fields = Fields{Field<&HomeCommand::joint>{"joint", "", "-1: all"}};
  friend bool operator==(const HomeCommand&, const HomeCommand&) = default;
};

struct CurrentCommand {
  std::int32_t joint = 0;
  float current_a = 0;

  static constexpr Message message{code, Kind::command, 6, "CURRENT"};
  static constexpr auto fields =
      Fields{Field<&CurrentCommand::joint>{"joint", "", "-1: all"}, Field<&CurrentCommand::current_a>{"current", "A"}};
  friend bool operator==(const CurrentCommand&, const CurrentCommand&) = default;
};

struct MultiCurrentCommand {
  std::vector<float> currents_a{};

  static constexpr Message message{code, Kind::command, 7, "MULTI_CURRENT"};
  static constexpr auto fields = Fields{Field<&MultiCurrentCommand::currents_a>{"currents", "A"}};
  friend bool operator==(const MultiCurrentCommand&, const MultiCurrentCommand&) = default;
};

struct SetPower {
  std::uint8_t on = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 1, "POWER"};
  static constexpr auto fields = Fields{Field<&SetPower::on>{"value", "", "1: on"}};
  friend bool operator==(const SetPower&, const SetPower&) = default;
};

struct SetBrakes {
  std::uint8_t on = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 2, "BRAKES"};
  static constexpr auto fields = Fields{Field<&SetBrakes::on>{"value", "", "1: on"}};
  friend bool operator==(const SetBrakes&, const SetBrakes&) = default;
};

struct GetGeometry {
  using Reply = Geometry;
  static constexpr Message message{code, Kind::request, 3, "GET_GEOM"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const GetGeometry&, const GetGeometry&) = default;
};

/// The speed of later position commands.
struct SetSpeed {
  std::int32_t joint = 0;
  float speed = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 4, "SPEED"};
  static constexpr auto fields =
      Fields{Field<&SetSpeed::joint>{"joint", "", "-1: all"}, Field<&SetSpeed::speed>{"speed", "m/s or rad/s"}};
  friend bool operator==(const SetSpeed&, const SetSpeed&) = default;
};

struct SetAcceleration {
  std::int32_t joint = 0;
  float acceleration = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 5, "ACCEL"};
  static constexpr auto fields = Fields{Field<&SetAcceleration::joint>{"joint", "", "-1: all"},
                                        Field<&SetAcceleration::acceleration>{"accel", "m/s^2 or rad/s^2"}};
  friend bool operator==(const SetAcceleration&, const SetAcceleration&) = default;
};

}  // namespace regista::actarray

namespace regista {

struct Actarray {
  static constexpr std::uint16_t code = actarray::code;
  static constexpr std::string_view name = "actarray";
  using Messages = TypeList<actarray::State, actarray::PositionCommand, actarray::MultiPositionCommand,
                            actarray::SpeedCommand, actarray::MultiSpeedCommand, actarray::HomeCommand,
                            actarray::CurrentCommand, actarray::MultiCurrentCommand, actarray::SetPower,
                            actarray::SetBrakes, actarray::GetGeometry, actarray::SetSpeed, actarray::SetAcceleration>;
};

}  // namespace regista
