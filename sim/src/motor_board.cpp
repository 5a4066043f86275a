// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <regista/sim/motor_board.hpp>

#include "require.hpp"

namespace regista::sim {

namespace {

using namespace std::chrono_literals;

constexpr Duration firmware_period = 1ms;
constexpr double gravity_mps2 = 9.80665;
constexpr double dribbler_s = 0.1;  // of its answer

template <typename Integer>
Integer rounded(double value) {
  using Limits = std::numeric_limits<Integer>;
  return static_cast<Integer>(
      std::lround(std::clamp(value, static_cast<double>(Limits::min()), static_cast<double>(Limits::max()))));
}

/// One frame starts all wheels together.
WheeledRobotParameters on_one_board(WheeledRobotParameters robot) {
  robot.hop_s = 0;
  return robot;
}

}  // namespace

MotorBoard::MotorBoard(const MotorBoardParameters& parameters)
    : parameters_{parameters}, robot_{on_one_board(parameters.robot)}, imu_{parameters.imu} {
  require(parameters.robot.wheels.size() == motor_board_wheels, "robot.wheels",
          static_cast<double>(parameters.robot.wheels.size()), "give four");
  require_positive("charge_s", parameters.charge_s);
  require_positive("full_v", parameters.full_v);
  require_positive("kick_mps", parameters.kick_mps);
  motor_board_start(&firmware_);
}

void MotorBoard::step(Duration dt) {
  for (carried_ += dt; carried_ >= firmware_period; carried_ -= firmware_period) {
    now_ += firmware_period;
    run_firmware();
    const auto& state = robot_.step(firmware_period);
    accel_x_sum_ += state.accel_x_mps2 * seconds(firmware_period);
    accel_y_sum_ += state.accel_y_mps2 * seconds(firmware_period);
    if ((firmware_.command.flags & motor_board_charge) != 0) {
      charge_ = std::min(1.0, charge_ + seconds(firmware_period) / parameters_.charge_s);
    }
    dribbler_radps_ +=
        -std::expm1(-seconds(firmware_period) / dribbler_s) * (firmware_.command.dribbler_radps - dribbler_radps_);
  }
}

/// The main loop of board.h.
void MotorBoard::run_firmware() {
  const auto now_us = static_cast<std::uint32_t>(now_ / 1us);
  bool answers = false;
  for (const std::uint8_t byte : input_) answers = motor_board_take(&firmware_, byte, now_us) || answers;
  input_.clear();
  measure();
  motor_board_tick(&firmware_, now_us);
  std::array<double, motor_board_wheels> wheels{};
  const bool driving = (firmware_.command.flags & motor_board_drive) != 0;
  for (std::size_t i = 0; driving && i < wheels.size(); ++i) wheels[i] = 1e-3 * firmware_.command.wheel_mradps[i];
  robot_.command(wheels);
  if (motor_board_take_kick(&firmware_, charge_ >= 1)) {
    const double share = 1e-3 * firmware_.command.kick_speed_mmps / parameters_.kick_mps;
    charge_ -= std::min(1.0, share * share);
    ball_ = false;
  }
  if (answers) answer();
}

void MotorBoard::measure() {
  MotorBoardTelemetry& telemetry = firmware_.telemetry;
  telemetry.status =
      static_cast<std::uint8_t>((charge_ >= 1 ? motor_board_charged : 0) | (ball_ ? motor_board_ball : 0) |
                                (parameters_.has_imu ? motor_board_imu : 0));
  for (std::size_t i = 0; i < motor_board_wheels; ++i) {
    const auto& wheel = robot_.state().wheels[i];
    telemetry.count[i] = static_cast<std::int32_t>(static_cast<std::uint32_t>(wheel.count));
    telemetry.speed_mradps[i] = rounded<std::int32_t>(1000 * wheel.measured_radps);
    telemetry.current_ma[i] = rounded<std::int16_t>(1000 * wheel.motor_a);
  }
  telemetry.battery_mv = rounded<std::uint16_t>(1000 * robot_.battery().voltage_v());
  telemetry.battery_ca = rounded<std::int16_t>(100 * robot_.battery().current_a());
  telemetry.capacitor_dv = rounded<std::uint16_t>(10 * parameters_.full_v * std::sqrt(charge_));
  telemetry.dribbler_radps = rounded<std::int16_t>(dribbler_radps_);
}

void MotorBoard::answer() {
  const double dt_s = seconds(now_ - std::exchange(answered_, now_));
  const double heading = robot_.state().pose.heading;
  if (parameters_.has_imu && dt_s > 0) {
    const double rate = angle_between(std::exchange(answered_heading_, heading), heading) / dt_s;
    const auto reading = imu_.read(accel_x_sum_ / dt_s, accel_y_sum_ / dt_s, rate, dt_s);
    MotorBoardTelemetry& telemetry = firmware_.telemetry;
    telemetry.accel_mmps2[0] = rounded<std::int16_t>(1000 * reading.accel_x_mps2);
    telemetry.accel_mmps2[1] = rounded<std::int16_t>(1000 * reading.accel_y_mps2);
    telemetry.accel_mmps2[2] = rounded<std::int16_t>(1000 * gravity_mps2);
    telemetry.rate_mradps[2] = rounded<std::int16_t>(1000 * reading.rate_radps);
  }
  accel_x_sum_ = accel_y_sum_ = 0;
  std::array<std::uint8_t, motor_board_telemetry_size> frame{};
  const std::size_t size = motor_board_answer(&firmware_, static_cast<std::uint32_t>(now_ / 1us), frame.data());
  output_.insert(output_.end(), frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(size));
}

std::size_t MotorBoard::transmit(std::span<std::uint8_t> bytes) {
  const std::size_t count = std::min(bytes.size(), output_.size());
  std::copy_n(output_.begin(), count, bytes.begin());
  output_.erase(output_.begin(), output_.begin() + static_cast<std::ptrdiff_t>(count));
  return count;
}

}  // namespace regista::sim
