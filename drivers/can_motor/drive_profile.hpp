// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <regista/canopen/pdo.hpp>
#include <regista/core/time.hpp>
#include <string>
#include <vector>

namespace regista::can_motor {

enum class Profile : std::uint8_t { cia402, sevcon };

/// What a drive measures beside its speed; NaN: it does not, or has not yet.
struct Measured {
  double voltage_v = std::numeric_limits<double>::quiet_NaN();     ///< of the supply
  double supply_a = std::numeric_limits<double>::quiet_NaN();      ///< out of the supply; negative: into it
  double motor_a = std::numeric_limits<double>::quiet_NaN();       ///< of the motor
  double torque_ratio = std::numeric_limits<double>::quiet_NaN();  ///< of rated (CiA 402), of peak (Gen4)
  double motor_c = std::numeric_limits<double>::quiet_NaN();       ///< temperature
  double heatsink_c = std::numeric_limits<double>::quiet_NaN();    ///< temperature
};

/// One value of a PDO that the drive transmits.
struct Reading {
  canopen::ObjectIndex object;
  std::uint8_t bits;
  bool is_signed;
  double scale;  ///< SI per count
  double Measured::* to;
};

/// How drives are to be set up; the same for all of a driver, but for `dcf`. Speeds in the drive's own unit.
struct DriveSettings {
  Profile profile = Profile::cia402;
  std::optional<std::uint32_t> vendor{};                        ///< 1018:01 must be this
  std::optional<std::uint32_t> product{};                       ///< 1018:02 likewise
  bool position = false;                                        ///< it has 6064
  std::uint32_t max_speed = 0;                                  ///< 6080
  std::optional<std::uint32_t> accel{}, decel{}, quick_stop{};  ///< 6083, 6084, 6085 [unit/s]
  std::uint16_t max_torque_permille = 1000;                     ///< 6072
  std::chrono::milliseconds feedback{20};                       ///< between two of a PDO that the drive transmits
};

/// A Gen4's EMCY: fault ids are in bytes 3 and 4, and what is below 0x4800 in them only warns.
[[nodiscard]] std::uint16_t sevcon_fault(const std::array<std::uint8_t, 5>& more);
/// "motor over-temperature cutback", of a Gen4's fault id; empty if it is not known.
[[nodiscard]] std::string sevcon_fault_text(std::uint16_t fault);

/// The set-points: controlword, target velocity, and for a Gen4 the torque limit.
[[nodiscard]] canopen::PdoMapping command_map(Profile profile);
/// Statusword and speed: what a drive must be able to transmit.
[[nodiscard]] canopen::PdoMapping feedback_map(Profile profile);
/// What else it may transmit, a list for each PDO. `rated_a`: of object 6075.
[[nodiscard]] std::vector<std::vector<Reading>> readings(Profile profile, double rated_a);
/// Ramps, limits, mode and target 0, before a drive is started.
[[nodiscard]] std::vector<canopen::SdoWrite> settings_writes(const DriveSettings& settings, canopen::NodeId node);

}  // namespace regista::can_motor
