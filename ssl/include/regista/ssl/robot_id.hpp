// SPDX-License-Identifier: Apache-2.0
#pragma once

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

/// "yellow 3"
inline std::string to_string(RobotId id) {
  return (id.team == Team::yellow ? "yellow " : "blue ") + std::to_string(id.number);
}

}  // namespace regista::ssl
