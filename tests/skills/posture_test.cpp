// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <numbers>

#include "plant.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;

constexpr double pi = std::numbers::pi;

/// A base with a posture regulator, on its odometry unless a localizer is asked for.
struct Robot {
  explicit Robot(const std::string& keys = "", bool localizer = false)
      : field{},
        rig{plant_section + std::string{localizer ? localizer_section : ""} +
                R"(driver ( name "posture" provides ["position2d:2"] requires ["position2d:0")" +
                (localizer ? R"( "position2d:1")" : "") + "] ramp 2 turn_ramp 200 " + keys + ")",
            drivers_in(field)} {}

  void go_to(const Pose2d& pose, BodyVelocity limits = {}) {
    rig.send(position2d::PositionCommand{.pose = pose, .velocity = limits}, 2);
  }
  std::string property(std::string_view key) { return rig.text(Position2d::code, 2, key); }
  bool arrived() { return rig.ask(Position2d::code, property::GetBool{.key = Text{"arrived"}}, 2)->value != 0; }

  World field;
  testing::Rig rig;
};

TEST(PostureDriver, goes_to_poses_heading_included_and_stays) {
  Robot robot;
  robot.rig.run(100ms);
  for (const Pose2d goal : {Pose2d{1.5, 1, 0}, Pose2d{0, 0, pi / 2}, Pose2d{-1, 1, pi}, Pose2d{-1, 1, 0}}) {
    robot.go_to(goal);
    robot.rig.run(20s);
    EXPECT_TRUE(robot.arrived());
    EXPECT_LT(distance(robot.field.truth, goal), 0.05);
    EXPECT_LT(std::abs(angle_between(robot.field.truth.heading, goal.heading)), 0.05);
    EXPECT_EQ(robot.field.commanded, BodyVelocity{});
  }
  EXPECT_EQ(robot.rig.latest<position2d::State>(2)->pose, robot.rig.latest<position2d::State>(0)->pose);
}

TEST(PostureDriver, goes_by_the_pose_of_another_device) {
  Robot robot{"tolerance 0.1", true};
  robot.field.truth = {.x = 5, .y = 5, .heading = 2};
  robot.rig.run(3s);
  robot.go_to({.x = 2, .y = 2});
  robot.rig.run(30s);
  EXPECT_TRUE(robot.arrived());
  EXPECT_LT(distance(robot.field.truth, {.x = 2, .y = 2}), 0.3);
}

TEST(PostureDriver, is_no_faster_than_it_may) {
  Robot robot{"speed 0.8"};
  robot.rig.run(100ms);
  double fastest = 0;
  const auto drive = [&] {
    fastest = 0;
    for (int i = 0; i < 500; ++i) {
      robot.rig.run(10ms);
      fastest = std::max(fastest, std::abs(robot.field.commanded.x));
    }
  };
  robot.go_to({.x = 5});
  drive();
  EXPECT_NEAR(fastest, 0.8, 1e-9);
  robot.go_to({.x = -5}, {.x = 0.3});
  drive();
  EXPECT_NEAR(fastest, 0.8, 1e-9);  // while it turned round
  drive();
  EXPECT_NEAR(fastest, 0.3, 1e-9);
}

TEST(PostureDriver, passes_velocities_on_and_repeats_none) {
  Robot robot;
  robot.rig.run(100ms);
  robot.rig.send(position2d::VelocityCommand{.velocity = {.x = 0.4, .w = 0.1}}, 2);
  robot.rig.run(100ms);
  EXPECT_EQ(robot.field.commanded, (BodyVelocity{.x = 0.4, .w = 0.1}));
  robot.rig.run(1s);  // the lease, and the ramp
  EXPECT_EQ(robot.field.commanded, BodyVelocity{});
}

TEST(PostureDriver, stops_when_its_owner_is_gone) {
  Robot robot;
  robot.rig.run(100ms);
  robot.rig.arrive(2);
  robot.go_to({.x = 5});
  robot.rig.run(2s);
  EXPECT_GT(robot.field.commanded.x, 0.5);
  robot.rig.leave(testing::Rig::client);
  robot.rig.run(1s);  // 1 m/s along 2 m/s²
  EXPECT_EQ(robot.field.commanded, BodyVelocity{});
}

TEST(PostureDriver, gives_up_without_a_pose) {
  Robot robot{"", true};
  robot.rig.run(3s);
  robot.go_to({.x = 20});
  robot.rig.run(2s);
  EXPECT_GT(robot.field.commanded.x, 0.5);
  robot.field.wheels = false;  // the localizer falls silent
  robot.rig.run(3s);
  EXPECT_EQ(robot.field.commanded, BodyVelocity{});
  EXPECT_NE(robot.rig.events().find("position2d:2 stopped: no pose for"), std::string::npos);
  robot.go_to({.x = 20});
  EXPECT_NE(robot.rig.events().find("there is no pose to go from: no pose for"), std::string::npos);
}

TEST(PostureDriver, gives_up_when_the_pose_jumps) {
  Robot robot{"", true};
  robot.rig.run(3s);
  robot.go_to({.x = 20});
  robot.rig.run(2s);
  robot.field.gps_jump_m = 5;
  robot.rig.run(5s);
  EXPECT_EQ(robot.field.commanded, BodyVelocity{});
  EXPECT_NE(robot.rig.events().find("position2d:2 stopped: the pose jumped"), std::string::npos);
}

TEST(PostureDriver, gives_up_when_the_base_is_blocked_or_driven_by_others) {
  for (const bool blocked : {true, false}) {
    Robot robot;
    robot.rig.run(100ms);
    robot.rig.arrive(2, {"teleop", 20, true});
    robot.go_to({.x = 20});
    robot.rig.run(2s);
    robot.field.stuck = blocked;
    if (!blocked) {
      ASSERT_TRUE(robot.rig.ask(Position2d::code, player::Take{}, 0, 2));
    }
    for (int i = 0; i < 50; ++i) {
      if (!blocked) robot.rig.send(position2d::VelocityCommand{.velocity = {.x = -0.5}}, 0, 2);
      robot.rig.run(100ms);
    }
    EXPECT_NE(robot.rig.events().find("position2d:2 stopped: the base does not do what it is told"), std::string::npos);
    EXPECT_EQ(robot.field.commanded.x, blocked ? 0 : -0.5);
  }
}

}  // namespace
}  // namespace regista
