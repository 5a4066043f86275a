// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "plant.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;
using planner::Act;
using planner::MissionState;

constexpr const char* relays = R"("dio:0")";

struct Robot {
  explicit Robot(const std::string& keys = "", const std::string& poses = R"( "position2d:1")")
      : rig{plant_section + std::string{localizer_section} +
                R"(driver ( name "waypoint" provides ["planner:0"] requires ["position2d:0")" + poses + relays +
                "] speed 0.8 park 0.2 " + keys + ")",
            drivers_in(field)} {
    rig.run(3s);
  }

  Result<Empty> upload(const std::string& id, std::vector<Pose2d> points, std::vector<planner::Action> actions = {}) {
    return rig.ask(planner::SetMission{.id = Text{id}, .points = std::move(points), .actions = std::move(actions)});
  }
  void run(const std::string& id, SessionId session = testing::Rig::client) {
    rig.send(planner::RunCommand{Text{id}}, 0, session);
  }
  [[nodiscard]] planner::Mission mission() { return *rig.ask(planner::GetMission{}); }
  /// Until the mission has this state; false: that took too long.
  bool until(MissionState state, Duration patience = 120s) {
    for (const Time end = rig.now() + patience; rig.now() < end; rig.run(100ms)) {
      if (mission().state == state) return true;
    }
    return false;
  }
  [[nodiscard]] bool rests() {
    rig.run(1s);
    return field.commanded == BodyVelocity{};
  }

  World field{};
  testing::Rig rig;
};

const std::vector<Pose2d> square{{5, 0, 1.57}, {5, 5, 3.14}, {0, 5, -1.57}};

TEST(WaypointDriver, visits_all_points_and_tells) {
  Robot robot;
  ASSERT_TRUE(robot.upload("square", square));
  EXPECT_EQ(robot.mission().state, MissionState::ready);
  EXPECT_TRUE(robot.rests());  // uploaded is not driven
  robot.run("square");
  robot.rig.run(2s);
  const auto state = *robot.rig.latest<planner::State>();
  EXPECT_EQ(state.valid, 1);
  EXPECT_EQ(state.done, 0);
  EXPECT_EQ(state.waypoint, square[0]);
  EXPECT_EQ(state.goal, square[2]);
  EXPECT_EQ(state.waypoint_index, 0);
  EXPECT_EQ(state.waypoint_count, 3U);
  EXPECT_LT(distance(state.pose, robot.field.truth), 0.3);
  const auto mission = robot.mission();
  EXPECT_EQ(mission.state, MissionState::driving);
  EXPECT_NEAR(mission.distance_m, distance(robot.field.truth, square[0]), 0.3);
  ASSERT_TRUE(robot.until(MissionState::finished));
  EXPECT_LT(distance(robot.field.truth, square[2]), 0.4);
  EXPECT_EQ(robot.mission().point, 3U);
  EXPECT_EQ(robot.rig.latest<planner::State>()->done, 1);
  EXPECT_TRUE(robot.rests());
  const std::string events = robot.rig.events();
  for (const char* told : {"point 0 of 3 is done", "point 1 of 3 is done", "point 2 of 3 is done", "is finished"}) {
    EXPECT_NE(events.find(told), std::string::npos) << told;
  }
  robot.run("square");  // repeated: it is finished
  EXPECT_TRUE(robot.rests());
  EXPECT_NEAR(robot.rig.ask(planner::GetWaypoints{})->length_m, 10, 1e-9);
}

TEST(WaypointDriver, goes_to_a_goal_by_odometry_alone) {
  Robot robot{"", ""};
  robot.rig.send(planner::GoalCommand{{.x = 3, .y = 1}});
  ASSERT_TRUE(robot.until(MissionState::finished));
  EXPECT_LT(distance(robot.field.truth, {.x = 3, .y = 1}), 0.25);
}

TEST(WaypointDriver, sets_relays_waits_asks_and_goes_on) {
  Robot robot;
  ASSERT_TRUE(robot.upload("work", {{2, 0, 0}, {4, 0, 0}},
                           {{.act = Act::relay, .output = 2, .on = 1},
                            {.act = Act::wait, .duration_s = 5},
                            {.act = Act::relay, .output = 0, .on = 1},
                            {.act = Act::ask},
                            {.act = Act::relay, .output = 2},
                            {.point = 1, .act = Act::relay, .output = 0}}));
  robot.run("work");
  ASSERT_TRUE(robot.until(MissionState::working));
  EXPECT_LT(distance(robot.field.truth, {.x = 2}), 0.4);
  robot.rig.run(100ms);
  EXPECT_EQ(robot.field.outputs, (std::vector<std::uint32_t>{4}));
  robot.rig.run(4500ms);
  EXPECT_EQ(robot.mission().state, MissionState::working);
  robot.rig.run(1s);
  EXPECT_EQ(robot.field.outputs, (std::vector<std::uint32_t>{4, 5}));
  EXPECT_EQ(robot.mission().state, MissionState::asking);
  EXPECT_EQ(robot.mission().action, 3U);
  EXPECT_NE(robot.rig.events().find("action 3 of point 0 asks"), std::string::npos);
  robot.rig.run(60s);
  EXPECT_EQ(robot.mission().state, MissionState::asking);
  EXPECT_FALSE(robot.rig.ask(planner::GoOn{.point = 0, .action = 1}));
  EXPECT_TRUE(robot.rig.ask(planner::GoOn{.point = 0, .action = 3}));
  ASSERT_TRUE(robot.until(MissionState::finished));
  EXPECT_EQ(robot.field.outputs, (std::vector<std::uint32_t>{4, 5, 1, 0}));
  EXPECT_FALSE(robot.rig.ask(planner::GoOn{.point = 0, .action = 3}));
}

TEST(WaypointDriver, fails_with_the_reason_when_a_relay_is_refused_and_tries_it_again_when_told) {
  Robot robot;
  ASSERT_TRUE(robot.upload("work", {{2, 0, 0}, {4, 0, 0}},
                           {{.act = Act::relay, .output = 1, .on = 1}, {.act = Act::relay, .output = 1}}));
  robot.field.relay_trouble = "node 5: heartbeat lost for 250 ms";  // as can_motor says
  robot.run("work");
  ASSERT_TRUE(robot.until(MissionState::failed));
  EXPECT_EQ(robot.mission().reason.view(), "the relays refuse: " + robot.field.relay_trouble);
  EXPECT_EQ(robot.mission().point, 0U);
  EXPECT_NE(robot.rig.events().find("planner:0: the relays refuse: node 5"), std::string::npos);
  EXPECT_TRUE(robot.rests());
  EXPECT_LT(distance(robot.field.truth, {.x = 2}), 0.4);
  ASSERT_TRUE(robot.rig.ask(planner::Enable{1}));
  ASSERT_TRUE(robot.until(MissionState::failed)) << "they still refuse";
  robot.field.relay_trouble.clear();
  ASSERT_TRUE(robot.rig.ask(planner::Enable{1}));
  ASSERT_TRUE(robot.until(MissionState::finished));
  EXPECT_EQ(robot.field.outputs, (std::vector<std::uint32_t>{2, 0}));
}

// can_motor takes a command, and its drive aborts the write: an event, and data that do not follow.
TEST(WaypointDriver, fails_with_the_reason_when_a_relay_that_was_taken_does_not_switch) {
  Robot robot{"relay_feedback yes"};
  ASSERT_TRUE(robot.upload("work", {{2, 0, 0}, {4, 0, 0}},
                           {{.act = Act::relay, .output = 1, .on = 1}, {.act = Act::relay, .output = 1}}));
  robot.field.relays_stuck = true;
  robot.run("work");
  ASSERT_TRUE(robot.until(MissionState::failed));
  EXPECT_EQ(robot.mission().reason.view(), "the relays do not switch: 1 is off; why, the dio's driver has told");
  EXPECT_EQ(robot.mission().point, 0U);
  EXPECT_TRUE(robot.rests());
  robot.field.relays_stuck = false;
  ASSERT_TRUE(robot.rig.ask(planner::Enable{1}));
  ASSERT_TRUE(robot.until(MissionState::finished));
  EXPECT_EQ(robot.field.outputs, (std::vector<std::uint32_t>{2, 2, 0}));
}

TEST(WaypointDriver, begins_anew_when_the_robot_is_carried_away_from_its_work) {
  Robot robot;
  ASSERT_TRUE(robot.upload("work", {{2, 0, 0}},
                           {{.act = Act::relay, .output = 1, .on = 1},
                            {.act = Act::wait, .duration_s = 30},
                            {.act = Act::relay, .output = 1}}));
  robot.run("work");
  ASSERT_TRUE(robot.until(MissionState::working));
  robot.field.truth.x -= 0.8;
  ASSERT_TRUE(robot.until(MissionState::failed, 20s));
  EXPECT_NE(std::string{robot.mission().reason.view()}.find("moved"), std::string::npos);
  EXPECT_EQ(robot.field.outputs, (std::vector<std::uint32_t>{2}));
  EXPECT_TRUE(robot.rests());
  ASSERT_TRUE(robot.rig.ask(planner::Enable{1}));
  ASSERT_TRUE(robot.until(MissionState::finished));
  EXPECT_EQ(robot.field.outputs, (std::vector<std::uint32_t>{2, 0, 2, 0}));
  EXPECT_LT(distance(robot.field.truth, {.x = 2}), 0.4);
}

/// Stopped while output 1 sprays.
struct BrokenOff : Robot {
  BrokenOff() {
    EXPECT_TRUE(upload("work", {{2, 0, 0}},
                       {{.act = Act::relay, .output = 1, .on = 1},
                        {.act = Act::wait, .duration_s = 30},
                        {.act = Act::relay, .output = 1}}));
    run("work");
    EXPECT_TRUE(until(MissionState::working));
    rig.run(1s);
    EXPECT_TRUE(rig.ask(Planner::code, player::Stop{}, 0));
    EXPECT_EQ(field.outputs, (std::vector<std::uint32_t>{2}));
    rig.events();
  }
};

TEST(WaypointDriver, does_not_drive_with_relays_on_that_another_mission_left) {
  BrokenOff robot;
  const Pose2d there = robot.field.truth;
  robot.field.relay_trouble = "node 5: not ready";
  ASSERT_TRUE(robot.upload("spray", {{4, 0, 0}, {6, 0, 0}}, {{.act = Act::relay, .output = 0, .on = 1}}));
  robot.rig.run(100ms);
  EXPECT_NE(robot.rig.events().find("planner:0: the relays refuse: node 5: not ready"), std::string::npos);
  robot.run("spray");
  ASSERT_TRUE(robot.until(MissionState::failed, 1s));
  EXPECT_EQ(robot.mission().reason.view(), "the relays refuse: node 5: not ready");
  EXPECT_TRUE(robot.rests());
  EXPECT_LT(distance(robot.field.truth, there), 0.05);
  robot.field.relay_trouble.clear();
  ASSERT_TRUE(robot.rig.ask(planner::Enable{1}));
  ASSERT_TRUE(robot.until(MissionState::finished));
  EXPECT_EQ(robot.field.outputs, (std::vector<std::uint32_t>{2, 0, 1})) << "off, then what the new mission wants";
}

TEST(WaypointDriver, tries_again_to_put_relays_back_when_a_goal_is_enabled_again) {
  BrokenOff robot;
  const Pose2d there = robot.field.truth;
  robot.field.relay_trouble = "node 5: not ready";
  robot.rig.send(planner::GoalCommand{{.x = 5}});
  ASSERT_TRUE(robot.until(MissionState::failed, 1s));
  ASSERT_TRUE(robot.rig.ask(planner::Enable{1}));
  ASSERT_TRUE(robot.until(MissionState::failed, 1s)) << "they still refuse";
  EXPECT_TRUE(robot.rests());
  EXPECT_LT(distance(robot.field.truth, there), 0.05);
  robot.field.relay_trouble.clear();
  ASSERT_TRUE(robot.rig.ask(planner::Enable{1}));
  ASSERT_TRUE(robot.until(MissionState::finished));
  EXPECT_EQ(robot.field.outputs, (std::vector<std::uint32_t>{2, 0}));
}

TEST(WaypointDriver, pauses_and_goes_on) {
  Robot robot;
  ASSERT_TRUE(robot.upload("square", square));
  EXPECT_FALSE(robot.rig.ask(planner::Enable{1}));  // nobody drives it
  robot.run("square");
  robot.rig.run(3s);
  ASSERT_TRUE(robot.rig.ask(planner::Enable{0}));
  EXPECT_TRUE(robot.rests());
  EXPECT_EQ(robot.mission().state, MissionState::paused);
  robot.run("square");  // repeated: no order to go on
  EXPECT_TRUE(robot.rests());
  // The base is free for others.
  robot.rig.send(position2d::VelocityCommand{.velocity = {.x = 0.2}});
  robot.rig.run(200ms);
  EXPECT_EQ(robot.field.commanded.x, 0.2);
  robot.rig.run(2s);
  ASSERT_TRUE(robot.rig.ask(planner::Enable{1}));
  EXPECT_TRUE(robot.until(MissionState::finished));
}

TEST(WaypointDriver, stands_when_its_owner_is_gone_and_goes_on_with_the_next) {
  Robot robot;
  robot.rig.arrive(2);
  ASSERT_TRUE(robot.upload("square", square));
  robot.run("square");
  robot.rig.run(3s);
  EXPECT_GT(robot.field.commanded.x, 0.3);
  robot.rig.leave(testing::Rig::client);
  EXPECT_TRUE(robot.rests());
  EXPECT_FALSE(robot.rig.ask(planner::Enable{1}, 0, 2));  // it has no owner
  EXPECT_TRUE(robot.rests());
  robot.run("square", 2);
  robot.rig.run(3s);
  EXPECT_GT(robot.field.commanded.x, 0.3);
  EXPECT_EQ(robot.rig.ask(planner::GetMission{}, 0, 2)->state, MissionState::driving);
}

TEST(WaypointDriver, survives_its_owner_where_the_configuration_says_so) {
  Robot robot{"outlives_owner yes alwayson yes"};
  ASSERT_TRUE(robot.upload("there", {{6, 0, 0}}));
  robot.run("there");
  robot.rig.run(2s);
  robot.rig.leave(testing::Rig::client);
  robot.rig.run(30s);
  EXPECT_LT(distance(robot.field.truth, {.x = 6}), 0.4);
  EXPECT_THROW(Robot{"outlives_owner yes"}, ConfigError);
}

TEST(WaypointDriver, is_stopped_by_anybody) {
  Robot robot;
  robot.rig.arrive(2);
  ASSERT_TRUE(robot.upload("square", square));
  robot.run("square");
  robot.rig.run(3s);
  ASSERT_TRUE(robot.rig.ask(Planner::code, player::Stop{}, 0, 2));
  EXPECT_TRUE(robot.rests());
  EXPECT_EQ(robot.mission().state, MissionState::paused);
}

TEST(WaypointDriver, fails_when_the_base_is_blocked_or_driven_by_others) {
  for (const bool blocked : {true, false}) {
    Robot robot;
    robot.rig.arrive(2, {"teleop", 20, true});
    ASSERT_TRUE(robot.upload("square", square));
    robot.run("square");
    robot.rig.run(3s);
    robot.field.stuck = blocked;
    if (!blocked) {
      ASSERT_TRUE(robot.rig.ask(Position2d::code, player::Take{}, 0, 2));
    }
    for (int i = 0; i < 60; ++i) {
      if (!blocked) robot.rig.send(position2d::VelocityCommand{.velocity = {.x = -0.3}}, 0, 2);
      robot.rig.run(100ms);
    }
    EXPECT_EQ(robot.mission().state, MissionState::failed);
    EXPECT_NE(std::string{robot.mission().reason.view()}.find("does not do what it is told"), std::string::npos);
    robot.rig.run(1s);
    EXPECT_EQ(robot.field.commanded, BodyVelocity{});  // no silent resumption when the other falls silent
    robot.rig.run(5s);
    EXPECT_EQ(robot.field.commanded, BodyVelocity{});
    robot.field.stuck = false;
    ASSERT_TRUE(robot.rig.ask(planner::Enable{1}));
    EXPECT_TRUE(robot.until(MissionState::finished));
  }
}

TEST(WaypointDriver, fails_without_a_pose_and_says_so) {
  Robot robot;
  ASSERT_TRUE(robot.upload("square", square));
  robot.run("square");
  robot.rig.run(3s);
  robot.field.wheels = false;
  ASSERT_TRUE(robot.until(MissionState::failed, 5s));
  EXPECT_TRUE(robot.rests());
  robot.field.wheels = true;
  robot.rig.run(1s);
  ASSERT_TRUE(robot.rig.ask(planner::Enable{1}));
  EXPECT_TRUE(robot.until(MissionState::finished));
}

TEST(WaypointDriver, refuses_missions_that_cannot_be) {
  Robot robot;
  const auto refusal = [&](std::vector<Pose2d> points, std::vector<planner::Action> actions = {}) {
    const auto answer = robot.upload("x", std::move(points), std::move(actions));
    return answer ? "" : answer.error().message();
  };
  const auto expect = [](const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
  };
  expect(refusal({}), "the mission has no points");
  expect(refusal({{1, 0, 0}, {std::nan(""), 0, 0}}), "nan");
  expect(refusal({{1e9, 0, 0}}), "point 0 is no place");
  expect(refusal(std::vector<Pose2d>(10'001)), "at most 10000");
  expect(refusal({{1, 0, 0}}, {{.point = 1}}), "action 0: point 1 of 1");
  expect(refusal({{1, 0, 0}}, {{.duration_s = -1}}), "a wait must be within");
  expect(refusal({{1, 0, 0}}, {{.act = Act::relay, .output = 8}}), "relay 8, of 8");
  expect(refusal({{1, 0, 0}}, {{.act = Act{7}}}), "there is no such action");
  expect(robot.upload("", square).error().message(), "no id");
  robot.run("never uploaded");
  expect(robot.rig.events(), "was not uploaded");
}

TEST(WaypointDriver, takes_the_same_mission_again_but_no_other_while_it_is_under_way) {
  Robot robot;
  ASSERT_TRUE(robot.upload("square", square));
  robot.run("square");
  robot.rig.run(10s);
  const auto before = robot.mission();
  EXPECT_TRUE(robot.upload("square", square));
  EXPECT_EQ(robot.mission().point, before.point);
  EXPECT_EQ(robot.mission().state, MissionState::driving);
  EXPECT_FALSE(robot.upload("other", square));
  ASSERT_TRUE(robot.rig.ask(Planner::code, player::Stop{}, 0));
  EXPECT_TRUE(robot.upload("other", square));
  EXPECT_EQ(robot.mission().point, 0U);
}

}  // namespace
}  // namespace regista
