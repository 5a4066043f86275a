// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <regista/device/motion.hpp>
#include <tuple>

namespace regista {
namespace {

using namespace std::chrono_literals;
using player::MotionState;
using position2d::VelocityCommand;

constexpr SessionId alice = 1;
constexpr SessionId bob = 2;
constexpr SessionId carol = 3;

AnyCommand drive(double x, double y = 0, double w = 0) { return VelocityCommand{.velocity = {x, y, w}}; }

/// A group, three people, and a clock that stands until told.
struct Story {
  explicit Story(const MotionPolicy& policy = {}, const std::string& group = "motion")
      : motion{"position2d:0", group, policy} {
    motion.on_tell([this](std::uint8_t severity, const std::string& text) {
      told.push_back(text);
      severities.push_back(severity);
    });
  }

  Result<> command(SessionId session, const AnyCommand& command) {
    return motion.command(session, who(session), command, now, now);
  }
  Result<> take(SessionId session, bool blend = false) { return motion.take(session, who(session), blend, now); }
  /// One step; what the driver was told last.
  const AnyCommand& step(Duration dt = {}) {
    now += dt;
    if (const AnyCommand* told_now = motion.step(now, measured)) {
      output = *told_now;
      ++steps_told;
    }
    return output;
  }
  BodyVelocity velocity() const {
    const auto* command = std::get_if<VelocityCommand>(&output);
    return command == nullptr ? BodyVelocity{NAN, NAN, NAN} : command->velocity;
  }
  void run(Duration length, Duration period = 20ms) {
    for (const Time end = now + length; now < end;) step(period);
  }
  /// Repeat a command at each beat.
  void stream(SessionId session, const AnyCommand& repeated, Duration length, Duration period = 20ms) {
    for (const Time end = now + length; now < end;) {
      (void)command(session, repeated);
      step(period);
    }
  }
  const Identity& who(SessionId session) const { return people[session]; }
  std::string last_told() const { return told.empty() ? "" : told.back(); }
  MotionState state() const { return motion.status().state; }
  std::string owner() const { return std::string{motion.status().owner.view()}; }

  std::array<Identity, 4> people{
      Identity{}, {"nav@10.0.0.2", 10, false}, {"teleop@host", 10, false}, {"chief", 20, true}};
  MotionGroup motion;
  Time now{10s};
  Measured measured{};
  AnyCommand output{VelocityCommand{}};
  int steps_told = 0;
  std::vector<std::string> told;
  std::vector<int> severities;
};

TEST(Motion, tells_the_driver_a_command_once) {
  Story s;
  ASSERT_TRUE(s.command(alice, drive(1)));
  s.step();
  EXPECT_EQ(s.velocity().x, 1);
  EXPECT_EQ(s.steps_told, 1);
  s.run(100ms);
  EXPECT_EQ(s.steps_told, 1);
  EXPECT_EQ(s.state(), MotionState::driving);
  EXPECT_EQ(s.owner(), "nav@10.0.0.2");
}

TEST(Motion, belongs_to_the_first_who_commands) {
  Story s;
  ASSERT_TRUE(s.command(alice, drive(1)));
  const Result<> refused = s.command(bob, drive(-1));
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "owned by \"nav@10.0.0.2\" (prio 10) until released or 500 ms idle");
  s.step();
  EXPECT_EQ(s.velocity().x, 1);
}

TEST(Motion, may_be_had_by_another_when_released_or_idle) {
  Story s;
  ASSERT_TRUE(s.command(alice, drive(1)));
  s.step();
  s.motion.release(alice, s.now);
  s.step();
  EXPECT_EQ(s.velocity().x, 0);
  EXPECT_EQ(s.last_told(), "position2d:0 stopped: released by \"nav@10.0.0.2\"");
  ASSERT_TRUE(s.command(bob, drive(2)));
  s.step();
  s.run(501ms, 501ms);
  EXPECT_TRUE(s.command(alice, drive(1)));
}

TEST(Motion, stops_when_its_lease_runs_out) {
  Story s;
  ASSERT_TRUE(s.command(alice, drive(1)));
  s.step();
  s.step(500ms);
  EXPECT_EQ(s.velocity().x, 1) << "not before";
  EXPECT_EQ(s.motion.due(Time::max()), Time{10s} + 500ms + 1ns);
  s.step(12ms);
  EXPECT_EQ(s.velocity().x, 0);
  const std::string reason = "no command for 512 ms (lease 500 ms); repeat it, see docs/policies.md#motion";
  EXPECT_EQ(s.last_told(), "position2d:0 stopped: " + reason);
  EXPECT_EQ(s.motion.status().reason.view(), reason);
  EXPECT_EQ(s.state(), MotionState::stopped);
  EXPECT_EQ(s.owner(), "");
  EXPECT_EQ(s.motion.due(Time::max()), Time::max());
}

TEST(Motion, tells_where_leases_are_explained_to_those_who_cannot_know) {
  Story s;
  ASSERT_TRUE(s.command(carol, drive(1)));  // extended
  s.step();
  s.step(512ms);
  EXPECT_EQ(s.last_told(), "position2d:0 stopped: no command for 512 ms (lease 500 ms)");
}

TEST(Motion, counts_a_lease_from_the_arrival_of_the_command) {
  Story s;
  ASSERT_TRUE(s.motion.command(alice, s.who(alice), drive(1), s.now - 400ms, s.now));
  s.step();
  EXPECT_EQ(s.velocity().x, 1);
  s.step(101ms);
  EXPECT_EQ(s.velocity().x, 0);
}

TEST(Motion, refuses_a_command_older_than_its_lease) {
  Story s;
  const Result<> refused = s.motion.command(alice, s.who(alice), drive(1), s.now - 700ms, s.now);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "command waited 700 ms for the driver (lease 500 ms)");
  s.step();
  EXPECT_EQ(s.steps_told, 0);
}

TEST(Motion, stops_when_its_owner_disconnects) {
  Story s;
  ASSERT_TRUE(s.command(bob, drive(1)));
  s.step();
  s.motion.gone(alice, s.now);
  s.step();
  EXPECT_EQ(s.velocity().x, 1) << "it was somebody else";
  s.motion.gone(bob, s.now);
  s.step();
  EXPECT_EQ(s.velocity().x, 0);
  EXPECT_EQ(s.last_told(), "position2d:0 stopped: owner \"teleop@host\" disconnected");
}

TEST(Motion, is_taken_over_through_zero) {
  Story s{{.ramp = 1}};
  s.stream(alice, drive(1), 100ms);
  ASSERT_EQ(s.velocity().x, 1);
  ASSERT_TRUE(s.take(carol));
  EXPECT_EQ(s.told.front(), "position2d:0: \"chief\" took over from \"nav@10.0.0.2\"");
  EXPECT_EQ(s.owner(), "chief");
  bool stood = false;
  for (int i = 0; i < 100; ++i) {
    ASSERT_TRUE(s.command(carol, drive(2)));
    s.step(20ms);
    stood = stood || s.velocity().x == 0;
    if (!stood) {
      EXPECT_LE(s.velocity().x, 1);
    }
  }
  EXPECT_TRUE(stood);
  EXPECT_EQ(s.velocity().x, 2);
}

TEST(Motion, is_taken_over_without_a_stop_when_asked_to_blend) {
  Story s{{.ramp = 1}};
  s.stream(alice, drive(1), 100ms);
  ASSERT_TRUE(s.take(carol, true));
  s.step(20ms);
  EXPECT_EQ(s.velocity().x, 1);
  ASSERT_TRUE(s.command(carol, drive(1.5)));
  s.step(20ms);
  EXPECT_EQ(s.velocity().x, 1.5);
}

TEST(Motion, is_not_taken_over_by_less_priority) {
  Story s;
  ASSERT_TRUE(s.command(carol, drive(1)));
  const Result<> refused = s.take(alice);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "owned by \"chief\" (prio 20) until released or 500 ms idle");
  s.motion.release(carol, s.now);
  s.step();
  EXPECT_TRUE(s.take(alice));
}

TEST(Motion, is_not_resumed_silently_by_the_old_owner) {
  Story s;
  s.stream(alice, drive(1), 100ms);
  ASSERT_TRUE(s.take(carol));
  s.motion.release(carol, s.now);
  s.stream(alice, drive(1), 3s);  // never paused
  EXPECT_EQ(s.velocity().x, 0);
  EXPECT_EQ(s.command(alice, drive(1)).error().what, "stopped or taken over: pause for 500 ms or take");
  s.run(520ms);
  ASSERT_TRUE(s.command(alice, drive(1)));
  s.step();
  EXPECT_EQ(s.velocity().x, 1);
}

TEST(Motion, may_be_taken_back) {
  Story s;
  s.stream(alice, drive(1), 100ms);
  ASSERT_TRUE(s.take(bob));
  s.step();
  ASSERT_TRUE(s.take(alice));
  ASSERT_TRUE(s.command(alice, drive(1)));
  s.run(40ms);
  EXPECT_EQ(s.velocity().x, 1);
}

TEST(Motion, is_stopped_by_anybody_and_stays_stopped) {
  Story s{{.ramp = 2}};
  s.stream(alice, drive(1), 100ms);
  s.motion.stop(0, "\"teleop@host\" asked for a stop", s.now);
  for (int i = 0; i < 100; ++i) {  // the owner streams on, and so does another who had been refused
    EXPECT_FALSE(s.command(alice, drive(1)));
    EXPECT_FALSE(s.command(bob, drive(-1)));
    s.step(20ms);
  }
  EXPECT_EQ(s.velocity().x, 0);
  EXPECT_EQ(s.told.front(), "position2d:0 stopped: \"teleop@host\" asked for a stop");
  EXPECT_EQ(s.motion.status().reason.view(), "\"teleop@host\" asked for a stop");
  ASSERT_TRUE(s.take(bob)) << "who wants to drive says so";
  ASSERT_TRUE(s.command(bob, drive(-1)));
  s.run(40ms);
  EXPECT_EQ(s.velocity().x, -1);
}

TEST(Motion, is_not_driven_for_a_new_owner_who_left_during_the_stop) {
  Story s{{.ramp = 1}};
  for (const bool by_stop : {false, true}) {
    SCOPED_TRACE(by_stop);
    s.stream(alice, drive(1), 1s);
    ASSERT_TRUE(s.take(bob));
    ASSERT_TRUE(s.command(bob, drive(-1)));
    s.step(20ms);
    by_stop ? s.motion.stop(0, "test", s.now) : s.motion.gone(bob, s.now);
    for (int i = 0; i < 100; ++i) {
      s.step(20ms);
      EXPECT_GE(s.velocity().x, 0);
    }
    EXPECT_EQ(s.state(), MotionState::stopped);
    s.run(1s);
    ASSERT_TRUE(s.take(alice));
  }
}

TEST(Motion, is_not_driven_for_who_was_taken_over_from_during_the_stop) {
  Story s{{.ramp = 1}};
  s.stream(alice, drive(1), 100ms);
  ASSERT_TRUE(s.take(bob));
  ASSERT_TRUE(s.command(bob, drive(-1)));
  ASSERT_TRUE(s.take(carol));
  for (int i = 0; i < 100; ++i) {
    s.step(20ms);
    EXPECT_GE(s.velocity().x, 0);
  }
}

TEST(Motion, does_not_drive_longer_on_a_command_because_its_owner_takes_again) {
  Story s{{.ramp = 1}};
  s.stream(alice, drive(1), 100ms);
  ASSERT_TRUE(s.take(bob));
  ASSERT_TRUE(s.command(bob, drive(-1)));  // waits until it stands, in 1 s; its lease is over before that
  for (int i = 0; i < 100; ++i) {
    ASSERT_TRUE(s.take(bob));
    s.step(20ms);
    EXPECT_GE(s.velocity().x, 0);
  }
}

TEST(Motion, refuses_what_is_not_finite) {
  Story s;
  EXPECT_EQ(s.command(alice, drive(NAN)).error().what, "cmd_vel.vx = nan");
  EXPECT_EQ(s.command(alice, drive(0, -INFINITY)).error().what, "cmd_vel.vy = -inf");
  EXPECT_EQ(s.command(alice, VelocityCommand{.age_s = -NAN}).error().what, "cmd_vel.age_s = nan");
  EXPECT_EQ(s.command(alice, position2d::PositionCommand{.pose = {.x = INFINITY}}).error().what,
            "cmd_pos.pose.x = inf");
  EXPECT_FALSE(s.command(alice, actarray::MultiSpeedCommand{.speeds = {0, NAN}}));
  EXPECT_EQ(s.owner(), "");
  s.step();
  EXPECT_EQ(s.steps_told, 0);
}

TEST(Motion, limits_speed_keeps_direction_and_counts) {
  Story s{{.max_speed = 1, .max_turn = 2}};
  ASSERT_TRUE(s.command(alice, drive(3, -4, 5)));
  s.step();
  EXPECT_DOUBLE_EQ(s.velocity().x, 0.6);
  EXPECT_DOUBLE_EQ(s.velocity().y, -0.8);
  EXPECT_EQ(s.velocity().w, 2);
  ASSERT_TRUE(s.command(alice, drive(0.6, 0.8, -2)));
  EXPECT_EQ(s.motion.take_clamped(), 1);
  EXPECT_EQ(s.motion.take_clamped(), 0);
}

TEST(Motion, goes_to_a_destination_no_faster_than_it_may) {
  Story s{{.max_speed = 0.5, .max_turn = 2}};
  ASSERT_TRUE(s.command(alice, position2d::PositionCommand{.pose = {.x = 5}}));  // 0: as fast as the base can
  s.step();
  EXPECT_EQ(std::get<position2d::PositionCommand>(s.output).velocity, (BodyVelocity{.x = 0.5, .w = 2}));
  ASSERT_TRUE(s.command(alice, position2d::PositionCommand{.pose = {.x = 5}, .velocity = {.y = 0.2}}));
  s.step();
  EXPECT_EQ(std::get<position2d::PositionCommand>(s.output).velocity, (BodyVelocity{.y = 0.2, .w = 2}));
  EXPECT_EQ(s.motion.take_clamped(), 0) << "nobody wanted to go faster";

  Story lift{{.max_speed = 0.25}};
  ASSERT_TRUE(lift.command(alice, position1d::PositionCommand{.position = 1}));
  lift.step();
  EXPECT_EQ(std::get<position1d::PositionCommand>(lift.output).velocity, 0.25F);

  Story free;
  ASSERT_TRUE(free.command(alice, position2d::PositionCommand{.pose = {.x = 5}}));
  free.step();
  EXPECT_EQ(std::get<position2d::PositionCommand>(free.output).velocity, BodyVelocity{}) << "the base's own limit";
}

TEST(Motion, stops_every_joint_of_an_array_along_the_ramp) {
  for (const AnyCommand& last : {AnyCommand{actarray::SpeedCommand{.joint = 1, .speed = -0.5}},
                                 AnyCommand{actarray::PositionCommand{.joint = 0, .position = 3}},
                                 AnyCommand{actarray::MultiPositionCommand{.positions = {3, -3}}}}) {
    Story s{{.ramp = 1}};
    ASSERT_TRUE(s.command(alice, last));
    s.step();
    s.measured.speeds = {1, -0.5};
    s.motion.gone(alice, s.now);
    s.step(100ms);
    const auto& speeds = std::get<actarray::MultiSpeedCommand>(s.output).speeds;
    ASSERT_EQ(speeds.size(), 2);
    EXPECT_FLOAT_EQ(speeds[0], 0.9F);
    EXPECT_FLOAT_EQ(speeds[1], -0.4F);
    s.run(500ms, 100ms);
    EXPECT_FLOAT_EQ(std::get<actarray::MultiSpeedCommand>(s.output).speeds[0], 0.4F);
    EXPECT_EQ(std::get<actarray::MultiSpeedCommand>(s.output).speeds[1], 0);
    s.run(500ms, 100ms);
    EXPECT_EQ(std::get<actarray::MultiSpeedCommand>(s.output).speeds, (std::vector<float>{0, 0}));
    EXPECT_EQ(s.state(), MotionState::stopped);
  }
}

TEST(Motion, stops_an_axis_from_a_destination_along_the_ramp) {
  Story s{{.ramp = 1}};
  ASSERT_TRUE(s.command(alice, position1d::PositionCommand{.position = 3}));
  s.step();
  s.measured.velocity.x = 1;
  s.motion.gone(alice, s.now);
  s.step(100ms);
  EXPECT_FLOAT_EQ(std::get<position1d::VelocityCommand>(s.output).velocity, 0.9F);
}

TEST(Motion, comes_to_speed_at_the_limit_of_acceleration) {
  Story s{{.max_acceleration = 1, .max_turn_acceleration = 4}};
  ASSERT_TRUE(s.command(alice, drive(0.3, 0.4, 1)));
  s.step();
  EXPECT_EQ(s.velocity(), BodyVelocity{});
  s.step(100ms);
  EXPECT_NEAR(s.velocity().x, 0.06, 1e-12);
  EXPECT_NEAR(s.velocity().y, 0.08, 1e-12);
  EXPECT_NEAR(s.velocity().w, 0.4, 1e-12);
  s.step(400ms);
  EXPECT_EQ(s.velocity(), (BodyVelocity{0.3, 0.4, 1}));
}

TEST(Motion, does_not_jump_after_it_drove_steadily_between_rare_steps) {
  Story s{{.lease = 2s, .max_acceleration = 1}};
  ASSERT_TRUE(s.command(alice, drive(0.1)));
  s.run(1s);
  s.now += 1s;
  ASSERT_TRUE(s.command(alice, drive(1)));
  s.step(10ms);
  EXPECT_NEAR(s.velocity().x, 0.11, 1e-12);
}

TEST(Motion, keeps_its_ramp_when_the_kind_of_command_changes) {
  Story s{{.max_acceleration = 1}};
  s.stream(alice, drive(1), 2s);
  s.stream(alice, position2d::CarCommand{.speed_mps = -1}, 500ms);
  const auto* car = std::get_if<position2d::CarCommand>(&s.output);
  ASSERT_NE(car, nullptr);
  EXPECT_NEAR(car->speed_mps, 0.5, 0.021);
  s.stream(alice, position2d::PositionCommand{.pose = {.x = 1}}, 100ms);
  s.measured.velocity = {.x = 0.8};
  s.stream(alice, drive(0), 100ms);
  EXPECT_NEAR(s.velocity().x, 0.7, 0.021) << "from what the base does";
}

RC_GTEST_PROP(Motion, ramps_reach_their_end_and_never_overshoot, ()) {
  const double limit = *rc::gen::inRange(1, 50) / 10.0;
  Story s{
      {.lease = 100s, .max_acceleration = limit, .max_turn_acceleration = limit, .ramp = limit, .turn_ramp = limit}};
  const auto number = rc::gen::map(rc::gen::inRange(-200, 200), [](int i) { return i / 100.0; });
  const BodyVelocity wanted{*number, *number, *number};
  RC_ASSERT(bool{s.command(alice, drive(wanted.x, wanted.y, wanted.w))});
  s.step();
  const auto beats = *rc::gen::container<std::vector<int>>(rc::gen::inRange(0, 200));
  const auto check = [&](const BodyVelocity& from, const BodyVelocity& to, Duration dt) {
    const BodyVelocity v = s.velocity();
    const double step = limit * seconds(dt) + 1e-9;
    RC_ASSERT(std::hypot(v.x - from.x, v.y - from.y) <= step);
    RC_ASSERT(std::abs(v.w - from.w) <= step);
    RC_ASSERT(std::hypot(v.x - to.x, v.y - to.y) <= std::hypot(from.x - to.x, from.y - to.y) + 1e-12);
    RC_ASSERT(std::abs(v.w - to.w) <= std::abs(from.w - to.w) + 1e-12);
  };
  const auto go = [&](const BodyVelocity& to) {
    for (const int ms : beats) {
      const BodyVelocity before = s.velocity();
      s.step(std::chrono::milliseconds{ms});
      check(before, to, std::chrono::milliseconds{ms});
    }
  };
  go(wanted);
  s.motion.stop(0, "test", s.now);
  go({});
  s.run(60s, 1s);
  RC_ASSERT(s.velocity() == BodyVelocity{});
  RC_ASSERT(s.state() == MotionState::stopped);
}

TEST(Motion, goes_on_to_a_destination_while_a_stock_owner_is_connected) {
  Story s;
  ASSERT_TRUE(s.command(alice, position2d::PositionCommand{.pose = {.x = 5}}));
  s.run(10s);
  EXPECT_EQ(s.state(), MotionState::driving);
  EXPECT_FALSE(s.command(bob, drive(1)));
  s.measured.velocity = {.x = 0.4};
  s.motion.gone(alice, s.now);
  s.step();
  EXPECT_EQ(s.velocity().x, 0);
  EXPECT_EQ(s.last_told(), "position2d:0 stopped: owner \"nav@10.0.0.2\" disconnected");
}

TEST(Motion, needs_keep_alives_of_an_extended_owner_on_the_way_to_a_destination) {
  Story s;
  ASSERT_TRUE(s.command(carol, position2d::PositionCommand{.pose = {.x = 5}}));
  for (int i = 0; i < 100; ++i) {
    s.motion.keep_alive(carol, s.now);
    s.motion.keep_alive(alice, s.now + 1h);
    s.step(100ms);
  }
  EXPECT_EQ(s.state(), MotionState::driving);
  s.run(520ms);
  EXPECT_EQ(s.state(), MotionState::stopped);
  EXPECT_EQ(s.last_told(), "position2d:0 stopped: no sign of life for 520 ms (lease 500 ms)");
}

TEST(Motion, gives_up_a_destination_that_the_driver_refused_and_comes_to_rest) {
  Story s{{.ramp = 1}};
  s.measured.velocity = {.x = 0.4};
  const AnyCommand goal = position2d::PositionCommand{.pose = {.x = 5}};
  ASSERT_TRUE(s.command(carol, goal));
  s.step();
  EXPECT_EQ(s.motion.refused("no camera", s.now), MotionGroup::AfterRefusal::come_to_rest);
  EXPECT_EQ(s.state(), MotionState::stopping);
  for (int i = 0; i < 39; ++i) {  // sent again at each beat, it does not hold up the stop
    s.step(10ms);
    ASSERT_TRUE(s.command(carol, goal));
    EXPECT_NEAR(s.velocity().x, 0.4 - 0.01 * (i + 1), 1e-9) << "along the ramp from what it does";
  }
  EXPECT_EQ(s.motion.status().reason, "refused: no camera");
  EXPECT_EQ(s.owner(), "chief");
  EXPECT_TRUE(s.told.empty()) << "the refusal was told already";
  s.step(10ms);
  EXPECT_EQ(s.velocity().x, 0);
  EXPECT_EQ(s.state(), MotionState::driving) << "what was sent meanwhile";
  s.step(10ms);
  EXPECT_TRUE(std::holds_alternative<position2d::PositionCommand>(s.output));
}

TEST(Motion, leaves_a_refused_velocity_to_the_next_one_or_the_lease) {
  Story s;
  ASSERT_TRUE(s.command(alice, drive(1)));
  s.step();
  EXPECT_EQ(s.motion.refused("too fast uphill", s.now), MotionGroup::AfterRefusal::carry_on);
  EXPECT_EQ(s.state(), MotionState::driving);
  s.run(520ms);
  EXPECT_EQ(s.state(), MotionState::stopped);
}

TEST(Motion, wants_a_halt_when_rest_is_refused) {
  Story s{{.ramp = 1}};
  ASSERT_TRUE(s.command(alice, drive(1)));
  s.step();
  s.motion.stop(bob, "bob says so", s.now);
  s.step(20ms);
  EXPECT_EQ(s.state(), MotionState::stopping);
  EXPECT_EQ(s.motion.refused("busy", s.now), MotionGroup::AfterRefusal::halt);
  EXPECT_EQ(s.state(), MotionState::stopped);
}

TEST(Motion, is_not_kept_alive_at_a_velocity) {
  Story s;
  ASSERT_TRUE(s.command(carol, drive(1)));
  for (int i = 0; i < 10; ++i) {
    s.motion.keep_alive(carol, s.now);
    s.step(100ms);
  }
  EXPECT_EQ(s.velocity().x, 0);
}

TEST(Motion, lets_a_mission_outlive_its_owner_when_told_so) {
  Story s{{.outlives_owner = true}};
  ASSERT_TRUE(s.command(carol, position2d::PositionCommand{.pose = {.x = 5}}));
  s.step();
  s.motion.gone(carol, s.now);
  s.run(10s);
  EXPECT_EQ(s.state(), MotionState::driving);
  EXPECT_EQ(s.owner(), "");
  ASSERT_TRUE(s.command(alice, drive(1))) << "anybody may have it";
  s.step();
  s.motion.gone(alice, s.now);
  s.step();
  EXPECT_EQ(s.velocity().x, 0) << "a velocity does not outlive anybody";
}

TEST(Motion, passes_everything_finite_to_a_sensor) {
  Story s{{.sensor = true, .max_speed = 1}};
  EXPECT_TRUE(s.command(alice, drive(5)));
  EXPECT_TRUE(s.command(bob, drive(-5)));
  EXPECT_TRUE(s.motion.command(bob, s.who(bob), drive(5), s.now - 10s, s.now));
  EXPECT_FALSE(s.command(bob, drive(NAN)));
  s.run(1s);
  EXPECT_EQ(s.steps_told, 0);
  EXPECT_TRUE(s.told.empty());
  EXPECT_EQ(s.owner(), "");
}

TEST(Motion, owns_edges_without_stopping_anything_for_them) {
  Story s{{}, "kick"};
  ASSERT_TRUE(s.command(alice, kicker::KickCommand{.speed_mps = 3}));
  EXPECT_FALSE(s.command(bob, kicker::KickCommand{.speed_mps = 3}));
  s.run(520ms);
  EXPECT_EQ(s.steps_told, 0);
  EXPECT_TRUE(s.told.empty());
  EXPECT_TRUE(s.command(bob, kicker::KickCommand{.speed_mps = 3}));
}

TEST(Motion, starts_again_after_a_fault_only_when_commanded) {
  Story s;
  s.stream(alice, drive(1), 100ms);
  s.motion.halted("driver \"x\" failed: read", true);
  EXPECT_EQ(s.state(), MotionState::fault);
  s.run(100ms);
  const int before = s.steps_told;
  s.motion.recovered();
  s.run(1s);
  EXPECT_EQ(s.steps_told, before);
  EXPECT_EQ(s.state(), MotionState::stopped);
  ASSERT_TRUE(s.command(bob, drive(0.5)));
  s.step();
  EXPECT_EQ(s.velocity().x, 0.5);
}

template <typename M>
M moving() {
  M command{};
  if constexpr (requires { command.velocity.x; })
    command.velocity = {.x = 1};
  else if constexpr (requires { command.velocity; })
    command.velocity = 1;
  if constexpr (requires { command.speed_mps; }) command.speed_mps = 1;
  if constexpr (requires { command.speed; }) command.speed = 1;
  if constexpr (requires { command.speed_radps; }) command.speed_radps = 1;
  if constexpr (requires { command.current_a; }) command.current_a = 1;
  if constexpr (requires { command.speeds; }) command.speeds = {1, -1};
  if constexpr (requires { command.currents_a; }) command.currents_a = {1, -1};
  if constexpr (requires { command.pose; }) command.pose = {.x = 1};
  if constexpr (requires { command.goal; }) command.goal = {.x = 1};
  if constexpr (requires { command.start; }) command.start = {.x = 1};
  if constexpr (requires { command.position; }) command.position = 1;
  if constexpr (requires { command.positions; }) command.positions = {1, -1};
  return command;
}

/// A set-point after which nothing moves by itself.
bool rests(const AnyCommand& command) {
  return std::visit(
      []<typename M>(const M& c) {
        if constexpr (
            requires { c.pose; } || requires { c.goal; } || requires { c.start; } || requires { c.position; } ||
            requires { c.positions; }) {
          return false;
        } else if constexpr (requires { c.velocity.x; }) {
          return c.velocity == BodyVelocity{};
        } else if constexpr (requires { c.velocity; }) {
          return c.velocity == 0;
        } else if constexpr (requires { c.speed_mps; }) {
          return c.speed_mps == 0;
        } else if constexpr (requires { c.speed; }) {
          return c.speed == 0 && c.joint == -1;
        } else if constexpr (requires { c.speed_radps; }) {
          return c.speed_radps == 0;
        } else if constexpr (requires { c.current_a; }) {
          return c.current_a == 0 && c.joint == -1;
        } else if constexpr (requires { c.speeds; }) {
          return c.speeds == std::vector<float>(c.speeds.size());
        } else if constexpr (requires { c.currents_a; }) {
          return c.currents_a == std::vector<float>(c.currents_a.size());
        } else {
          return true;  // moves nothing
        }
      },
      command);
}

TEST(Motion, of_every_kind_comes_to_rest) {
  int tried = 0;
  for_each_message(AnyCommand::Messages{}, [&]<typename M>(std::size_t) {
    if (M::message.flow == Flow::edge || std::same_as<M, player::KeepAlive>) return;
    SCOPED_TRACE(M::message.name);
    SCOPED_TRACE(M::message.interface);
    ++tried;
    Story s{{.ramp = 1, .turn_ramp = 1}, std::string{M::message.group}};
    s.measured = {.velocity = {.x = 1, .w = 1}, .speeds = {}};
    ASSERT_TRUE(s.command(alice, moving<M>()));
    s.step();
    EXPECT_EQ(s.output, AnyCommand{moving<M>()});
    s.motion.gone(alice, s.now);
    bool halted = false;
    for (int i = 0; i < 100; ++i) {
      s.step(20ms);
      halted = halted || s.motion.take_halt_request();
    }
    EXPECT_EQ(s.state(), MotionState::stopped);
    EXPECT_TRUE(rests(s.output) || halted);
  });
  EXPECT_GE(tried, 12);
}

// Whatever three people do, the device rests when nobody commanded it for a lease and a ramp.
RC_GTEST_PROP(Motion, never_outlasts_the_last_accepted_command, ()) {
  constexpr double ramp = 2;
  constexpr Duration longest = 500ms + 1s + 40ms;  // lease, ramp from 2 m/s, two beats
  Story s{{.max_speed = 2, .max_acceleration = 5, .ramp = ramp, .turn_ramp = ramp}};
  Time accepted = s.now;
  const auto actions = *rc::gen::container<std::vector<std::tuple<int, int, int, int>>>(rc::gen::tuple(
      rc::gen::inRange(0, 9), rc::gen::inRange(1, 4), rc::gen::inRange(-30, 30), rc::gen::inRange(0, 900)));
  const auto run = [&](Duration length) {
    for (const Time end = s.now + length; s.now < end;) {
      s.step(20ms);
      if (s.now - accepted > longest) RC_ASSERT(rests(s.output));
    }
  };
  for (const auto& [action, person, number, wait] : actions) {
    const auto session = static_cast<SessionId>(person);
    switch (action) {
      case 0:
      case 1:
      case 2:
        if (s.command(session, drive(number / 10.0))) accepted = s.now;
        break;
      case 3:
        if (s.command(session, position2d::CarCommand{.speed_mps = number / 10.0})) accepted = s.now;
        break;
      case 4:
        (void)s.take(session, number > 0);
        break;
      case 5:
        s.motion.release(session, s.now);
        break;
      case 6:
        s.motion.gone(session, s.now);
        break;
      case 7:
        s.motion.stop(0, "test", s.now);
        break;
      default:
        s.motion.keep_alive(session, s.now);
    }
    run(std::chrono::milliseconds{action == 8 ? wait : wait / 10});
  }
  run(3s);
}

}  // namespace
}  // namespace regista
