// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <regista/client/team.hpp>

using namespace std::chrono_literals;

// Two robots, one loop: they turn until both have turned by a right angle.
int main() {
  regista::client::Team team;
  for (std::uint16_t port = 6665; port <= 6666; ++port) team.add("localhost", port).position2d().reset_odometry();

  for (bool turned = false; !turned;) {
    team.read(100ms);
    turned = true;
    for (auto& robot : team) {
      auto& base = robot.position2d();
      const bool there = base.state().pose.heading > 1.57;
      base.set_velocity({.w = there ? 0.0 : 1.0});
      turned = turned && there;
    }
  }
  for (auto& robot : team) {
    robot.stop();
    std::printf("robot at port %d has turned\n", robot.connection().port());
  }
}
