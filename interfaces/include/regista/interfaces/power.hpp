// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// Battery or supply of a robot.
namespace regista::power {

inline constexpr std::uint16_t code = 2;

/// Which values of a State are measured: the others are to be disregarded.
enum Valid : std::uint32_t { volts = 1, watts = 2, joules = 4, percent = 8, charging = 16 };

struct State {
  std::uint32_t valid = 0;
  float voltage_v = 0;
  float charge_percent = 0;
  float energy_j = 0;
  float power_w = 0;
  std::int32_t charging = 0;

  static constexpr Message message{code, Kind::data, 1, "STATE"};
  static constexpr auto fields =
      Fields{Field<&State::valid>{"valid", "", "bits: 1 volts, 2 watts, 4 joules, 8 percent, 16 charging"},
             Field<&State::voltage_v>{"volts", "V"},
             Field<&State::charge_percent>{"percent", "%"},
             Field<&State::energy_j>{"joules", "J", "left in the battery"},
             Field<&State::power_w>{"watts", "W", "drawn from the battery"},
             Field<&State::charging>{"charging", "", "1 being charged, -1 charging others, 0 neither"}};
  friend bool operator==(const State&, const State&) = default;
};

struct SetChargingPolicy {
  std::uint8_t enable_input = 0;
  std::uint8_t enable_output = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 1, "SET_CHARGING_POLICY"};
  static constexpr auto fields =
      Fields{Field<&SetChargingPolicy::enable_input>{"enable_input", "", "1: may be charged"},
             Field<&SetChargingPolicy::enable_output>{"enable_output", "", "1: may charge others"}};
  friend bool operator==(const SetChargingPolicy&, const SetChargingPolicy&) = default;
};

}  // namespace regista::power

namespace regista {

struct Power {
  static constexpr std::uint16_t code = power::code;
  static constexpr std::string_view name = "power";
  using Messages = TypeList<power::State, power::SetChargingPolicy>;
};

}  // namespace regista
