// SPDX-License-Identifier: Apache-2.0
#include "drive_profile.hpp"

#include <algorithm>

namespace regista::can_motor {

using canopen::sdo_write;

std::uint16_t sevcon_fault(const std::array<std::uint8_t, 5>& more) {
  return static_cast<std::uint16_t>(more[0] | more[1] << 8);
}

std::string sevcon_fault_text(std::uint16_t fault) {
  struct Known {
    std::uint16_t fault;
    const char* text;
  };
  constexpr std::array known{
      Known{0x4602, "too hot"},
      Known{0x4603, "motor cut back"},
      Known{0x4681, "unit in pre-operational"},
      Known{0x4682, "inputs and outputs cannot be initialised"},
      Known{0x4683, "no set-points in time (warning)"},
      Known{0x4A81, "no set-points in time (drive inhibited)"},
      Known{0x4B01, "bus-off"},
      Known{0x4D43, "stalled"},
      Known{0x4E81, "no set-points in time (severe)"},
      Known{0x5101, "line contactor"},
      Known{0x5102, "line contactor"},
      Known{0x51C2, "pre-charge"},
      Known{0x5201, "heatsink temperature"},
      Known{0x52C1, "encoder"},
      Known{0x52C2, "over-current"},
      Known{0x52C3, "current control"},
      Known{0x52C4, "over-speed"},
      Known{0x5301, "CAN fault"},
      Known{0x5308, "bus-off"},
      Known{0x530A, "a PDO is too short"},
      Known{0x530B, "heartbeat of the master lost"},
      Known{0x530C, "wrong NMT state"},
      Known{0x530F, "SDO timed out"},
  };
  const auto* const found = std::ranges::find(known, fault, &Known::fault);
  return found == known.end() ? std::string{} : found->text;
}

canopen::PdoMapping command_map(Profile profile) {
  if (profile == Profile::sevcon) return {{{0x6040, 0}, 16}, {{0x60FF, 0}, 32}, {{0x6072, 0}, 16}};
  return {{{0x6040, 0}, 16}, {{0x60FF, 0}, 32}};
}

canopen::PdoMapping feedback_map(Profile /*profile*/) { return {{{0x6041, 0}, 16}, {{0x606C, 0}, 32}}; }

std::vector<std::vector<Reading>> readings(Profile profile, double rated_a) {
  if (profile == Profile::cia402) {
    return {{{{0x6079, 0}, 32, false, 1e-3, &Measured::voltage_v},
             {{0x6078, 0}, 16, true, 1e-3 * rated_a, &Measured::motor_a},
             {{0x6077, 0}, 16, true, 1e-3, &Measured::torque_ratio}}};
  }
  return {{{{0x5100, 1}, 16, false, 0.0625, &Measured::voltage_v},
           {{0x5100, 2}, 16, true, 0.0625, &Measured::supply_a},
           {{0x5100, 4}, 8, true, 1, &Measured::heatsink_c},
           {{0x4600, 3}, 16, true, 1, &Measured::motor_c}},
          {{{0x6078, 0}, 16, true, 1, &Measured::motor_a}, {{0x6077, 0}, 16, true, 1e-3, &Measured::torque_ratio}}};
}

std::vector<canopen::SdoWrite> settings_writes(const DriveSettings& settings, canopen::NodeId node) {
  std::vector<canopen::SdoWrite> writes;
  if (settings.profile == Profile::sevcon) {
    writes.push_back(sdo_write<std::uint32_t>({0x1005, 0}, 0x80));  // a Gen4 produces SYNC by itself
    writes.push_back(sdo_write<std::uint32_t>({0x1014, 0}, 0x80U + node));
  }
  writes.push_back(sdo_write<std::uint8_t>({0x6060, 0}, 3));  // profile velocity
  // Many drives lack one of these; what is commanded is limited here as well.
  const auto add_optional = [&](canopen::SdoWrite write) {
    write.optional = true;
    writes.push_back(std::move(write));
  };
  writes.push_back(sdo_write<std::uint16_t>({0x6072, 0}, settings.max_torque_permille));
  writes.back().optional = settings.max_torque_permille == 1000;  // that is all it has
  if (settings.max_speed > 0) add_optional(sdo_write<std::uint32_t>({0x6080, 0}, settings.max_speed));
  if (settings.accel) writes.push_back(sdo_write<std::uint32_t>({0x6083, 0}, *settings.accel));
  if (settings.decel) writes.push_back(sdo_write<std::uint32_t>({0x6084, 0}, *settings.decel));
  if (settings.quick_stop) writes.push_back(sdo_write<std::uint32_t>({0x6085, 0}, *settings.quick_stop));
  // 2, the ramp of a quick stop and then no voltage, is also what a drive without 605A does (CiA 402-2, 8.6.3).
  if (settings.profile == Profile::cia402) add_optional(sdo_write<std::int16_t>({0x605A, 0}, 2));
  // A target that another mode refused, or that another master left behind.
  writes.push_back(sdo_write<std::int32_t>({0x60FF, 0}, 0));
  for (canopen::SdoWrite& write : writes) write.only_if_different = true;
  return writes;
}

}  // namespace regista::can_motor
