// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <regista/client/robot.hpp>

using namespace std::chrono_literals;

// How full is the battery? What it does not measure is empty.
int main() {
  regista::client::Robot robot{"localhost"};
  auto& power = robot.power();

  while (power.count() == 0) robot.read(2s);
  if (const auto volts = power.voltage_v()) std::printf("%.0f V\n", *volts);
  if (const auto percent = power.charge_percent()) std::printf("%.0f %%\n", *percent);
  std::printf("%.1f s old at most: %s\n", 2.0, power.age() < 2s ? "yes" : "no");
}
