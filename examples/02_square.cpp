// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cstdio>
#include <numbers>
#include <regista/client/robot.hpp>

using namespace std::chrono_literals;

// Once round a square of one metre, by destinations: the robot finds the way by itself.
int main() {
  regista::client::Robot robot{"localhost"};
  auto& base = robot.position2d();
  base.reset_odometry();

  constexpr double left = std::numbers::pi / 2;
  constexpr std::array<regista::Pose2d, 4> corners{{{1, 0, left}, {1, 1, -2 * left}, {0, 1, -left}, {0, 0, 0}}};
  for (const regista::Pose2d& corner : corners) {
    base.drive_to(corner, 10s, {.distance_m = 0.02});
    const regista::Pose2d& pose = base.state().pose;
    std::printf("at (%.1f, %.1f), asked for (%.1f, %.1f)\n", std::abs(pose.x), std::abs(pose.y), corner.x, corner.y);
  }
}
