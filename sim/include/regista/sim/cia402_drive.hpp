// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <regista/canopen/cia402.hpp>
#include <regista/core/time.hpp>

namespace regista::sim {

using canopen::Cia402State;

struct Cia402DriveParameters {
  double max_speed_rpm = 6000;                          ///< 0x6080
  double accel_rpm_per_s = 6000;                        ///< 0x6083
  double decel_rpm_per_s = 6000;                        ///< 0x6084; also of halt
  double quick_stop_rpm_per_s = 20000;                  ///< 0x6085; also of the fault reaction
  double coast_rpm_per_s = 500;                         ///< friction of a drive without torque
  Duration self_test = std::chrono::milliseconds{100};  ///< from power on to switch on disabled
};

/// A drive in profile velocity mode as its master sees it. Its option codes are the defaults of CiA 402-2: quick stop
/// and fault stop on the quick stop ramp and then disable (605A = 2, 605E = 2), shutdown and disabling operation let it
/// coast or ramp (605B = 0, 605C = 1), halt ramps down and stays enabled (605D = 1).
class Cia402Drive {
 public:
  /// Throws std::invalid_argument on a parameter that is not above 0.
  explicit Cia402Drive(const Cia402DriveParameters& parameters);

  /// As a PDO would bring them. The target is cut to max_speed_rpm.
  void write(std::uint16_t controlword, double target_rpm);
  void step(Duration dt);
  /// Other limits and ramps. Throws as the constructor.
  void configure(const Cia402DriveParameters& parameters);
  /// Something broke: the drive brakes and then stays in fault until bit 7 rises.
  void fail(std::uint16_t error_code);

  [[nodiscard]] Cia402State state() const { return state_; }
  [[nodiscard]] std::uint16_t statusword() const;                         ///< 0x6041
  [[nodiscard]] std::uint16_t error_code() const { return error_code_; }  ///< 0x603F; 0: none
  [[nodiscard]] double speed_rpm() const { return speed_rpm_; }
  [[nodiscard]] double turns() const { return turns_; }  ///< since the power came on

 private:
  void ramp(double to_rpm, double rpm_per_s, double dt_s);

  Cia402DriveParameters parameters_;
  Cia402State state_ = Cia402State::not_ready_to_switch_on;
  Duration until_ready_;
  std::uint16_t controlword_ = 0;
  std::uint16_t error_code_ = 0;
  double target_rpm_ = 0;
  double speed_rpm_ = 0;
  double turns_ = 0;
};

}  // namespace regista::sim
