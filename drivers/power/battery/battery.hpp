// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <regista/device/driver.hpp>
#include <vector>

#include "sysfs.hpp"

namespace regista {

/// The battery of the computer that this runs on: one that Linux knows (power_supply), or a voltage sensor (hwmon) on
/// one that it does not.
///
/// `power:0` has what is known: volts, watts, percent, joules, charging.
///
/// `requires ["position2d:0"]`, or several: bases that are stopped when it is critical, and again whenever they move,
/// until it is charged or good again. With `alwayson yes`, or nobody watches while no client listens.
///
/// | Key                | Value                                                                       | Default      |
/// |--------------------|-----------------------------------------------------------------------------|--------------|
/// | `supply`           | "BAT0"; "": the first battery in /sys/class/power_supply                    | ""           |
/// | `sensor`           | "ina226": a chip in /sys/class/hwmon instead                                | none         |
/// | `voltage`          | which of the chip's                                                         | "in1"        |
/// | `current`          | which of the chip's; "": none                                               | ""           |
/// | `empty_voltage`    | [V] at rest: where nothing says the state of charge, it is a line between.. | none         |
/// | `full_voltage`     | [V] .. these two                                                            | none         |
/// | `warning`          | [%] of charge, or less, that is told                                        | 20           |
/// | `critical`         | [%] of charge, or less, that is told as a failure                           | 10           |
/// | `warning_voltage`  | [V] likewise                                                                | none         |
/// | `critical_voltage` | [V] likewise                                                                | none         |
/// | `root`             | of sysfs                                                                    | "/sys"       |
///
/// Property, read-only: `level`, "good", "low" or "critical".
class BatteryDriver final : public Driver {
 public:
  explicit BatteryDriver(Setup& setup);

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override {}

 private:
  enum class Level : std::uint8_t { good, low, critical };
  struct Thresholds {
    double percent = 0;
    double voltage_v = 0;
  };

  void stop_bases();
  [[nodiscard]] bool is_below(const Thresholds& thresholds, double margin) const;
  void judge();

  Port<Power> port_;
  std::vector<Required<Position2d>> bases_;
  Property<std::string> level_text_;
  std::filesystem::path root_;
  std::string supply_name_;
  std::string sensor_;
  std::string voltage_;
  std::string current_;
  std::optional<double> empty_v_;
  std::optional<double> full_v_;
  Thresholds warning_;
  Thresholds critical_;
  std::filesystem::path folder_;
  Supply supply_;
  Level level_ = Level::good;
  bool must_rest_ = false;  ///< critical, and not charging
};

}  // namespace regista
