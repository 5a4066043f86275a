// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// The kicker and dribbler of a soccer robot. Ours: Player has none, and 67 is its next free code.
namespace regista::kicker {

inline constexpr std::uint16_t code = 67;

struct State {
  float capacitor_v = 0;
  std::uint8_t charged = 0;
  std::uint8_t ball_detected = 0;
  float dribbler_radps = 0;
  std::uint32_t kick_count = 0;

  static constexpr Message message{code, Kind::data, 1, "STATE"};
  static constexpr auto fields =
      Fields{Field<&State::capacitor_v>{"capacitor", "V"}, Field<&State::charged>{"charged", "", "1: ready to kick"},
             Field<&State::ball_detected>{"ball", "", "1: the ball is before the kicker"},
             Field<&State::dribbler_radps>{"dribbler", "rad/s", "measured"},
             Field<&State::kick_count>{"kicks", "", "kicks and chips since the driver opened"}};
  friend bool operator==(const State&, const State&) = default;
};

struct KickCommand {
  float speed_mps = 0;

  static constexpr Message message{code, Kind::command, 1, "KICK", Flow::edge, "kick"};
  static constexpr auto fields = Fields{Field<&KickCommand::speed_mps>{"speed", "m/s", "of the ball"}};
  friend bool operator==(const KickCommand&, const KickCommand&) = default;
};

struct ChipCommand {
  float speed_mps = 0;
  float angle_rad = 0;

  static constexpr Message message{code, Kind::command, 2, "CHIP", Flow::edge, "kick"};
  static constexpr auto fields = Fields{Field<&ChipCommand::speed_mps>{"speed", "m/s", "of the ball"},
                                        Field<&ChipCommand::angle_rad>{"angle", "rad", "above the floor"}};
  friend bool operator==(const ChipCommand&, const ChipCommand&) = default;
};

struct DribblerCommand {
  float speed_radps = 0;

  static constexpr Message message{code, Kind::command, 3, "DRIBBLER", Flow::set_point, "dribbler"};
  static constexpr auto fields =
      Fields{Field<&DribblerCommand::speed_radps>{"speed", "rad/s", "positive holds the ball"}};
  friend bool operator==(const DribblerCommand&, const DribblerCommand&) = default;
};

struct ChargeCommand {
  std::uint8_t on = 0;

  static constexpr Message message{code, Kind::command, 4, "CHARGE", Flow::edge, "kick"};
  static constexpr auto fields = Fields{Field<&ChargeCommand::on>{"state", "", "1: keep the capacitor charged"}};
  friend bool operator==(const ChargeCommand&, const ChargeCommand&) = default;
};

struct Geometry {
  Pose3d pose{};
  Size3d size{};

  static constexpr auto fields =
      Fields{Field<&Geometry::pose>{"pose", "", "of the plate in the robot's frame"}, Field<&Geometry::size>{"size"}};
  friend bool operator==(const Geometry&, const Geometry&) = default;
};

struct Limits {
  float kick_speed_mps = 0;
  float chip_speed_mps = 0;
  float chip_angle_min_rad = 0;
  float chip_angle_max_rad = 0;
  float dribbler_radps = 0;

  static constexpr auto fields = Fields{Field<&Limits::kick_speed_mps>{"kick_speed", "m/s", "largest"},
                                        Field<&Limits::chip_speed_mps>{"chip_speed", "m/s", "largest"},
                                        Field<&Limits::chip_angle_min_rad>{"chip_angle_min", "rad"},
                                        Field<&Limits::chip_angle_max_rad>{"chip_angle_max", "rad"},
                                        Field<&Limits::dribbler_radps>{"dribbler", "rad/s", "largest"}};
  friend bool operator==(const Limits&, const Limits&) = default;
};

struct GetGeometry {
  using Reply = Geometry;
  static constexpr Message message{code, Kind::request, 1, "GET_GEOM"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const GetGeometry&, const GetGeometry&) = default;
};

struct GetLimits {
  using Reply = Limits;
  static constexpr Message message{code, Kind::request, 2, "GET_LIMITS"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const GetLimits&, const GetLimits&) = default;
};

}  // namespace regista::kicker

namespace regista {

struct Kicker {
  static constexpr std::uint16_t code = kicker::code;
  static constexpr std::string_view name = "kicker";
  using Messages = TypeList<kicker::State, kicker::KickCommand, kicker::ChipCommand, kicker::DribblerCommand,
                            kicker::ChargeCommand, kicker::GetGeometry, kicker::GetLimits>;
};

}  // namespace regista
