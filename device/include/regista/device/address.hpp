// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <charconv>
#include <cstdint>
#include <optional>
#include <regista/core/result.hpp>
#include <regista/device/suggestion.hpp>
#include <regista/interfaces/messages.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace regista {

/// A device as a `.cfg` names it: `key:host:port:interface:index`, of which only the last two must be there.
struct DeviceName {
  std::string key;              ///< tells two devices of one interface apart within a driver; mostly empty
  std::string host;             ///< empty: this server
  std::uint16_t port = 0;       ///< TCP; 0: not given
  std::uint16_t interface = 0;  ///< code, such as Position2d::code
  std::uint16_t index = 0;

  friend bool operator==(const DeviceName&, const DeviceName&) = default;
};

namespace detail {

/// The server itself is no device that a driver could provide or require.
template <typename... Is>
std::vector<std::string_view> device_interfaces(TypeList<Player, Is...>) {
  return {Is::name...};
}

inline std::optional<std::uint16_t> parse_uint16(std::string_view text) {
  std::uint16_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return {};
  return value;
}

inline std::string unknown_interface(std::string_view name) {
  const auto known = device_interfaces(Interfaces{});
  std::string text = "unknown interface '" + std::string{name} + "'";
  if (const std::string hint = did_you_mean(name, known); !hint.empty()) return text + hint;
  text += "; known are";
  for (const std::string_view other : known) text.append(other == known.front() ? " " : ", ").append(other);
  return text;
}

}  // namespace detail

/// Read a device's name from the right, as Player does: "position2d:0", "6666:position2d:0",
/// "robot7:6665:position2d:0", "odometry:::position2d:0". The error's `what` says what is wrong with which part.
inline Result<DeviceName> parse_device_name(std::string_view text) {
  const auto error = [&](const std::string& what) {
    return Error{std::errc::invalid_argument, "device '" + std::string{text} + "': " + what};
  };
  std::array<std::string_view, 5> parts;
  std::size_t first = parts.size();
  for (std::string_view rest = text;;) {
    if (first == 0) return error("at most five parts, key:host:port:interface:index");
    const std::size_t colon = rest.rfind(':');
    parts[--first] = rest.substr(colon + 1);  // npos + 1 is 0
    if (colon == std::string_view::npos) break;
    rest = rest.substr(0, colon);
  }
  if (first > 3) return error("needs an interface and an index, such as 'position2d:0'");

  const auto& [key, host, port, interface, index] = parts;
  DeviceName name{.key = std::string{key}, .host = std::string{host}};
  if (!port.empty()) {
    name.port = detail::parse_uint16(port).value_or(0);
    if (name.port == 0) return error("port '" + std::string{port} + "' must be a number within [1, 65535]");
  }
  name.interface = interface_code(interface);
  if (name.interface == 0 || name.interface == Player::code) return error(detail::unknown_interface(interface));
  const auto number = detail::parse_uint16(index);
  if (!number) return error("index '" + std::string{index} + "' must be a number within [0, 65535]");
  name.index = *number;
  return name;
}

/// The shortest text that `parse_device_name` turns back into `name`.
inline std::string to_string(const DeviceName& name) {
  const std::string port = name.port == 0 ? "" : std::to_string(name.port);
  std::string text;
  if (!name.key.empty()) text += name.key + ":";
  if (!text.empty() || !name.host.empty()) text += name.host + ":";
  if (!text.empty() || !port.empty()) text += port + ":";
  return text.append(interface_name(name.interface)).append(":").append(std::to_string(name.index));
}

}  // namespace regista
