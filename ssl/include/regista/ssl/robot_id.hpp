// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace regista::ssl {

enum class Team : std::uint8_t { yellow, blue };

inline constexpr std::uint8_t robots_per_team = 16;  ///< patterns of the league: 0 to 15

struct RobotId {
  Team team = Team::yellow;
  std::uint8_t number = 0;  ///< below robots_per_team
  friend auto operator<=>(const RobotId&, const RobotId&) = default;
};

inline constexpr std::size_t most_robots = std::size_t{2} * robots_per_team;

/// Of tables of all robots, below most_robots.
constexpr std::size_t index(RobotId id) {
  return id.number + (id.team == Team::blue ? std::size_t{robots_per_team} : 0);
}

/// "yellow 3"
inline std::string to_string(RobotId id) {
  return (id.team == Team::yellow ? "yellow " : "blue ") + std::to_string(id.number);
}

}  // namespace regista::ssl
