// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/actarray.hpp>
#include <regista/interfaces/aio.hpp>
#include <regista/interfaces/dio.hpp>
#include <regista/interfaces/gps.hpp>
#include <regista/interfaces/imu.hpp>
#include <regista/interfaces/joystick.hpp>
#include <regista/interfaces/kicker.hpp>
#include <regista/interfaces/localize.hpp>
#include <regista/interfaces/opaque.hpp>
#include <regista/interfaces/planner.hpp>
#include <regista/interfaces/player.hpp>
#include <regista/interfaces/position1d.hpp>
#include <regista/interfaces/position2d.hpp>
#include <regista/interfaces/power.hpp>
#include <regista/interfaces/property.hpp>
#include <regista/interfaces/simulation.hpp>
#include <string>
#include <variant>

namespace regista {

/// Every interface that we speak. A new one is a header above and a word here.
using Interfaces = TypeList<Player, Power, Position2d, Gps, Dio, Aio, Localize, Simulation, Planner, Joystick, Opaque,
                            Position1d, Actarray, Imu, Kicker>;

namespace detail {

template <typename... Lists>
struct Concat;
template <typename List>
struct Concat<List> {
  using Type = List;
};
template <typename... As, typename... Bs, typename... Rest>
struct Concat<TypeList<As...>, TypeList<Bs...>, Rest...> : Concat<TypeList<As..., Bs...>, Rest...> {};
// The same for eight at once, which takes the compiler an eighth of the time.
template <typename... As, typename... Bs, typename... Cs, typename... Ds, typename... Es, typename... Fs,
          typename... Gs, typename... Hs, typename... Rest>
struct Concat<TypeList<As...>, TypeList<Bs...>, TypeList<Cs...>, TypeList<Ds...>, TypeList<Es...>, TypeList<Fs...>,
              TypeList<Gs...>, TypeList<Hs...>, Rest...>
    : Concat<TypeList<As..., Bs..., Cs..., Ds..., Es..., Fs..., Gs..., Hs...>, Rest...> {};

template <typename List>
struct MessagesOf;
template <typename... Is>
struct MessagesOf<TypeList<Is...>> : Concat<typename Is::Messages..., property::Messages> {};

template <Kind kind, typename List>
struct OfKind;
template <Kind kind, typename... Ms>
struct OfKind<kind, TypeList<Ms...>>
    : Concat<TypeList<>, std::conditional_t<Ms::message.kind == kind, TypeList<Ms>, TypeList<>>...> {};

template <typename List>
struct VariantOf;
template <typename... Ms>
struct VariantOf<TypeList<Ms...>> {
  using Type = std::variant<Ms...>;
};

template <typename List, typename T>
struct AddUnique;
template <typename... Ts, typename T>
struct AddUnique<TypeList<Ts...>, T>
    : std::conditional<(std::same_as<Ts, T> || ...), TypeList<Ts...>, TypeList<Ts..., T>> {};

template <typename Found, typename Requests>
struct RepliesOf {
  using Type = Found;
};
template <typename Found, typename R, typename... Rest>
struct RepliesOf<Found, TypeList<R, Rest...>>
    : RepliesOf<typename AddUnique<Found, typename R::Reply>::type, TypeList<Rest...>> {};

}  // namespace detail

/// Every message of every interface, the universal requests included.
using AllMessages = detail::MessagesOf<Interfaces>::Type;

namespace detail {

template <Kind kind>
struct MessagesOfKind : OfKind<kind, AllMessages> {};
template <>
struct MessagesOfKind<Kind::ack> : RepliesOf<TypeList<Empty>, typename OfKind<Kind::request, AllMessages>::Type> {};

}  // namespace detail

/// One message of a kind: a std::variant of them all. Copies, moves and the end of one are a table with a function for
/// each message; they are compiled once, in messages.cpp, and not in every file that holds a message.
template <Kind kind>
class Any : public detail::VariantOf<typename detail::MessagesOfKind<kind>::Type>::Type {
 public:
  using Messages = typename detail::MessagesOfKind<kind>::Type;
  using Variant = typename detail::VariantOf<Messages>::Type;
  static constexpr std::size_t size = std::variant_size_v<Variant>;

  using Variant::Variant;
  Any();
  Any(const Any& other);
  Any(Any&& other) noexcept;
  Any& operator=(const Any& other);
  Any& operator=(Any&& other) noexcept;
  ~Any();
};

extern template class Any<Kind::data>;
extern template class Any<Kind::command>;
extern template class Any<Kind::request>;
extern template class Any<Kind::ack>;

using AnyData = Any<Kind::data>;        ///< what comes up from a driver
using AnyCommand = Any<Kind::command>;  ///< what goes down to a driver
using AnyRequest = Any<Kind::request>;  ///< what goes down and wants an answer
using AnyReply = Any<Kind::ack>;        ///< what comes up in answer to a request that succeeded

/// Call `visit.template operator()<M>()` for each message M of a list, until one returns true. Whether one did.
template <typename... Ms, typename Visit>
constexpr bool any_message(TypeList<Ms...>, Visit&& visit) {
  return (visit.template operator()<Ms>() || ...);
}

/// Where M stands in a list that contains it.
template <typename M, typename... Ms>
  requires(std::same_as<M, Ms> || ...)
consteval std::size_t index_in(TypeList<Ms...>) {
  std::size_t i = 0;
  (void)((std::same_as<M, Ms> || (++i, false)) || ...);
  return i;
}

/// Call `visit.template operator()<M>(i)` for each message M of a list, the i-th of it.
template <typename... Ms, typename Visit>
constexpr void for_each_message(TypeList<Ms...>, Visit&& visit) {
  std::size_t i = 0;
  (visit.template operator()<Ms>(i++), ...);
}

/// "position2d" → 4; 0 when we do not speak it.
constexpr std::uint16_t interface_code(std::string_view name) {
  std::uint16_t code = 0;
  any_message(Interfaces{}, [&]<typename I>() { return I::name == name && ((code = I::code), true); });
  return code;
}

/// 4 → "position2d"; empty when we do not speak it.
constexpr std::string_view interface_name(std::uint16_t code) {
  std::string_view name;
  any_message(Interfaces{}, [&]<typename I>() { return I::code == code && ((name = I::name), true); });
  return name;
}

}  // namespace regista
