// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// The requests that a device of any interface answers: its properties by name, and what it can do.
namespace regista::property {

/// A Get request carries an empty value; its answer is the same struct, filled.
template <typename T, std::uint8_t subtype>
struct Get {
  Text key{};
  T value{};

  using Reply = Get;
  static constexpr Message message{any_interface, Kind::request, subtype, "GET_PROPERTY"};
  static constexpr auto fields = Fields{Field<&Get::key>{"key"}, Field<&Get::value>{"value"}};
  friend bool operator==(const Get&, const Get&) = default;
};

/// NACK: no property of this name and type, a value out of range, or one that only the driver may change.
template <typename T, std::uint8_t subtype>
struct Set {
  Text key{};
  T value{};

  using Reply = Empty;
  static constexpr Message message{any_interface, Kind::request, subtype, "SET_PROPERTY"};
  static constexpr auto fields = Fields{Field<&Set::key>{"key"}, Field<&Set::value>{"value"}};
  friend bool operator==(const Set&, const Set&) = default;
};

using GetInt = Get<std::int32_t, 254>;
using SetInt = Set<std::int32_t, 253>;
using GetDouble = Get<double, 252>;
using SetDouble = Set<double, 251>;
using GetText = Get<Text, 250>;
using SetText = Set<Text, 249>;
using GetBool = Get<std::int8_t, 248>;  ///< a C `char` in Player: sign-extended, 0 is false
using SetBool = Set<std::int8_t, 247>;

/// Does the device handle messages of this kind and subtype? ACK: yes. Never send it to a stock server: it crashes.
struct HasCapability {
  std::uint32_t kind = 0;
  std::uint32_t subtype = 0;

  using Reply = Empty;
  static constexpr Message message{any_interface, Kind::request, 255, "CAPABILITIES"};
  static constexpr auto fields = Fields{Field<&HasCapability::kind>{"type"}, Field<&HasCapability::subtype>{"subtype"}};
  friend bool operator==(const HasCapability&, const HasCapability&) = default;
};

using Messages = TypeList<GetInt, SetInt, GetDouble, SetDouble, GetText, SetText, GetBool, SetBool, HasCapability>;

}  // namespace regista::property
