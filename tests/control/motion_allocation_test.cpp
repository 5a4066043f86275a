// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/control/avoidance.hpp>
#include <regista/control/path_following.hpp>
#include <regista/control/posture_regulator.hpp>
#include <regista/control/trajectory_tracker.hpp>
#include <regista/control/waypoint_mission.hpp>

#include <array>

#include "counting_new.hpp"

namespace regista::control {
namespace {

using namespace std::chrono_literals;

TEST(Motion, no_step_allocates) {
  const MotionPlanner planner{{3, 3, 10, 30}};
  TrajectoryTracker tracker{TrajectoryTrackerConfig::published()};
  PostureRegulator posture{PostureRegulatorConfig::quick()};
  const std::array segments{PathSegment{.length_m = 3}, PathSegment{.length_m = 3, .curvature_radpm = 0.5}};
  PathFollowing following{{.k1 = 1, .k2 = 1, .turn_rate_limit_radps = 1}, Path{{}, segments}};
  WaypointMission mission{{.law = {.speed_mps = 1, .turn_rate_limit_radps = 1}, .parking = {}},
                          {{.pose = {.x = 1}, .work = Work::measure}, {.pose = {.x = 2}}}};
  Avoidance avoidance{{.speed_mps = 2, .acceleration_mps2 = 3, .horizon = 1s}};
  std::array<Disc, Avoidance::capacity> crowd;
  for (std::size_t i = 0; i < crowd.size(); ++i) {
    crowd[i] = {.x = 0.2 * static_cast<double>(i % 6), .y = 0.2 * static_cast<double>(i / 6), .radius_m = 0.09};
  }

  const std::size_t before = allocations().count;
  for (int i = 0; i < 1000; ++i) {
    const double s = 0.01 * i;
    const Pose2d pose{.x = s, .y = 0.1, .heading = 0.1 * s};
    const auto plan = planner.plan({.pose = pose, .velocity = {.x = 4 - s, .y = s, .w = 1}}, {.pose = {.y = 2}});
    (void)plan->at(500ms);
    (void)tracker.step(pose, {.x = i < 500 ? 1.0 : 2.0}, 10ms);
    (void)posture.step(pose, {.x = 5});
    (void)following.step(pose, 1);
    (void)mission.step({.estimate = pose, .wheels = {.x = 1}, .tool = {}}, 10ms);
    (void)avoidance.step({.x = s, .y = 0.5, .radius_m = 0.09}, {.x = 1}, crowd, 10ms);
    (void)tracker.step({.x = std::nan("")}, {}, 10ms);
  }
  mission.pause();
  mission.resume();
  EXPECT_EQ(allocations().count, before);

  std::vector<int> proof(1);  // that it counts
  EXPECT_EQ(allocations().count, before + 1);
}

}  // namespace
}  // namespace regista::control
