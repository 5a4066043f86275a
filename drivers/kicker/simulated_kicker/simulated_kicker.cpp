// SPDX-License-Identifier: Apache-2.0
#include "simulated_kicker.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

namespace regista {

namespace {

using namespace std::chrono_literals;

constexpr double degree = std::numbers::pi / 180;

/// "kick speed is 8 m/s, must be within [0, 6.5] m/s"
Error out_of_range(const char* what, double value, double min, double max, const char* unit) {
  char text[128];
  (void)std::snprintf(text, sizeof text, "%s is %.4g %s, must be within [%.4g, %.4g] %s", what, value, unit, min, max,
                      unit);
  return {std::errc::result_out_of_range, text};
}

kicker::Limits read_limits(const Section& config) {
  const Range positive{.min = 1e-3};
  const Range upwards{.min = 0, .max = std::numbers::pi / 2};
  const double chip_angle_min = config.angle("chip_angle_min", 30 * degree, upwards);
  return {.kick_speed_mps = static_cast<float>(config.length("kick_speed", 6.5, positive)),
          .chip_speed_mps = static_cast<float>(config.length("chip_speed", 4, positive)),
          .chip_angle_min_rad = static_cast<float>(chip_angle_min),
          .chip_angle_max_rad = static_cast<float>(config.angle("chip_angle_max", std::max(60 * degree, chip_angle_min),
                                                                {.min = chip_angle_min, .max = upwards.max})),
          .dribbler_radps = static_cast<float>(config.angle("dribbler_speed", 300, positive))};
}

}  // namespace

SimulatedKicker::SimulatedKicker(Setup& setup)
    : port_{setup.provide<Kicker>()},
      ball_{setup.property<bool>("ball", false)},
      charge_time_{setup.config.duration("charge_time", 2s, {.min = 1e-3})},
      full_v_{setup.config.number("voltage", 200, {.min = 1})},
      limits_{read_limits(setup.config)},
      dribbler_time_constant_s_{setup.config.number("dribbler_time_constant", 0.1, {.min = 1e-3})},
      geometry_{.pose = {.x = setup.config.length("offset", 0.08)},
                .size = {.width = setup.config.length("width", 0.08, {.min = 1e-3})}} {
  port_.on<kicker::KickCommand>(
      [this](const kicker::KickCommand& kick) { return shoot("kick", kick.speed_mps, limits_.kick_speed_mps); });
  port_.on<kicker::ChipCommand>([this](const kicker::ChipCommand& chip) -> Result<> {
    if (chip.angle_rad < limits_.chip_angle_min_rad || chip.angle_rad > limits_.chip_angle_max_rad) {
      return out_of_range("chip angle", chip.angle_rad, limits_.chip_angle_min_rad, limits_.chip_angle_max_rad, "rad");
    }
    return shoot("chip", chip.speed_mps, limits_.chip_speed_mps);
  });
  port_.on<kicker::ChargeCommand>([this](const kicker::ChargeCommand& charge) { charging_ = charge.on != 0; });
  port_.on<kicker::DribblerCommand>([this](const kicker::DribblerCommand& dribbler) -> Result<> {
    if (std::abs(dribbler.speed_radps) > limits_.dribbler_radps) {
      return out_of_range("dribbler speed", dribbler.speed_radps, -limits_.dribbler_radps, limits_.dribbler_radps,
                          "rad/s");
    }
    dribbler_target_radps_ = dribbler.speed_radps;
    return {};
  });
  port_.on<kicker::GetGeometry>([this](const auto&) -> Result<kicker::Geometry> { return geometry_; });
  port_.on<kicker::GetLimits>([this](const auto&) -> Result<kicker::Limits> { return limits_; });
}

Result<> SimulatedKicker::shoot(const char* what, double speed_mps, double largest_mps) {
  if (!(speed_mps > 0 && speed_mps <= largest_mps)) {
    return out_of_range((std::string{what} + " speed").c_str(), speed_mps, 0, largest_mps, "m/s");
  }
  if (energy_ < 1) {
    char text[96];
    (void)std::snprintf(text, sizeof text, "%s: the capacitor has %.0f V of %.0f V: %s", what, capacitor_v(), full_v_,
                        charging_ ? "wait until it is charged" : "send CHARGE 1");
    return Error{std::errc::resource_unavailable_try_again, text};
  }
  const double share = speed_mps / largest_mps;
  energy_ -= share * share;
  ball_.set(false);
  ++kick_count_;
  return {};
}

// Half the capacity times the voltage squared is the energy.
double SimulatedKicker::capacitor_v() const { return full_v_ * std::sqrt(energy_); }

Result<> SimulatedKicker::open() {
  energy_ = 0;
  kick_count_ = 0;
  return {};
}

Result<> SimulatedKicker::read(const Tick& tick) {
  // A charger gives constant power.
  if (charging_) energy_ = std::min(1.0, energy_ + seconds(tick.dt) / seconds(charge_time_));
  dribbler_radps_ +=
      -std::expm1(-seconds(tick.dt) / dribbler_time_constant_s_) * (dribbler_target_radps_ - dribbler_radps_);
  return {};
}

void SimulatedKicker::publish() {
  port_.send(kicker::State{
      .capacitor_v = static_cast<float>(capacitor_v()),
      .charged = energy_ >= 1,
      .ball_detected = *ball_,
      .dribbler_radps = static_cast<float>(dribbler_radps_),
      .kick_count = kick_count_,
  });
}

void SimulatedKicker::halt() noexcept {
  charging_ = false;
  dribbler_target_radps_ = 0;
  dribbler_radps_ = 0;
}

}  // namespace regista
