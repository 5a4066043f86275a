// SPDX-License-Identifier: Apache-2.0
#include <regista/canopen/cia402.hpp>

namespace regista::canopen {

using enum Cia402State;

std::string to_string(Cia402State state) {
  switch (state) {
    case not_ready_to_switch_on:
      return "not ready to switch on";
    case switch_on_disabled:
      return "switch on disabled";
    case ready_to_switch_on:
      return "ready to switch on";
    case switched_on:
      return "switched on";
    case operation_enabled:
      return "operation enabled";
    case quick_stop_active:
      return "quick stop active";
    case fault_reaction_active:
      return "fault reaction active";
    case fault:
      return "fault";
  }
  return "?";
}

std::optional<Cia402State> cia402_state(std::uint16_t statusword) {
  switch (statusword & 0x4FU) {
    case 0x00:
      return not_ready_to_switch_on;
    case 0x40:
      return switch_on_disabled;
    case 0x0F:
      return fault_reaction_active;
    case 0x08:
      return fault;
    default:
      break;
  }
  switch (statusword & 0x6FU) {
    case 0x21:
      return ready_to_switch_on;
    case 0x23:
      return switched_on;
    case 0x27:
      return operation_enabled;
    case 0x07:
      return quick_stop_active;
    default:
      return {};
  }
}

std::uint16_t cia402_statusword(Cia402State state) {
  // Bit 4, voltage enabled, is set where power is on; bit 5 is "no quick stop".
  switch (state) {
    case not_ready_to_switch_on:
      return 0x0000;
    case switch_on_disabled:
      return 0x0040;
    case ready_to_switch_on:
      return 0x0031;
    case switched_on:
      return 0x0033;
    case operation_enabled:
      return 0x0037;
    case quick_stop_active:
      return 0x0017;
    case fault_reaction_active:
      return 0x000F;
    case fault:
      return 0x0008;
  }
  return 0;
}

std::uint16_t towards_operation(Cia402State state) {
  switch (state) {
    case switch_on_disabled:
      return controlword::shutdown;
    case ready_to_switch_on:
      return controlword::switch_on;
    case switched_on:
    case operation_enabled:
      return controlword::enable_operation;
    case not_ready_to_switch_on:
    case quick_stop_active:  // some drives stay in it: only without voltage they leave it
    case fault_reaction_active:
    case fault:
      break;
  }
  return controlword::disable_voltage;
}

std::uint16_t towards_rest(Cia402State state) {
  return state == operation_enabled || state == quick_stop_active ? controlword::quick_stop
                                                                  : controlword::disable_voltage;
}

}  // namespace regista::canopen
