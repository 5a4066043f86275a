// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// A joystick or gamepad.
namespace regista::joystick {

inline constexpr std::uint16_t code = 49;

struct State {
  std::array<std::int32_t, 8> positions{};
  std::array<std::int32_t, 8> scales{};
  std::uint32_t buttons = 0;
  std::uint32_t axis_count = 0;

  static constexpr Message message{code, Kind::data, 1, "STATE"};
  static constexpr auto fields =
      Fields{Field<&State::positions>{"pos", "", "of the axes, in units of `scales`"},
             Field<&State::scales>{"scale", "", "the largest position"},
             Field<&State::buttons>{"buttons", "", "bit 0 is button 0"}, Field<&State::axis_count>{"axes_count"}};
  friend bool operator==(const State&, const State&) = default;
};

}  // namespace regista::joystick

namespace regista {

struct Joystick {
  static constexpr std::uint16_t code = joystick::code;
  static constexpr std::string_view name = "joystick";
  using Messages = TypeList<joystick::State>;
};

}  // namespace regista
