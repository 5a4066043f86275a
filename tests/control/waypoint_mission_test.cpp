// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/control/waypoint_mission.hpp>

#include <stdexcept>

namespace regista::control {
namespace {

using namespace std::chrono_literals;
using Phase = WaypointMission::Phase;

const WaypointMissionConfig config{.law = {.speed_mps = 1, .turn_rate_limit_radps = 1.5},
                                   .parking = {.radius_m = 0.1, .leave_radius_m = 0.3, .estimates = 5, .jump_m = 0.5},
                                   .drive_timeout = 60s};

/// A robot that does what it is told, with a tool that takes a second for everything.
class Rover {
 public:
  explicit Rover(std::vector<Waypoint> waypoints) : mission{config, std::move(waypoints)} {}

  WaypointMission::Output step() {
    constexpr Duration dt = 20ms;
    const auto output =
        mission.step({.estimate = sees ? std::optional{pose} : std::nullopt, .wheels = wheels, .tool = report}, dt);
    wheels = output.command;
    pose = pose * Pose2d{.x = wheels.x * seconds(dt), .heading = wheels.w * seconds(dt)};
    report = {};
    busy = output.tool == action && output.tool != ToolAction::none ? busy + dt : Duration{};
    action = output.tool;
    if (busy >= 1s && tool_works) {
      report.finished = action;
      done.push_back(action);
      busy = {};
    }
    time += dt;
    return output;
  }

  WaypointMission::Output run_until(Phase phase, Duration at_most = 120s) {
    auto output = step();
    for (const Duration end = time + at_most; time < end && output.phase != phase;) output = step();
    return output;
  }

  WaypointMission mission;
  Pose2d pose;
  BodyVelocity wheels;
  ToolReport report;
  ToolAction action = ToolAction::none;
  Duration busy{};
  Duration time{};
  std::vector<ToolAction> done;
  bool sees = true;
  bool tool_works = true;
};

TEST(WaypointMission, visits_all_works_where_asked_and_finishes) {
  Rover rover{{{.pose = {.x = 2}},
               {.pose = {.x = 4, .y = 1, .heading = 0.5}, .work = Work::measure},
               {.pose = {.x = 6, .y = 2, .heading = 0.5}, .work = Work::wait, .wait = 3s}}};
  const auto output = rover.run_until(Phase::finished);
  EXPECT_EQ(output.phase, Phase::finished);
  EXPECT_EQ(output.waypoint, 3U);
  EXPECT_EQ(output.command, BodyVelocity{});
  EXPECT_LT(distance(rover.pose, {.x = 6, .y = 2}), 0.1);
  EXPECT_EQ(rover.done, (std::vector{ToolAction::lower, ToolAction::measure, ToolAction::raise, ToolAction::lower,
                                     ToolAction::raise}));
}

TEST(WaypointMission, never_drives_with_the_tool_down) {
  Rover rover{{{.pose = {.x = 1}, .work = Work::wait, .wait = 2s}, {.pose = {.x = 2}, .work = Work::measure}}};
  bool down = false;
  for (auto output = rover.step(); output.phase != Phase::finished; output = rover.step()) {
    ASSERT_LT(rover.time, 120s);
    if (output.tool == ToolAction::lower) down = true;
    if (down) {
      ASSERT_EQ(output.command, BodyVelocity{});
    }
    if (rover.report.finished == ToolAction::raise) down = false;
  }
}

TEST(WaypointMission, waits_as_long_as_asked) {
  Rover rover{{{.pose = {}, .work = Work::wait, .wait = 3s}}};
  (void)rover.run_until(Phase::working);
  const Duration start = rover.time;
  (void)rover.run_until(Phase::raising);
  EXPECT_EQ(rover.time - start, 3s);
}

TEST(WaypointMission, pauses_without_moving_or_losing_its_place_and_goes_on) {
  Rover rover{{{.pose = {.x = 3}}}};
  for (int i = 0; i < 50; ++i) (void)rover.step();
  rover.mission.pause();
  for (int i = 0; i < 10'000; ++i) {
    const auto output = rover.step();
    ASSERT_TRUE(output.paused);
    ASSERT_EQ(output.command, BodyVelocity{});
    ASSERT_EQ(output.phase, Phase::driving);
  }
  rover.mission.resume();
  EXPECT_GT(rover.step().command.x, 0);
  EXPECT_EQ(rover.run_until(Phase::finished).phase, Phase::finished);
}

TEST(WaypointMission, fails_without_a_position_and_goes_on_when_it_is_back) {
  Rover rover{{{.pose = {.x = 3}}}};
  (void)rover.step();
  rover.sees = false;
  const auto output = rover.run_until(Phase::failed, 3s);
  EXPECT_EQ(output.phase, Phase::failed);
  EXPECT_EQ(output.failure, "no position that can be believed");
  EXPECT_EQ(output.command, BodyVelocity{});
  rover.sees = true;
  rover.mission.resume();
  EXPECT_EQ(rover.run_until(Phase::finished).phase, Phase::finished);
}

TEST(WaypointMission, does_not_move_before_the_first_position) {
  Rover rover{{{.pose = {.x = 3}}}};
  rover.sees = false;
  EXPECT_EQ(rover.step().command, BodyVelocity{});
}

TEST(WaypointMission, fails_when_the_way_takes_too_long) {
  Rover rover{{{.pose = {.x = 1000}}}};
  EXPECT_EQ(rover.run_until(Phase::failed).failure, "the way-point was not reached in time");
}

TEST(WaypointMission, fails_when_the_tool_does_not_finish_and_tries_again_when_told) {
  Rover rover{{{.pose = {.x = 1}, .work = Work::measure}}};
  rover.tool_works = false;
  EXPECT_EQ(rover.run_until(Phase::failed).failure, "the tool did not finish in time");
  rover.tool_works = true;
  rover.mission.resume();
  EXPECT_EQ(rover.step().phase, Phase::lowering);
  EXPECT_EQ(rover.run_until(Phase::finished).phase, Phase::finished);
}

TEST(WaypointMission, fails_when_the_tool_says_so) {
  Rover rover{{{.pose = {}, .work = Work::measure}}};
  (void)rover.run_until(Phase::lowering);
  rover.report.failed = true;
  EXPECT_EQ(rover.step().failure, "the tool reports a failure");
}

TEST(WaypointMission, moved_at_work_it_fails_then_raises_the_tool_and_drives_back) {
  Rover rover{{{.pose = {.x = 1}, .work = Work::wait, .wait = 10s}}};
  (void)rover.run_until(Phase::working);
  rover.pose.x -= 0.45;
  EXPECT_EQ(rover.run_until(Phase::failed).failure, "the robot was moved while the tool was down");
  rover.mission.resume();
  EXPECT_EQ(rover.step().phase, Phase::raising);
  EXPECT_EQ(rover.run_until(Phase::driving).waypoint, 0U);
  EXPECT_EQ(rover.run_until(Phase::finished).phase, Phase::finished);
  EXPECT_LT(distance(rover.pose, {.x = 1}), 0.1);
}

TEST(WaypointMission, ignores_a_report_of_an_action_that_nobody_asked_for) {
  Rover rover{{{.pose = {}, .work = Work::measure}}};
  (void)rover.run_until(Phase::lowering);
  rover.report.finished = ToolAction::raise;
  EXPECT_EQ(rover.step().phase, Phase::lowering);
}

TEST(WaypointMission, names_what_it_refuses) {
  EXPECT_THROW(WaypointMission(config, {}), std::invalid_argument);
  EXPECT_THROW(WaypointMission(config, {{.pose = {.x = INFINITY}}}), std::invalid_argument);
  EXPECT_THROW(WaypointMission(config, {{.pose = {}, .work = Work::wait, .wait = -1s}}), std::invalid_argument);
  auto bad = config;
  bad.tool_timeout = {};
  EXPECT_THROW(WaypointMission(bad, {{}}), std::invalid_argument);
}

}  // namespace
}  // namespace regista::control
