// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// Bytes that only the driver and its client understand.
namespace regista::opaque {

inline constexpr std::uint16_t code = 51;

struct State {
  std::vector<std::uint8_t> bytes{};

  static constexpr Message message{code, Kind::data, 1, "STATE"};
  static constexpr auto fields = Fields{Field<&State::bytes>{"data"}};
  friend bool operator==(const State&, const State&) = default;
};

struct Command {
  std::vector<std::uint8_t> bytes{};

  static constexpr Message message{code, Kind::command, 1, "DATA", Flow::edge, "opaque"};
  static constexpr auto fields = Fields{Field<&Command::bytes>{"data"}};
  friend bool operator==(const Command&, const Command&) = default;
};

struct Request {
  std::vector<std::uint8_t> bytes{};

  using Reply = Request;
  static constexpr Message message{code, Kind::request, 1, "DATA"};
  static constexpr auto fields = Fields{Field<&Request::bytes>{"data"}};
  friend bool operator==(const Request&, const Request&) = default;
};

}  // namespace regista::opaque

namespace regista {

struct Opaque {
  static constexpr std::uint16_t code = opaque::code;
  static constexpr std::string_view name = "opaque";
  using Messages = TypeList<opaque::State, opaque::Command, opaque::Request>;
};

}  // namespace regista
