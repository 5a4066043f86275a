// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/field.hpp>
#include <regista/interfaces/text.hpp>

namespace regista {

/// What a message is for: the `type` of Player's header.
enum class Kind : std::uint8_t { data = 1, command = 2, request = 3, ack = 4, synch = 5, nack = 6 };

/// How a command may be treated on its way.
enum class Flow : std::uint8_t {
  set_point,  ///< the newest counts: coalesces, at most one a wake-up reaches the driver
  edge,       ///< happens once: never coalesces, never repeats
};

/// What a message struct says of itself, beside its fields. A command says how it flows, and to which of its device's
/// command groups it belongs: whoever owns the group may send it.
struct Message {
  std::uint16_t interface;  ///< Player's interface code; `any_interface` for the requests that every device answers
  Kind kind;
  std::uint8_t subtype;
  std::string_view name;  ///< Player's
  Flow flow = Flow::set_point;
  std::string_view group = "motion";
};

inline constexpr std::uint16_t any_interface = 0;

/// No fields: the reply of a request that only succeeds or fails.
struct Empty {
  static constexpr auto fields = Fields{};
  friend bool operator==(const Empty&, const Empty&) = default;
};

template <typename T>
concept MessageType = Described<T> && std::same_as<std::remove_cvref_t<decltype(T::message)>, Message>;

/// A message that travels as a request; `T::Reply` is the struct of a successful answer.
template <typename T>
concept RequestType = MessageType<T> && T::message.kind == Kind::request && Described<typename T::Reply>;

template <typename T>
concept CommandType = MessageType<T> && T::message.kind == Kind::command;

template <typename T>
concept DataType = MessageType<T> && T::message.kind == Kind::data;

template <typename... Ts>
struct TypeList {
  static constexpr std::size_t size = sizeof...(Ts);
};

/// An interface is its code, its name and its messages; nothing else is written down about it.
template <typename T>
concept InterfaceType = requires {
  { T::code } -> std::convertible_to<std::uint16_t>;
  { T::name } -> std::convertible_to<std::string_view>;
  typename T::Messages;
};

}  // namespace regista
