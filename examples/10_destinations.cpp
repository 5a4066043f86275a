// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdio>
#include <regista/soccer/team.hpp>

using namespace std::chrono_literals;

// Distributed: each robot is told where to go, fuses camera, wheels and IMU, plans, and corrects by itself.
int main() {
  regista::soccer::Team team{"team.cfg", regista::ssl::Team::yellow};
  const auto goal = [](const regista::soccer::TeamRobot& robot) {
    return regista::Pose2d{.x = -0.5, .y = 0.5 * robot.id().number, .heading = 1.57};
  };
  // A robot that has not heard of vision yet takes no destination; read() tells it again.
  for (auto& robot : team) robot.go_to(goal(robot));
  while (!std::ranges::all_of(team, [&](const auto& robot) { return robot.is_at(goal(robot)); })) team.read(50ms);
  std::printf("%zu robots in line\n", team.size());
}
