// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <regista/client/robot.hpp>

using namespace std::chrono_literals;

// Charge the kicker, kick, and see it counted.
int main() {
  regista::client::Robot robot{"localhost"};
  auto& kicker = robot.kicker();

  kicker.charge(true);
  while (!kicker.state().charged) robot.read(100ms);
  const auto kicks = kicker.state().kick_count;
  kicker.kick(5.0F);
  while (kicker.state().kick_count == kicks) robot.read(100ms);
  std::printf("kicked once, %s\n", kicker.state().charged ? "still charged" : "charging again");
}
