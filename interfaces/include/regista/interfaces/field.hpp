// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <regista/core/geometry.hpp>
#include <string_view>
#include <type_traits>
#include <vector>

namespace regista {

inline constexpr std::size_t unlimited = std::numeric_limits<std::size_t>::max();

namespace detail {

template <typename T>
struct MemberPointer;
template <typename Class, typename T>
struct MemberPointer<T Class::*> {
  using Owner = Class;
  using Value = T;
};

/// The name of a member as it is written in the source: C++20 has no reflection, but the compilers spell template
/// arguments out. "… [with auto member = &regista::power::State::volts; …]" (gcc), "… [member = &…::volts]" (clang).
template <auto member>
consteval std::string_view member_name() {
  std::string_view text = __PRETTY_FUNCTION__;
  text.remove_prefix(text.find("member = ") + 9);
  text = text.substr(0, text.find_first_of(";]"));
  return text.substr(text.rfind(':') + 1);
}

}  // namespace detail

/// One field of a message: which member it is, Player's name for it, its unit, and what it says.
/// The order of a struct's fields is their order on the wire.
///
/// The member's type gives the layout: numbers and enums as themselves, structs as their fields, `std::array` without a
/// count, `Text` and `std::vector` with one, `std::optional` for a trailing field that stock Player peers neither send
/// nor read.
template <auto member_pointer>
struct Field {
  using Owner = typename detail::MemberPointer<decltype(member_pointer)>::Owner;
  using Value = typename detail::MemberPointer<decltype(member_pointer)>::Value;
  static constexpr auto member = member_pointer;
  static constexpr std::string_view name = detail::member_name<member_pointer>();  ///< ours: C++, Python, texts

  std::string_view wire_name;         ///< Player's: regista-wire, JSON, the golden vectors
  std::string_view unit;              ///< empty for counts, bits and text
  std::string_view doc;               ///< what the unit cannot say
  std::size_t max_count = unlimited;  ///< of a Text or a vector: Player's buffer is no larger

  constexpr explicit Field(std::string_view wire, std::string_view in = {}, std::string_view says = {},
                           std::size_t at_most = unlimited)
      : wire_name{wire}, unit{in}, doc{says}, max_count{at_most} {}
};

/// A list of Field. Not a std::tuple: with that, messages.hpp took the compiler three times as long. Every field is a
/// type of its own, and so they can all be bases.
template <typename... Fs>
struct Fields : Fs... {
  /// `function(field...)`, in the order of the list.
  template <typename Function>
  constexpr decltype(auto) apply(Function&& function) const {
    return function(static_cast<const Fs&>(*this)...);
  }
};
template <typename... Fs>
Fields(Fs...) -> Fields<Fs...>;

/// The fields of a struct in wire order, said once: encoder, decoder, comparison, text, JSON and test generators read
/// this list. A message carries it as a static member.
template <typename T>
inline constexpr auto fields = nullptr;
template <typename T>
  requires requires { T::fields; }
inline constexpr auto fields<T> = T::fields;

template <typename T>
concept Described = !std::is_null_pointer_v<std::remove_cvref_t<decltype(fields<T>)>>;

template <Described T>
inline constexpr std::size_t field_count = fields<T>.apply([](const auto&... field) { return sizeof...(field); });

/// Call `visit(field, value)` for each field of `object`, in wire order.
template <typename T, typename Visit>
constexpr void for_each_field(T&& object, Visit&& visit) {
  fields<std::remove_cvref_t<T>>.apply([&](const auto&... field) { (visit(field, object.*(field.member)), ...); });
}

template <typename T>
inline constexpr bool is_optional = false;
template <typename T>
inline constexpr bool is_optional<std::optional<T>> = true;

template <typename T>
inline constexpr bool is_array = false;
template <typename T, std::size_t n>
inline constexpr bool is_array<std::array<T, n>> = true;

template <typename T>
inline constexpr bool is_vector = false;
template <typename T>
inline constexpr bool is_vector<std::vector<T>> = true;

// The plain values of core, with Player's names. Player gives a velocity the names of a pose.

template <>
inline constexpr auto fields<Pose2d> =
    Fields{Field<&Pose2d::x>{"px", "m"}, Field<&Pose2d::y>{"py", "m"}, Field<&Pose2d::heading>{"pa", "rad"}};

template <>
inline constexpr auto fields<BodyVelocity> = Fields{
    Field<&BodyVelocity::x>{"px", "m/s"}, Field<&BodyVelocity::y>{"py", "m/s"}, Field<&BodyVelocity::w>{"pa", "rad/s"}};

template <>
inline constexpr auto fields<Point3d> =
    Fields{Field<&Point3d::x>{"px", "m"}, Field<&Point3d::y>{"py", "m"}, Field<&Point3d::z>{"pz", "m"}};

template <>
inline constexpr auto fields<Orientation3d> =
    Fields{Field<&Orientation3d::roll>{"proll", "rad"}, Field<&Orientation3d::pitch>{"ppitch", "rad"},
           Field<&Orientation3d::yaw>{"pyaw", "rad"}};

template <>
inline constexpr auto fields<Pose3d> = Fields{
    Field<&Pose3d::x>{"px", "m"},         Field<&Pose3d::y>{"py", "m"},           Field<&Pose3d::z>{"pz", "m"},
    Field<&Pose3d::roll>{"proll", "rad"}, Field<&Pose3d::pitch>{"ppitch", "rad"}, Field<&Pose3d::yaw>{"pyaw", "rad"}};

template <>
inline constexpr auto fields<Rates3d> =
    Fields{Field<&Rates3d::x>{"px"},       Field<&Rates3d::y>{"py"},         Field<&Rates3d::z>{"pz"},
           Field<&Rates3d::roll>{"proll"}, Field<&Rates3d::pitch>{"ppitch"}, Field<&Rates3d::yaw>{"pyaw"}};

template <>
inline constexpr auto fields<Size3d> =
    Fields{Field<&Size3d::width>{"sw", "m", "along y"}, Field<&Size3d::length>{"sl", "m", "along x"},
           Field<&Size3d::height>{"sh", "m", "along z"}};

}  // namespace regista
