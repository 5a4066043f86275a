// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// Analogue inputs and outputs.
namespace regista::aio {

inline constexpr std::uint16_t code = 21;

/// The inputs.
struct State {
  std::vector<float> voltages_v{};

  static constexpr Message message{code, Kind::data, 1, "STATE"};
  static constexpr auto fields = Fields{Field<&State::voltages_v>{"voltages", "V"}};
  friend bool operator==(const State&, const State&) = default;
};

struct OutputCommand {
  std::uint32_t channel = 0;
  float voltage_v = 0;

  static constexpr Message message{code, Kind::command, 1, "STATE", Flow::edge, "output"};
  static constexpr auto fields =
      Fields{Field<&OutputCommand::channel>{"id"}, Field<&OutputCommand::voltage_v>{"voltage", "V"}};
  friend bool operator==(const OutputCommand&, const OutputCommand&) = default;
};

}  // namespace regista::aio

namespace regista {

struct Aio {
  static constexpr std::uint16_t code = aio::code;
  static constexpr std::string_view name = "aio";
  using Messages = TypeList<aio::State, aio::OutputCommand>;
};

}  // namespace regista
