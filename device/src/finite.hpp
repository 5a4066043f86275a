// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <regista/interfaces/messages.hpp>
#include <string>

namespace regista {

/// The first number of a message that is NaN or infinite, as text: "vx = nan". Empty: all are finite.
/// Allocates only when there is one.
template <Described T>
std::string first_not_finite(const T& value) {
  std::string found;
  const auto look = [&](std::string_view name, double number) {
    if (std::isfinite(number)) return;
    found.append(name).append(" = ").append(std::isnan(number) ? "nan" : number > 0 ? "inf" : "-inf");
  };
  for_each_field(value, [&]<typename F>(const F&, const auto& member) {
    if (!found.empty()) return;
    using Member = std::remove_cvref_t<decltype(member)>;
    if constexpr (std::is_floating_point_v<Member>) {
      look(F::name, member);
    } else if constexpr (is_optional<Member>) {
      if (member) look(F::name, *member);
    } else if constexpr (is_vector<Member> || is_array<Member>) {
      for (const auto& element : member) {
        using Element = std::remove_cvref_t<decltype(element)>;
        if constexpr (std::is_floating_point_v<Element>) look(F::name, element);
        if constexpr (Described<Element>) {
          if (found.empty()) found = first_not_finite(element);
        }
      }
    } else if constexpr (Described<Member>) {
      const std::string inner = first_not_finite(member);
      // What the field calls vx, vy, vw: the components of a velocity.
      if (!inner.empty()) found = (std::same_as<Member, BodyVelocity> ? "v" : std::string{F::name} + '.') + inner;
    }
  });
  return found;
}

/// "cmd_vel.vx = nan"; empty: all numbers are finite.
inline std::string first_not_finite(const AnyCommand& command) {
  return std::visit(
      []<typename M>(const M& message) {
        std::string found = first_not_finite(message);
        if (found.empty()) return found;
        std::string name = "cmd_";
        for (const char c : M::message.name) name += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
        return name + '.' + found;
      },
      command);
}

}  // namespace regista
