// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <regista/ssl/multicast.hpp>
#include <regista/vision/tracker.hpp>
#include <string>
#include <vector>

namespace regista::vision {

struct RobotAddress {
  ssl::RobotId id;
  std::string host;
  std::uint16_t port = 6665;
  std::uint16_t index = 1;                  ///< of the position2d that takes poses
  std::optional<std::uint16_t> motion = 0;  ///< of the one that tells how the robot turns
};

/// As what the bridge publishes tracked vision.
inline constexpr std::string_view bridge_name = "regista";

/// docs/ssl-vision.md explains the keys.
struct BridgeConfig {
  enum class Input : std::uint8_t { vision, tracked };

  Input input = Input::vision;
  ssl::Group vision = ssl::vision_group;
  ssl::Group tracked = ssl::tracker_group;
  std::string tracker;  ///< whose tracked vision to believe; empty: whoever is heard first
  std::optional<ssl::Group> referee = ssl::referee_group;
  std::vector<std::string> interfaces;  ///< none: all
  std::vector<std::string> publish;     ///< interfaces to send tracked vision out of
  std::optional<std::uint16_t> status_port;
  TrackerConfig tracking;
  bool learn_delay = true;  ///< of `tracking`: nobody has told it
  std::vector<RobotAddress> robots;
};

/// Throws ConfigError, with file, line and column.
BridgeConfig read_bridge_config(const std::filesystem::path& file);

}  // namespace regista::vision
