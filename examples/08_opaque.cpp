// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <regista/client/robot.hpp>

using namespace std::chrono_literals;

// A device that only its driver and this program understand: the lamps of driver/lamps.cpp, one byte each.
int main() {
  regista::client::Robot robot{"localhost"};
  auto& lamps = robot.opaque();

  std::printf("there are %d lamps\n", lamps.request_bytes({}).at(0));
  lamps.send_bytes({255, 128, 0});
  while (lamps.bytes() != std::vector<std::uint8_t>{255, 128, 0}) robot.read(100ms);
  for (const int brightness : lamps.bytes()) std::printf("%3d ", brightness);
  std::printf("\n");
}
