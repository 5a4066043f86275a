// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <regista/core/result.hpp>
#include <string>

namespace regista {

/// What a supply says of itself in SI; nothing where it says nothing.
struct Supply {
  std::optional<double> voltage_v{};
  std::optional<double> current_a{};  ///< drawn from it
  std::optional<double> power_w{};    ///< drawn from it
  std::optional<double> charge_ratio{};
  std::optional<double> energy_j{};  ///< left in it
  std::optional<bool> charging{};
};

/// The folder of a supply of Linux' power_supply class below `root` ("/sys"): the one of this name, or the first
/// battery when it is empty. An error says which there are.
Result<std::filesystem::path> find_supply(const std::filesystem::path& root, const std::string& name);
/// Documentation/ABI/testing/sysfs-class-power. An error when it is not present, or not to be read.
Result<Supply> read_supply(const std::filesystem::path& folder);

/// The folder of a sensor chip of Linux' hwmon class by the chip's name, such as "ina226". An error says which there
/// are.
Result<std::filesystem::path> find_sensor(const std::filesystem::path& root, const std::string& chip);
/// Documentation/hwmon/sysfs-interface: "inN" in millivolts, and unless `current` is empty "currN" in milliamperes.
Result<Supply> read_sensor(const std::filesystem::path& folder, const std::string& voltage, const std::string& current);

}  // namespace regista
