// SPDX-License-Identifier: Apache-2.0
#include "motor_board.hpp"

#include <algorithm>
#include <numbers>
#include <regista/sim/motor_board.hpp>
#include <utility>

namespace regista {

namespace {

std::unique_ptr<motor_board::BoardLink> link_to_board(const Section& config) {
  const std::string port = config.text("port");
  const auto baud = static_cast<int>(config.integer("baud", 1'000'000, {.min = 1, .max = 100'000'000}));
  if (port == "simulated") return std::make_unique<sim::SimulatedLink>();
  try {
    return motor_board::make_link(port, baud);
  } catch (const std::invalid_argument& wrong) {
    throw config.error("baud", wrong.what());
  }
}

}  // namespace

MotorBoardDriver::MotorBoardDriver(Setup& setup) : MotorBoardDriver{setup, link_to_board(setup.config)} {}

MotorBoardDriver::MotorBoardDriver(Setup& setup, std::unique_ptr<motor_board::BoardLink> link)
    : wheels_{setup.provide<Actarray>()},
      power_{setup.provide<Power>()},
      count_{static_cast<std::size_t>(
          setup.config.integer("wheels", motor_board_wheels, {.min = 1, .max = motor_board_wheels}))},
      rad_per_edge_{2 * std::numbers::pi / setup.config.number("ticks", 144, {.min = 1})},
      fastest_radps_{setup.config.number("wheel_speed", 100, {.min = 1e-3})},
      board_{std::move(link)} {
  state_.actuators.resize(count_);
  wheels_.on<actarray::SpeedCommand>(
      [this](const actarray::SpeedCommand& command) { return set_speed(command.joint, command.speed); });
  wheels_.on<actarray::MultiSpeedCommand>([this](const actarray::MultiSpeedCommand& command) -> Result<> {
    if (command.speeds.size() != count_) {
      return Error{std::errc::invalid_argument, "there are " + std::to_string(count_) + " wheels, and " +
                                                    std::to_string(command.speeds.size()) + " speeds"};
    }
    for (std::size_t i = 0; i < count_; ++i) {
      if (Result<> set = set_speed(static_cast<std::int32_t>(i), command.speeds[i]); !set) return set;
    }
    return {};
  });
  wheels_.on<actarray::SetPower>([this](const actarray::SetPower& request) -> Result<Empty> {
    powered_ = request.on != 0;
    if (!powered_) targets_radps_ = {};
    return Empty{};
  });
  wheels_.on<actarray::GetGeometry>([this](const auto&) -> Result<actarray::Geometry> {
    actarray::Geometry geometry;
    geometry.actuators.resize(
        count_,
        {.type = actarray::ActuatorType::rotary, .axis = {.y = 1}, .speed = static_cast<float>(fastest_radps_)});
    return geometry;
  });
}

Result<> MotorBoardDriver::set_speed(std::int32_t joint, double radps) {
  if (!powered_) return Error{std::errc::operation_not_permitted, "the motors are off: ask for POWER 1"};
  if (joint < -1 || std::cmp_greater_equal(std::max(joint, 0), count_)) {
    return Error{std::errc::invalid_argument, "there is no wheel " + std::to_string(joint) + ", only 0 to " +
                                                  std::to_string(count_ - 1) + ", and -1 for all"};
  }
  const double limited = std::clamp(radps, -fastest_radps_, fastest_radps_);
  if (joint < 0) {
    std::fill_n(targets_radps_.begin(), count_, limited);
  } else {
    targets_radps_[static_cast<std::size_t>(joint)] = limited;
  }
  return {};
}

Result<> MotorBoardDriver::open() {
  before_.reset();
  angles_rad_ = {};
  targets_radps_ = {};
  return board_.open();
}

void MotorBoardDriver::halt() noexcept {
  targets_radps_ = {};
  board_.rest();
}

Result<> MotorBoardDriver::read(const Tick& tick) {
  if (Result<> heard = board_.receive(tick); !heard) return heard;
  const MotorBoardTelemetry& now = board_.telemetry();
  if (board_.received() > 0) {
    for (std::size_t i = 0; before_ && i < count_; ++i) {
      angles_rad_[i] += rad_per_edge_ * motor_board::turned_edges(before_->count[i], now.count[i]);
    }
    before_ = now;
  }
  MotorBoardCommand command{};
  command.flags = powered_ ? motor_board_drive : 0;
  for (std::size_t i = 0; i < count_; ++i) command.wheel_mradps[i] = motor_board::milli(targets_radps_[i]);
  return board_.send(command);
}

void MotorBoardDriver::publish() {
  if (!before_) return;  // the board has said nothing yet
  for (std::size_t i = 0; i < count_; ++i) {
    const bool stalled = (before_->stalled >> i & 1) != 0;
    const bool turns = before_->speed_mradps[i] != 0;
    state_.actuators[i] = {.position = static_cast<float>(angles_rad_[i]),
                           .speed = 1e-3F * static_cast<float>(before_->speed_mradps[i]),
                           .current_a = 1e-3F * before_->current_ma[i],
                           .state = stalled ? actarray::ActuatorState::stalled
                                    : turns ? actarray::ActuatorState::moving
                                            : actarray::ActuatorState::idle};
  }
  state_.motors_on = powered_ ? 1 : 0;
  wheels_.send(state_);
  const float volts = 1e-3F * before_->battery_mv;
  power_.send(power::State{
      .valid = power::volts | power::watts, .voltage_v = volts, .power_w = volts * 0.01F * before_->battery_ca});
}

}  // namespace regista
