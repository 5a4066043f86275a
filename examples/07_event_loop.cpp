// SPDX-License-Identifier: Apache-2.0
#include <poll.h>

#include <algorithm>
#include <cstdio>
#include <regista/client/robot.hpp>

using namespace std::chrono_literals;

// In an event loop that others own: it waits for the robot's descriptor, and no longer than until wake_time().
int main() {
  regista::client::Robot robot{"localhost"};
  auto& base = robot.position2d();
  base.reset_odometry();

  while (base.state().pose.x < 0.5) {
    base.set_velocity({.x = 0.5});
    pollfd ready{.fd = robot.fileno(), .events = robot.connection().poll_events(), .revents = 0};
    const auto left = std::clamp<regista::Duration>(robot.wake_time() - regista::Clock::now(), 0ms, 100ms);
    poll(&ready, 1, static_cast<int>(left / 1ms) + 1);
    robot.read(0ms);  // only looks
  }
  base.stop();
  std::printf("drove %.1f m\n", base.state().pose.x);
}
