// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <regista/soccer/team.hpp>

using namespace std::chrono_literals;

// Centralised: cameras say where robots are, velocities go out. All cross a circle, and none touches another.
int main() {
  regista::soccer::Team team{"team.cfg", regista::ssl::Team::yellow};
  for (const double side : {1.0, -1.0}) {
    const auto place = [&](const regista::soccer::TeamRobot& robot) {
      const double angle = 6.283 * robot.id().number / static_cast<double>(team.size());
      return regista::Pose2d{.x = side * std::cos(angle) - 1.5, .y = side * std::sin(angle)};
    };
    for (auto& robot : team) robot.drive_to(place(robot));
    while (!std::ranges::all_of(team, [&](const auto& robot) { return robot.is_at(place(robot)); })) {
      team.read(50ms);  // values change here, and velocities go out from here
    }
    std::printf("%zu robots stand on the circle\n", team.size());
  }
}
