// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <regista/client/robot.hpp>

using namespace std::chrono_literals;

int main() {
  regista::client::Robot robot{"localhost"};  // throws when nobody answers
  auto& base = robot.position2d();

  base.reset_odometry();
  while (base.state().pose.x < 1.0) {  // one metre ahead
    base.set_velocity({.x = 0.5});     // repeated: silence stops the robot
    robot.read(100ms);                 // values change here, and only here
  }
  base.stop();
  std::printf("drove %.1f m\n", base.state().pose.x);
}
