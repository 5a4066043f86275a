// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace regista::canopen {

/// States of the power drive system, CiA 402-2, 8.4 (figure "PDS finite state automaton").
enum class Cia402State : std::uint8_t {
  not_ready_to_switch_on,
  switch_on_disabled,
  ready_to_switch_on,
  switched_on,
  operation_enabled,
  quick_stop_active,
  fault_reaction_active,
  fault,
};
/// "operation enabled"
std::string to_string(Cia402State state);

/// The state that a statusword (6041) tells; empty if it is none of CiA 402-2, 8.4.2.
std::optional<Cia402State> cia402_state(std::uint16_t statusword);
/// The statusword of a state, nothing else in it.
std::uint16_t cia402_statusword(Cia402State state);

/// Commands of the controlword (6040), CiA 402-2, table "Command coding".
namespace controlword {
inline constexpr std::uint16_t disable_voltage = 0x0000;
inline constexpr std::uint16_t quick_stop = 0x0002;
inline constexpr std::uint16_t shutdown = 0x0006;
inline constexpr std::uint16_t switch_on = 0x0007;
inline constexpr std::uint16_t enable_operation = 0x000F;
inline constexpr std::uint16_t fault_reset = 0x0080;  ///< when it rises
}  // namespace controlword

/// The next command on the way from `state` to operation enabled; a fault is not left this way.
std::uint16_t towards_operation(Cia402State state);
/// The next command on the way from `state` to standstill without voltage: a quick stop comes first.
std::uint16_t towards_rest(Cia402State state);

}  // namespace regista::canopen
