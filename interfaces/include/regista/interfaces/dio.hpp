// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// Digital inputs and outputs.
namespace regista::dio {

inline constexpr std::uint16_t code = 20;

/// The inputs.
struct State {
  std::uint32_t count = 0;
  std::uint32_t bits = 0;

  static constexpr Message message{code, Kind::data, 1, "VALUES"};
  static constexpr auto fields = Fields{Field<&State::count>{"count", "", "how many bits are valid"},
                                        Field<&State::bits>{"bits", "", "bit 0 is input 0"}};
  friend bool operator==(const State&, const State&) = default;
};

struct OutputCommand {
  std::uint32_t count = 0;
  std::uint32_t bits = 0;

  static constexpr Message message{code, Kind::command, 1, "VALUES", Flow::edge, "output"};
  static constexpr auto fields = Fields{Field<&OutputCommand::count>{"count", "", "how many bits are meant"},
                                        Field<&OutputCommand::bits>{"digout", "", "bit 0 is output 0"}};
  friend bool operator==(const OutputCommand&, const OutputCommand&) = default;
};

}  // namespace regista::dio

namespace regista {

struct Dio {
  static constexpr std::uint16_t code = dio::code;
  static constexpr std::string_view name = "dio";
  using Messages = TypeList<dio::State, dio::OutputCommand>;
};

}  // namespace regista
