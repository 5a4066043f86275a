// SPDX-License-Identifier: Apache-2.0
#include "sysfs.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <functional>
#include <vector>

namespace regista {

namespace {

namespace fs = std::filesystem;

/// The first line of a file; nothing when it is not there or, as drivers do for what they do not know now, not to be
/// read.
std::optional<std::string> line(const fs::path& file) {
  std::ifstream stream{file};
  std::string text;
  if (!std::getline(stream, text)) return {};
  return text;
}

std::optional<double> number(const fs::path& file, double unit) {
  const auto text = line(file);
  if (!text) return {};
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), value);
  if (error != std::errc{} || end != text->data() + text->size()) return {};
  return unit * static_cast<double>(value);
}

/// The folder in `folder` that is the right one, or an error with the names of all.
Result<fs::path> find(const fs::path& folder, const std::string& what,
                      const std::function<bool(const fs::path&)>& right,
                      const std::function<std::string(const fs::path&)>& name) {
  std::vector<fs::path> all;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator{folder, ignored}) all.push_back(entry.path());
  std::ranges::sort(all);
  const auto found = std::ranges::find_if(all, right);
  if (found != all.end()) return *found;
  std::string names;
  for (const fs::path& path : all) names += (names.empty() ? "" : ", ") + name(path);
  return Error{std::errc::no_such_device,
               "no " + what + " in " + folder.string() + (names.empty() ? ", which is empty" : ", only " + names)};
}

constexpr double micro = 1e-6;
constexpr double milli = 1e-3;

}  // namespace

Result<fs::path> find_supply(const fs::path& root, const std::string& name) {
  const fs::path folder = root / "class/power_supply";
  const auto of_path = [](const fs::path& path) { return path.filename().string(); };
  if (!name.empty()) {
    return find(
        folder, "supply '" + name + "'", [&](const fs::path& path) { return path.filename() == name; }, of_path);
  }
  // A mouse has one, too: scope "Device".
  return find(
      folder, "battery",
      [](const fs::path& path) { return line(path / "type") == "Battery" && line(path / "scope") != "Device"; },
      of_path);
}

Result<Supply> read_supply(const fs::path& folder) {
  const auto status = line(folder / "status");
  if (!status && !line(folder / "type")) {
    return Error{std::errc::no_such_device, "read " + folder.string() + " (was the battery taken out?)"};
  }
  if (number(folder / "present", 1) == 0.0) {
    return Error{std::errc::no_such_device, folder.string() + ": the battery is not present"};
  }
  Supply supply{.voltage_v = number(folder / "voltage_now", micro)};
  // Some drivers give the current of a discharging battery as negative, some as positive: status has the sign.
  const bool charging = status == "Charging";
  const double sign = charging ? -1 : 1;
  if (const auto current = number(folder / "current_now", micro)) supply.current_a = sign * std::abs(*current);
  if (const auto power = number(folder / "power_now", micro)) supply.power_w = sign * std::abs(*power);
  if (!supply.power_w && supply.voltage_v && supply.current_a) supply.power_w = *supply.voltage_v * *supply.current_a;
  if (status && status != "Unknown") supply.charging = charging;

  const auto ratio = [&](const char* now, const char* full) -> std::optional<double> {
    const auto left = number(folder / now, 1);
    const auto all = number(folder / full, 1);
    if (!left || !all || *all <= 0) return {};
    return *left / *all;
  };
  supply.charge_ratio = number(folder / "capacity", 0.01);
  if (!supply.charge_ratio) supply.charge_ratio = ratio("energy_now", "energy_full");
  if (!supply.charge_ratio) supply.charge_ratio = ratio("charge_now", "charge_full");
  if (supply.charge_ratio) supply.charge_ratio = std::clamp(*supply.charge_ratio, 0.0, 1.0);

  supply.energy_j = number(folder / "energy_now", 3600 * micro);
  const auto charge_c = number(folder / "charge_now", 3600 * micro);
  if (!supply.energy_j && charge_c && supply.voltage_v) supply.energy_j = *charge_c * *supply.voltage_v;
  return supply;
}

Result<fs::path> find_sensor(const fs::path& root, const std::string& chip) {
  const auto name = [](const fs::path& path) { return line(path / "name").value_or("?"); };
  return find(
      root / "class/hwmon", "sensor '" + chip + "'", [&](const fs::path& path) { return name(path) == chip; }, name);
}

Result<Supply> read_sensor(const fs::path& folder, const std::string& voltage, const std::string& current) {
  Supply supply{.voltage_v = number(folder / (voltage + "_input"), milli)};
  if (!supply.voltage_v) return Error{std::errc::io_error, "read " + (folder / (voltage + "_input")).string()};
  if (current.empty()) return supply;
  supply.current_a = number(folder / (current + "_input"), milli);
  if (!supply.current_a) return Error{std::errc::io_error, "read " + (folder / (current + "_input")).string()};
  supply.power_w = *supply.voltage_v * *supply.current_a;
  return supply;
}

}  // namespace regista
