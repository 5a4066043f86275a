// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <regista/device/driver.hpp>

namespace regista {

/// Changes whenever a plugin has to be built again.
inline constexpr std::uint32_t plugin_api = 1;

/// Catches what the number does not: another compiler, library or set of messages lays the shared types out otherwise.
inline constexpr std::uint32_t plugin_layout = [] {
  std::uint32_t hash = 2166136261u;  // FNV-1a
  for (const std::size_t size :
       {sizeof(AnyCommand), sizeof(AnyRequest), sizeof(AnyData), sizeof(AnyReply), sizeof(Link), sizeof(Setup),
        sizeof(PortCore), sizeof(RequiredCore), sizeof(Section), AllMessages::size, std::size_t{__GXX_ABI_VERSION}}) {
    hash = (hash ^ static_cast<std::uint32_t>(size)) * 16777619u;
  }
  return hash;
}();

/// The one symbol that a plugin exports:
///
///     extern "C" const regista::Plugin regista_plugin{.name = "my_robot", .summary = "...", .create = ...};
struct Plugin {
  std::uint32_t api = plugin_api;
  std::uint32_t layout = plugin_layout;
  const char* name;     ///< as the .cfg says it; at most 62 bytes
  const char* summary;  ///< one line
  double rate_hz = 50;  ///< the beat when the .cfg names none; 0: only messages and descriptors
  /// The hardware comes to rest by itself when this process dies (a watchdog on the board, a CANopen heartbeat). The
  /// server warns at start of a driver that moves something and has none.
  bool stops_by_itself = false;
  std::unique_ptr<Driver> (*create)(Setup& setup);
};

}  // namespace regista

/// Said here, so that it is visible from outside of a plugin however that is compiled, and of the right type.
extern "C" [[gnu::visibility("default")]] const regista::Plugin regista_plugin;
