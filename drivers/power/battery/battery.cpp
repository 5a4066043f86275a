// SPDX-License-Identifier: Apache-2.0
#include "battery.hpp"

#include <algorithm>
#include <cstdio>
#include <utility>

namespace regista {

namespace {

// A level is left only that much above its threshold, so that a load that comes and goes does not tell it each time.
constexpr double margin = 0.02;

constexpr Range volts{.min = 0, .max = 2000};

std::optional<double> optional_voltage(const Section& config, const char* key) {
  if (!config.has(key)) return {};
  return config.number(key, volts);
}

std::string text(const Supply& supply) {
  char percent[32] = "";
  char voltage[32] = "";
  if (supply.charge_ratio) (void)std::snprintf(percent, sizeof percent, "%.0f %%", 100 * *supply.charge_ratio);
  if (supply.voltage_v) (void)std::snprintf(voltage, sizeof voltage, "%.2f V", *supply.voltage_v);
  return std::string{percent} + (supply.charge_ratio && supply.voltage_v ? ", " : "") + voltage;
}

std::vector<Required<Position2d>> require_bases(Setup& setup) {
  std::vector<Required<Position2d>> bases;
  for (std::size_t i = 0; i < setup.config.device_names("requires").size(); ++i) {
    bases.push_back(setup.require<Position2d>());
  }
  return bases;
}

}  // namespace

BatteryDriver::BatteryDriver(Setup& setup)
    : port_{setup.provide<Power>()},
      bases_{require_bases(setup)},
      level_text_{setup.property<std::string>("level", "good", {.read_only = true})},
      root_{setup.config.text("root", "/sys")},
      supply_name_{setup.config.text("supply", "")},
      sensor_{setup.config.text("sensor", "")},
      voltage_{setup.config.text("voltage", "in1")},
      current_{setup.config.text("current", "")},
      empty_v_{optional_voltage(setup.config, "empty_voltage")},
      full_v_{optional_voltage(setup.config, "full_voltage")},
      warning_{.percent = setup.config.number("warning", 20, {.min = 0, .max = 100}),
               .voltage_v = setup.config.number("warning_voltage", 0, volts)},
      critical_{.percent = setup.config.number("critical", 10, {.min = 0, .max = 100}),
                .voltage_v = setup.config.number("critical_voltage", 0, volts)} {
  if (empty_v_.has_value() != full_v_.has_value() || (full_v_ && *full_v_ <= *empty_v_)) {
    throw setup.config.error(full_v_ ? "full_voltage" : "empty_voltage",
                             "needs the other: empty_voltage, and a full_voltage above it");
  }
  if (critical_.percent > warning_.percent) throw setup.config.error("critical", "must not be above 'warning'");
  if (warning_.voltage_v > 0 && critical_.voltage_v > warning_.voltage_v) {
    throw setup.config.error("critical_voltage", "must not be above 'warning_voltage'");
  }
  if (!sensor_.empty() && !supply_name_.empty()) {
    throw setup.config.error("sensor", "and 'supply' are two batteries: two drivers");
  }
  for (Required<Position2d>& base : bases_) {
    // Whoever has paused may drive again: not for longer than until its base says so.
    base.on_data<position2d::State>([this, &base](const position2d::State& state, Time) {
      if (must_rest_ && state.velocity != BodyVelocity{}) (void)base.stop();
    });
  }
}

Result<> BatteryDriver::open() {
  Result<std::filesystem::path> found =
      sensor_.empty() ? find_supply(root_, supply_name_) : find_sensor(root_, sensor_);
  if (!found) return found.error();
  folder_ = *std::move(found);
  return {};
}

Result<> BatteryDriver::read(const Tick&) {
  const Result<Supply> supply = sensor_.empty() ? read_supply(folder_) : read_sensor(folder_, voltage_, current_);
  if (!supply) return supply.error();
  supply_ = *supply;
  if (!supply_.charge_ratio && full_v_ && supply_.voltage_v) {
    supply_.charge_ratio = std::clamp((*supply_.voltage_v - *empty_v_) / (*full_v_ - *empty_v_), 0.0, 1.0);
  }
  judge();
  return {};
}

bool BatteryDriver::is_below(const Thresholds& thresholds, double margin_ratio) const {
  return (supply_.charge_ratio && *supply_.charge_ratio <= thresholds.percent / 100 + margin_ratio) ||
         (thresholds.voltage_v > 0 && supply_.voltage_v &&
          *supply_.voltage_v <= thresholds.voltage_v * (1 + margin_ratio));
}

void BatteryDriver::judge() {
  const bool charging = supply_.charging.value_or(false);
  Level level = Level::good;
  if (is_below(critical_, level_ == Level::critical ? margin : 0)) {
    level = Level::critical;
  } else if (is_below(warning_, level_ != Level::good ? margin : 0)) {
    level = Level::low;
  }
  const Level before = std::exchange(level_, level);
  must_rest_ = level == Level::critical && !charging;
  if (must_rest_) stop_bases();
  level_text_.set(level == Level::critical ? "critical" : level == Level::low ? "low" : "good");
  if (level == before) return;
  const std::string now = text(supply_) + (charging ? ", charging" : "");
  if (level == Level::critical) {
    port_.tell(2, "battery critical: " + now +
                      (must_rest_ && !bases_.empty() ? ": the robot is stopped until it is charged"
                                                     : ": stop and charge it, or the computer will be off"));
  } else if (level == Level::low) {
    port_.tell(1, "battery low: " + now);
  } else {
    port_.tell(0, "battery good again: " + now);
  }
}

void BatteryDriver::stop_bases() {
  for (Required<Position2d>& base : bases_) (void)base.stop();
}

void BatteryDriver::publish() {
  power::State state;
  const auto put = [&](std::uint32_t bit, const std::optional<double>& value, float& field, double unit = 1) {
    if (!value) return;
    state.valid |= bit;
    field = static_cast<float>(unit * *value);
  };
  put(power::volts, supply_.voltage_v, state.voltage_v);
  put(power::percent, supply_.charge_ratio, state.charge_percent, 100);
  put(power::joules, supply_.energy_j, state.energy_j);
  put(power::watts, supply_.power_w, state.power_w);
  if (supply_.charging) {
    state.valid |= power::charging;
    state.charging = *supply_.charging ? 1 : 0;
  }
  port_.send(state);
}

}  // namespace regista
