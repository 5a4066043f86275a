// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include <regista/testing/rig.hpp>

#include "can_motor.hpp"
#include "differential.hpp"
#include "localizer.hpp"
#include "simulated_gps.hpp"
#include "simulated_imu.hpp"
#include "waypoint.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;

template <typename D>
std::unique_ptr<Driver> create(Setup& setup) {
  return std::make_unique<D>(setup);
}

/// examples/field.cfg, as a server runs it.
testing::Rig field() {
  std::ostringstream text;
  text << std::ifstream{EXAMPLES "/field.cfg"}.rdbuf();
  return testing::Rig{text.str(),
                      {{"can_motor", create<CanMotor>},
                       {"differential", create<Differential>},
                       {"simulated_gps", create<SimulatedGps>},
                       {"simulated_imu", create<SimulatedImu>},
                       {"localizer", create<Localizer>},
                       {"waypoint", create<Waypoint>}}};
}

TEST(FieldRobot, is_not_driven_by_its_truth) {
  auto rig = field();
  rig.run(100ms);
  (void)rig.ask(position2d::SetMotorPower{1});
  rig.run(3s);
  ASSERT_EQ(rig.latest<actarray::State>()->motors_on, 1);
  for (int i = 0; i < 10; ++i) {
    rig.send(position2d::VelocityCommand{.velocity = {.x = 2, .w = 3}}, 1);
    rig.run(100ms);
  }
  EXPECT_LT(distance(rig.latest<position2d::State>(1)->pose, {}), 0.01);
}

TEST(FieldRobot, drives_the_mission_of_the_example_again_and_again) {
  auto rig = field();
  rig.run(100ms);
  (void)rig.ask(position2d::SetMotorPower{1});  // answered when drives are up and enabled
  rig.run(3s);
  ASSERT_EQ(rig.latest<actarray::State>()->motors_on, 1);
  const std::vector<Pose2d> points{{3, 0, 0}, {5, 2, 1.57}, {3, 4, 3.14}};
  for (int lap = 0; lap < 5; ++lap) {
    ASSERT_TRUE(rig.ask(planner::SetMission{.id = "three points",
                                            .points = points,
                                            .actions = {{.point = 1, .act = planner::Act::wait, .duration_s = 1}}}));
    rig.send(planner::RunCommand{"three points"});
    Duration time{};
    for (; time < 60s && rig.ask(planner::GetMission{})->state != planner::MissionState::finished; time += 100ms) {
      rig.run(100ms);
    }
    EXPECT_LT(time, 40s) << rig.ask(planner::GetMission{})->reason.view();
    EXPECT_LT(distance(rig.latest<position2d::State>(1)->pose, points.back()), 0.8);
    EXPECT_LT(distance(rig.latest<position2d::State>(1)->pose, rig.latest<position2d::State>(2)->pose), 0.6);
  }
}

}  // namespace
}  // namespace regista
