// SPDX-License-Identifier: Apache-2.0
#include "simulated_battery.hpp"

#include <algorithm>
#include <cmath>

namespace regista {

namespace {

sim::BatteryParameters read_parameters(const Section& config) {
  const double empty_v = config.number("empty_voltage", 9.9, {.min = 0.1});
  return {.full_v = config.number("full_voltage", std::max(12.6, empty_v), {.min = empty_v}),
          .empty_v = empty_v,
          .capacity_ah = config.number("capacity", 2.2, {.min = 1e-3}),
          .resistance_ohm = config.number("resistance", 0.05, {.min = 0})};
}

/// What is left, at open circuit: the integral over the charge of a voltage that falls in a line.
double energy_j(const sim::BatteryParameters& battery, double charge) {
  const double mean_v = battery.empty_v + charge / 2 * (battery.full_v - battery.empty_v);
  return 3600 * battery.capacity_ah * charge * mean_v;
}

}  // namespace

SimulatedBattery::SimulatedBattery(Setup& setup)
    : port_{setup.provide<Power>()},
      parameters_{read_parameters(setup.config)},
      battery_{parameters_},
      idle_power_w_{setup.config.number("idle_power", 10, {.min = 0})},
      drive_power_w_per_mps_{setup.config.number("drive_power", 40, {.min = 0})},
      charging_power_w_{setup.config.number("charging_power", 60, {.min = 0})} {
  const double charge = setup.config.number("charge", 100, {.min = 0, .max = 100}) / 100;
  battery_.draw((1 - charge) * parameters_.capacity_ah, std::chrono::hours{1});

  if (setup.config.has("requires")) {
    base_ = setup.require<Position2d>();
    base_->on_data<position2d::State>(
        [this](const position2d::State& state, Time) { speed_mps_ = std::hypot(state.velocity.x, state.velocity.y); });
  }
  port_.on<power::SetChargingPolicy>([this](const power::SetChargingPolicy& policy) -> Result<Empty> {
    if (policy.enable_output != 0) {
      return Error{std::errc::not_supported, "this battery cannot charge others: ask for enable_output 0"};
    }
    charging_ = policy.enable_input != 0;
    return Empty{};
  });
}

Result<> SimulatedBattery::read(const Tick& tick) {
  double power_w = idle_power_w_ + drive_power_w_per_mps_ * speed_mps_;
  if (charging_ && battery_.charge_ratio() < 1) power_w -= charging_power_w_;
  if (battery_.charge_ratio() == 0) power_w = std::min(power_w, 0.0);  // nothing left to draw
  // The voltage of the step before: exact would be the root of a quadratic, and the steps are short.
  battery_.draw(power_w / std::max(battery_.voltage_v(), 1.0), tick.dt);
  return {};
}

void SimulatedBattery::publish() {
  const double charge = battery_.charge_ratio();
  port_.send(power::State{
      .valid = power::volts | power::watts | power::joules | power::percent | power::charging,
      .voltage_v = static_cast<float>(battery_.voltage_v()),
      .charge_percent = static_cast<float>(100 * charge),
      .energy_j = static_cast<float>(energy_j(parameters_, charge)),
      .power_w = static_cast<float>(battery_.voltage_v() * battery_.current_a()),
      .charging = charging_ ? 1 : 0,
  });
}

}  // namespace regista
