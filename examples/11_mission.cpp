// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <regista/client/robot.hpp>

using namespace std::chrono_literals;
using namespace regista::planner;

// A field robot drives through three points and waits at the second: examples/field.cfg.
int main() {
  regista::client::Robot robot{"localhost"};
  auto& driver = robot.device<regista::Planner>();
  auto& truth = robot.position2d(1);
  robot.position2d(0).set_motor_power(true);                // its drives have no voltage before
  while (robot.position2d(2).count() == 0) robot.read(1s);  // the localizer is silent until it knows where it is

  const std::vector<regista::Pose2d> points{{3, 0, 0}, {5, 2, 1.57}, {3, 4, 3.14}};
  (void)driver.request(SetMission{"three points", points, {{.point = 1, .act = Act::wait, .duration_s = 1}}});
  driver.send(RunCommand{"three points"});
  driver.keep_alive(true);  // the mission stops when this program does

  Mission mission;
  for (std::uint32_t done = 0; mission.state != MissionState::finished; done = mission.point) {
    robot.read(100ms);
    mission = driver.request(GetMission{});
    if (mission.point > done) std::printf("point %u of %u\n", mission.point, mission.count);
    if (mission.state == MissionState::failed) throw std::runtime_error{mission.reason.bytes()};
    std::fflush(stdout);
  }
  std::printf("arrived: %s\n", regista::distance(truth.state().pose, points.back()) < 1 ? "yes" : "no");
}
