// SPDX-License-Identifier: Apache-2.0
// Whose robot it is, and when it stands. Stop times are taken from the driver's own record; the bounds leave room for a
// machine that does other things too.
#include <cmath>
#include <limits>

#include "player.hpp"

namespace regista::testing {
namespace {

constexpr Duration noise = 200ms;  ///< of a loaded machine, beyond what the table asks

/// Repeats a velocity until the driver has it.
Time drive(const Robot& robot, Player& client, double x) {
  const Time sent = Clock::now();
  client.velocity(x);
  return robot.recorder.velocity(sent, x).at;
}

TEST(Faults, f01_the_owner_disconnects) {
  const Robot robot;
  Player watcher{robot.server.port()};  // keeps the driver open
  watcher.open();
  Durations stops;
  for (int i = 0; i < 50; ++i) {
    Player owner{robot.server.port()};
    owner.identify("teleop@host", 10);
    owner.open();
    drive(robot, owner, 0.5);
    const Time gone = Clock::now();
    if (i % 2 == 0) {
      owner.close();
    } else {
      owner.reset();
    }
    stops.add(robot.recorder.rest(gone).at - gone);
  }
  stops.print("f01_stop");
  EXPECT_LT(stops.quantile(0.5), 20ms);
  EXPECT_LT(stops.quantile(0.99), 20ms + noise);
  EXPECT_EQ(robot.server.logged("stopped"), "position2d:0 stopped: owner \"teleop@host\" disconnected");
}

TEST(Faults, f02_half_open_connection) {
  const Robot robot{"lease 0.2"};
  FaultProxy proxy{robot.server.port()};
  Player client{proxy.port()};
  client.open();
  drive(robot, client, 0.5);
  const Time sent = Clock::now();
  client.velocity(0.25);
  const Time last = robot.recorder.velocity(sent, 0.25).at;
  proxy.to_server.swallow = true;
  proxy.to_client.swallow = true;
  client.velocity(0.75);
  client.close();
  const Duration stop = robot.recorder.rest(last).at - last;
  std::printf("f02_stop: %.1f ms of a lease of 200 ms\n", 1e3 * seconds(stop));
  EXPECT_GE(stop, 100ms);  // the record may be written long after the lease began
  EXPECT_LT(stop, 200ms + 10ms + 20ms + noise);
  const std::string text = robot.server.logged("stopped");
  EXPECT_TRUE(text.starts_with("position2d:0 stopped: no command for ")) << text;
  EXPECT_NE(text.find(" ms (lease 200 ms)"), std::string::npos) << text;
}

TEST(Faults, f06_command_flood) {
  const Robot robot{"fault \"hang\" at \"command\" seconds 0.002 times 1000000"};
  Player client{robot.server.port()};
  client.open();
  const Time begin = Clock::now();
  Bytes burst;
  constexpr int total = 20000;
  for (int i = 1; i <= total; ++i) {
    const Bytes one = Player::velocity_message(i).encode();
    burst.insert(burst.end(), one.begin(), one.end());
    if (i % 100 == 0) client.send(std::exchange(burst, {}));
  }
  robot.recorder.velocity(begin, total);  // the newest wins
  const double took_s = seconds(Clock::now() - begin);
  const auto velocities = robot.recorder.events("velocity");
  std::printf("f06: %.0f commands/s sent, the driver saw %zu of %d\n", total / took_s, velocities.size(), total);
  EXPECT_LT(static_cast<double>(velocities.size()), took_s / 0.002 + 2);  // one for each time that it came back
  EXPECT_TRUE(std::ranges::is_sorted(velocities, {}, [](const auto& e) { return e.numbers[0]; }));
  std::size_t told = 0;
  for (const std::string& line : robot.server.log()) {
    told += line.find("were replaced by newer ones") != std::string::npos ? 1U : 0U;
  }
  EXPECT_GE(told, 1U);
  EXPECT_LE(static_cast<double>(told), 1 + took_s / 5);
}

TEST(Faults, f06_refused_commands_are_told_once_with_a_count) {
  const Robot robot;
  Player client{robot.server.port()};
  client.open();
  for (int i = 0; i < 2000; ++i) client.velocity(std::nan(""));
  client.sync();
  std::size_t told = 0;
  for (const std::string& line : robot.server.log()) told += line.find("refused") != std::string::npos ? 1U : 0U;
  EXPECT_EQ(told, 1U);
}

TEST(Faults, f08_numbers_that_are_none) {
  const Robot robot;
  Player client{robot.server.port()};
  client.open();
  const double nan = std::nan("");
  const double infinite = std::numeric_limits<double>::infinity();
  for (const auto& [x, y, w] : {std::array{nan, 0.0, 0.0},
                                {0.0, nan, 0.0},
                                {0.0, 0.0, nan},
                                {infinite, 0.0, 0.0},
                                {0.0, -infinite, 0.0},
                                {0.0, 0.0, infinite}}) {
    client.velocity(x, y, w);
  }
  client.sync();
  EXPECT_TRUE(robot.recorder.events("velocity").empty());
  EXPECT_EQ(robot.server.logged("refused"), "position2d:0 refused: cmd_vel.vx = nan");
  // In a request it is the answer.
  EXPECT_EQ(client.ask(position2d, 0, 5, Pack{}.f64(nan).f64(0).f64(0).bytes).type, nack);
}

TEST(Faults, f08_beyond_the_limits) {
  const Robot robot{"max_speed 0.5 max_turn 90"};
  Player client{robot.server.port()};
  client.open();
  const Time sent = Clock::now();
  client.velocity(40, 30, 100);
  const auto given = robot.recorder.event(sent, "velocity").numbers;
  EXPECT_NEAR(given[0], 0.4, 1e-9);  // its direction stays
  EXPECT_NEAR(given[1], 0.3, 1e-9);
  EXPECT_NEAR(given[2], std::acos(0.0), 1e-6);
}

TEST(Faults, f09_driver_throws) {
  Recorder recorder;
  Recorder healthy;
  const TestServer server{"driver ( name \"fake_base\" provides [\"position2d:0\"] rate 100 log \"" + recorder.path() +
                              "\" fault \"throw\" at \"command\" after 1 )\n"
                              "driver ( name \"fake_base\" provides [\"position2d:1\"] rate 100 log \"" +
                              healthy.path() + "\" )",
                          {&fake_base}};
  Player client{server.port()};
  client.open(0);
  client.open(1);
  Time sent = Clock::now();
  client.velocity(0.5);
  recorder.velocity(sent, 0.5);
  sent = Clock::now();
  client.velocity(0.75);
  const Duration stop = recorder.event(sent, "halt").at - sent;
  std::printf("f09_stop: %.2f ms\n", 1e3 * seconds(stop));
  EXPECT_LT(stop, 20ms + noise);
  EXPECT_EQ(server.logged("failed"), "driver \"fake_base\" failed: command threw \"made-up fault\"; next try in 1 s");
  // The other one lives.
  sent = Clock::now();
  client.velocity(0.25, 0, 0, 1);
  healthy.velocity(sent, 0.25);
  EXPECT_EQ(client.text_property("motion.state"), "fault");
  // It is opened again by itself, and then stands until told otherwise.
  recorder.event(sent, "open");
  sent = Clock::now();
  client.sync(0);
  EXPECT_EQ(recorder.events("velocity").size(), 2U);
}

TEST(Faults, f10_driver_hangs) {
  const Robot robot{"fault \"hang\" at \"command\" after 1 seconds 0.7 out_of_band yes"};
  Player client{robot.server.port()};
  client.open();
  drive(robot, client, 0.5);
  const Time hung = drive(robot, client, 0.75);
  const Duration stop = robot.recorder.event(hung, "stop_out_of_band").at - hung;
  std::printf("f10_stop: %.1f ms\n", 1e3 * seconds(stop));
  EXPECT_GE(stop, 25ms);
  EXPECT_LT(stop, 100ms + noise);
  const std::string text = robot.server.logged("did not return");
  EXPECT_TRUE(text.starts_with("driver \"fake_base\" did not return for ")) << text;
  EXPECT_TRUE(text.ends_with(" ms; its hardware was stopped")) << text;
  // The server serves on, and asks the driver nothing.
  Player other{robot.server.port()};
  EXPECT_EQ(other.ask(1, 0, 1).type, ack);
  EXPECT_EQ(other.device(0).type, nack);
  EXPECT_EQ(robot.server.logged("hung and came back"),
            "driver \"fake_base\" failed: hung and came back; next try in 1 s");
  robot.recorder.event(hung, "halt");
}

TEST(Faults, f27_two_commanders) {
  const Robot robot;
  Player owner{robot.server.port()};
  owner.identify("nav@10.0.0.2", 10);
  owner.open();
  Player second{robot.server.port()};
  second.extend();
  second.open();
  drive(robot, owner, 0.5);
  const Time sent = Clock::now();
  second.velocity(0.75);
  EXPECT_EQ(robot.server.logged("refused"),
            "position2d:0 refused: owned by \"nav@10.0.0.2\" (prio 10) until released or 500 ms idle");
  second.sync();
  EXPECT_EQ(second.text_property("motion.owner"), "nav@10.0.0.2");
  // Idle for a lease: whoever comes next has it.
  robot.recorder.rest(sent);
  drive(robot, second, 0.75);
}

/// TAKE of position2d:0's motion.
RawMessage take(Player& client, bool blend = false) {
  return client.ask(1, 0, 102,
                    Pack{}.u32(0).u32(0).u32(position2d).u32(0).raw(Player::text("")).u32(blend ? 1 : 0).bytes);
}

TEST(Faults, f27_taking_needs_the_priority) {
  const Robot robot;
  Player owner{robot.server.port()};
  owner.identify("referee", 50);
  owner.open();
  Player second{robot.server.port()};
  second.extend();
  second.identify("nav", 10);
  second.open();
  drive(robot, owner, 0.5);
  EXPECT_EQ(take(second).type, nack);
  second.identify("operator", 50);
  EXPECT_EQ(take(second).type, ack);
  EXPECT_EQ(robot.server.logged("took over"), "position2d:0: \"operator\" took over from \"referee\"");
}

TEST(Faults, f28_take_over_goes_through_zero) {
  const Robot robot;
  Player owner{robot.server.port()};
  owner.extend();
  owner.identify("nav", 10);
  owner.open();
  Player boss{robot.server.port()};
  boss.extend();
  boss.identify("referee", 50);
  boss.open();
  drive(robot, owner, 0.5);
  const Time sent = Clock::now();
  EXPECT_EQ(take(boss).type, ack);
  boss.velocity(-0.25);
  const Time turned = robot.recorder.velocity(sent, -0.25).at;
  const Time rested = robot.recorder.rest(sent).at;
  EXPECT_LE(rested, turned);
  EXPECT_LT(rested - sent, 10ms + noise);
  // The old owner is told, and may not simply go on.
  EXPECT_EQ(robot.server.logged("stopped"), "position2d:0 stopped: taken over by \"referee\"");
  owner.velocity(0.75);
  owner.sync();
  EXPECT_TRUE(
      std::ranges::none_of(robot.recorder.events("velocity"), [](const auto& e) { return e.numbers[0] == 0.75; }));
  EXPECT_EQ(owner.text_property("motion.owner"), "referee");
}

TEST(Faults, f28_take_over_with_blend_does_not_stop) {
  const Robot robot;
  Player owner{robot.server.port()};
  owner.open();
  Player boss{robot.server.port()};
  boss.extend();
  boss.identify("referee", 50);
  boss.open();
  drive(robot, owner, 0.5);
  const Time sent = Clock::now();
  EXPECT_EQ(take(boss, true).type, ack);
  boss.velocity(-0.25);
  const Time turned = robot.recorder.velocity(sent, -0.25).at;
  EXPECT_TRUE(std::ranges::none_of(robot.recorder.events("velocity"),
                                   [&](const auto& e) { return e.at >= sent && e.at < turned && e.numbers[0] == 0; }));
}

TEST(Faults, f29_a_stock_client_that_sends_once) {
  const Robot robot;
  Player client{robot.server.port()};
  client.open();
  const Time driven = drive(robot, client, 0.5);
  const Duration stop = robot.recorder.rest(driven).at - driven;
  std::printf("f29_stop: %.1f ms of a lease of 500 ms\n", 1e3 * seconds(stop));
  EXPECT_GE(stop, 400ms);
  EXPECT_LT(stop, 500ms + 10ms + noise);
  const std::string text = robot.server.logged("stopped");
  EXPECT_TRUE(text.starts_with("position2d:0 stopped: no command for ")) << text;
  EXPECT_TRUE(text.ends_with(" ms (lease 500 ms); repeat it, see docs/policies.md#motion")) << text;
  EXPECT_EQ(client.text_property("motion.state"), "stopped");
  EXPECT_EQ("position2d:0 stopped: " + client.text_property("motion.reason"), text);
}

TEST(Faults, f20_zero_is_the_last_word_of_a_server_that_ends) {
  Robot robot;
  Player client{robot.server.port()};
  client.extend();
  client.open();
  drive(robot, client, 0.5);
  const Time asked = Clock::now();
  EXPECT_TRUE(robot.server.stop());
  EXPECT_LT(Clock::now() - asked, 2s);
  EXPECT_LT(robot.recorder.rest(asked).at - asked, 200ms);
  EXPECT_EQ(robot.server.logged("server shutting down"), "server shutting down");
  EXPECT_TRUE(client.closed_by_peer());
}

}  // namespace
}  // namespace regista::testing
