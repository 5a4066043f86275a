// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <regista/client/robot.hpp>

using namespace std::chrono_literals;

// Go to a pose and do something else on the way: here, watch it.
int main() {
  regista::client::Robot robot{"localhost"};
  auto& base = robot.position2d();
  base.reset_odometry();

  constexpr regista::Pose2d goal{.x = 0.8, .y = 0.4, .heading = 0.5};
  base.go_to(goal);  // stays valid while this program calls read()
  double fastest = 0;
  while (!base.is_at(goal)) {
    robot.read(100ms);
    fastest = std::max(fastest, std::hypot(base.state().velocity.x, base.state().velocity.y));
  }
  std::printf("at (%.1f, %.1f), never faster than 2 m/s: %s\n", base.state().pose.x, base.state().pose.y,
              fastest < 2 ? "yes" : "no");
}
