// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <regista/sim/cia402_drive.hpp>

#include "require.hpp"

namespace regista::sim {
namespace {

using enum Cia402State;

// Controlword, CiA 402-2, 8.4.1.
constexpr unsigned switch_on = 1, enable_voltage = 2, no_quick_stop = 4, enable_operation = 8, reset = 0x80,
                   halt = 0x100;

}  // namespace

Cia402Drive::Cia402Drive(const Cia402DriveParameters& parameters) : until_ready_{parameters.self_test} {
  configure(parameters);
}

void Cia402Drive::configure(const Cia402DriveParameters& parameters) {
  require_positive("max_speed_rpm", parameters.max_speed_rpm);
  require_positive("accel_rpm_per_s", parameters.accel_rpm_per_s);
  require_positive("decel_rpm_per_s", parameters.decel_rpm_per_s);
  require_positive("quick_stop_rpm_per_s", parameters.quick_stop_rpm_per_s);
  require_positive("coast_rpm_per_s", parameters.coast_rpm_per_s);
  parameters_ = parameters;
}

void Cia402Drive::write(std::uint16_t controlword, double target_rpm) {
  const unsigned word = controlword;
  const bool reset_rises = (word & reset) != 0 && (controlword_ & reset) == 0;
  controlword_ = controlword;
  target_rpm_ = std::clamp(target_rpm, -parameters_.max_speed_rpm, parameters_.max_speed_rpm);

  if (state_ == fault && reset_rises) {
    state_ = switch_on_disabled;
    error_code_ = 0;
  }
  if (state_ == not_ready_to_switch_on || state_ == fault || state_ == fault_reaction_active) return;
  // One command may pass several states, as with most drives: 0x000F from ready to switch on enables operation.
  if ((word & enable_voltage) == 0) {
    state_ = switch_on_disabled;
  } else if ((word & no_quick_stop) == 0) {
    if (state_ == operation_enabled) state_ = quick_stop_active;
    if (state_ == ready_to_switch_on || state_ == switched_on) state_ = switch_on_disabled;
  } else if (state_ == quick_stop_active) {
    return;  // transition 16 is not offered: 605A = 2 leads on to switch on disabled
  } else if ((word & switch_on) == 0) {
    state_ = ready_to_switch_on;
  } else if (state_ != switch_on_disabled) {
    state_ = (word & enable_operation) != 0 ? operation_enabled : switched_on;
  }
}

void Cia402Drive::step(Duration dt) {
  const double dt_s = seconds(dt);
  switch (state_) {
    case not_ready_to_switch_on:
      until_ready_ -= dt;
      if (until_ready_ <= Duration::zero()) state_ = switch_on_disabled;
      break;
    case operation_enabled: {
      const double target = (controlword_ & halt) != 0 ? 0 : target_rpm_;
      const bool faster = std::abs(target) > std::abs(speed_rpm_) && target * speed_rpm_ >= 0;
      ramp(target, faster ? parameters_.accel_rpm_per_s : parameters_.decel_rpm_per_s, dt_s);
      break;
    }
    case quick_stop_active:
      ramp(0, parameters_.quick_stop_rpm_per_s, dt_s);
      if (speed_rpm_ == 0) state_ = switch_on_disabled;
      break;
    case fault_reaction_active:
      ramp(0, parameters_.quick_stop_rpm_per_s, dt_s);
      if (speed_rpm_ == 0) state_ = fault;
      break;
    case switched_on:
      ramp(0, parameters_.decel_rpm_per_s, dt_s);
      break;
    case switch_on_disabled:
    case ready_to_switch_on:
    case fault:
      ramp(0, parameters_.coast_rpm_per_s, dt_s);
      break;
  }
}

void Cia402Drive::fail(std::uint16_t error_code) {
  error_code_ = error_code;
  state_ = fault_reaction_active;
}

std::uint16_t Cia402Drive::statusword() const {
  // CiA 402-2, 8.4.2. Bit 9 remote; 10 target reached; 12 in profile velocity mode: speed is 0.
  unsigned word = 0x0200U | canopen::cia402_statusword(state_);
  const double target = (controlword_ & halt) != 0 ? 0 : target_rpm_;
  if (state_ == operation_enabled && speed_rpm_ == target) word |= 0x0400;
  if (speed_rpm_ == 0) word |= 0x1000;
  return static_cast<std::uint16_t>(word);
}

void Cia402Drive::ramp(double to_rpm, double rpm_per_s, double dt_s) {
  const double before_rpm = speed_rpm_;
  const double ramp_s = std::min(dt_s, std::abs(to_rpm - speed_rpm_) / rpm_per_s);
  speed_rpm_ += std::clamp(to_rpm - speed_rpm_, -rpm_per_s * dt_s, rpm_per_s * dt_s);
  turns_ += ((before_rpm + speed_rpm_) / 2 * ramp_s + speed_rpm_ * (dt_s - ramp_s)) / 60;
}

}  // namespace regista::sim
