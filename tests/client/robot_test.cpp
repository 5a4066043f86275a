// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <mutex>
#include <regista/client/team.hpp>

#include "scripted_server.hpp"

namespace regista::client {
namespace {

using namespace std::chrono_literals;
using test::Bytes;
using test::command_type;
using test::data_type;
using test::message;
using test::Message;
using test::Peer;
using test::request_type;
using test::ScriptedServer;

const Options brief{.timeout = 150ms};

/// MOTION of position2d:0
Bytes motion(std::uint32_t state, const std::string& owner, const std::string& reason) {
  return Bytes{}.address(4, 0).text("motion").u32(state).text(owner).u32(10).f64(0.5).text(reason);
}

/// A base on a server: it drives where it is told, at once.
class BaseServer {
 public:
  explicit BaseServer(bool extended, std::uint16_t port = 0)
      : server_{[this, extended](Peer& peer) {
                  test::serve(peer, extended, [this](Peer& p, const Message& m) { return answer(p, m); });
                },
                port} {}

  [[nodiscard]] std::uint16_t port() const { return server_.port(); }
  std::vector<Message> log() {
    const std::lock_guard lock{mutex_};
    return log_;
  }
  std::size_t count(std::uint32_t interface, std::uint32_t type, std::uint32_t subtype) {
    std::size_t count = 0;
    for (const Message& m : log()) count += m.is(interface, type, subtype) ? 1 : 0;
    return count;
  }

  std::atomic<bool> blocked = false;  ///< position commands do not arrive: somebody stops the base

 private:
  bool answer(Peer& peer, const Message& m) {
    {
      const std::lock_guard lock{mutex_};
      log_.push_back(m);
    }
    if (m.is(4, command_type, 1)) {
      peer.send(message(4, m.index(), data_type, 1, test::state(m.body.f64_at(0)), ++stamp_));
    } else if (m.is(4, command_type, 2) && blocked) {
      peer.send(message(1, 0, data_type, 101, motion(1, "me", "")));
      peer.send(message(1, 0, data_type, 101, motion(0, "", "bumper pressed")));
    } else if (m.is(4, command_type, 2)) {
      peer.send(
          message(4, m.index(), data_type, 1, m.body.substr(0, 24) + m.body.substr(24, 24) + Bytes{}.u32(0), ++stamp_));
    } else if (m.is(1, request_type, 105)) {
      peer.ack(m, motion(0, "teleop@desk", "released"));
      return true;
    } else if (m.is(1, command_type, 100)) {
      peer.send(message(1, 0, data_type, 100, Bytes{}.address(4, 0).u32(1).text("kept alive")));
    }
    return false;
  }

  std::mutex mutex_;
  std::vector<Message> log_;
  double stamp_ = 0;
  ScriptedServer server_;
};

TEST(Robot, drives_as_the_readme_says) {
  BaseServer server{true};
  Robot robot{"127.0.0.1", server.port(), brief};
  Position2dProxy& base = robot.position2d();
  EXPECT_EQ(base.age(), Duration::max());
  EXPECT_EQ(base.driver(), "fakedriver");
  double x = 0;
  while (base.state().pose.x < 1.0) {
    base.set_velocity({.x = x += 0.3});
    ASSERT_TRUE(robot.read(150ms));
  }
  base.stop();
  EXPECT_NEAR(base.state().pose.x, 1.2, 1e-9);
  EXPECT_EQ(base.count(), 4u);
  EXPECT_EQ(base.latest<position2d::State>().stamp_s, 4);
  EXPECT_LT(base.age(), 150ms);
  EXPECT_EQ(server.count(1, request_type, 104), 1u);
  EXPECT_EQ(&base, &robot.device<Position2d>(0));
}

TEST(Robot, stops_the_bases_of_a_stock_server_with_velocity_zero) {
  BaseServer server{false};
  Robot robot{"127.0.0.1", server.port(), brief};
  robot.position2d().set_velocity({.x = 1});
  robot.stop();
  EXPECT_TRUE(robot.read(150ms));
  while (robot.position2d().count() < 2) ASSERT_TRUE(robot.read(150ms));
  EXPECT_EQ(robot.position2d().state().pose.x, 0);
  EXPECT_EQ(server.count(1, request_type, 104), 0u);
}

TEST(Robot, sends_each_command_once) {
  BaseServer server{true};
  {
    Robot robot{"127.0.0.1", server.port(), brief};
    robot.position2d().set_velocity({.x = 1});
    const Time end = Clock::now() + 120ms;
    while (Clock::now() < end) (void)robot.read(20ms);
  }
  EXPECT_EQ(server.count(4, command_type, 1), 1u);
}

TEST(Robot, refuses_numbers_that_are_not_finite) {
  BaseServer server{false};
  Robot robot{"127.0.0.1", server.port(), brief};
  EXPECT_THROW(robot.position2d().set_velocity({.w = NAN}), std::invalid_argument);
  EXPECT_THROW(robot.position2d().go_to({.x = INFINITY}), std::invalid_argument);
  EXPECT_THROW(robot.position2d().set_odometry({.heading = NAN}), std::invalid_argument);
}

TEST(Robot, names_host_device_request_and_reason_when_refused) {
  const ScriptedServer server{[](Peer& peer) {
    test::serve(peer, true, [](Peer& p, const Message& m) {
      if (!m.is(4, request_type, 2)) return false;
      return p.nack(m, Bytes{}.u32(0x72656173).u32(EPERM).text("emergency stop is pressed")), true;
    });
  }};
  Robot robot{"127.0.0.1", server.port(), brief};
  Position2dProxy& base = robot.position2d();
  try {
    base.set_motor_power(true);
    FAIL() << "not refused";
  } catch (const RefusedError& error) {
    EXPECT_EQ(error.what(), "position2d:0 at 127.0.0.1:" + std::to_string(server.port()) +
                                ": MOTOR_POWER refused: emergency stop is pressed");
    EXPECT_EQ(error.reason(), "emergency stop is pressed");
    EXPECT_EQ(error.context().device, "position2d:0");
    EXPECT_EQ(error.code(), std::errc::operation_not_permitted);
  }
}

TEST(Robot, names_the_server_when_there_is_none) {
  std::uint16_t port = 0;
  {
    port = ScriptedServer{nullptr}.port();
  }
  try {
    const Robot robot{"127.0.0.1", port, brief};
    FAIL() << "connected";
  } catch (const ConnectionError& error) {
    EXPECT_EQ(error.what(), "127.0.0.1:" + std::to_string(port) + ": connect: connect to 127.0.0.1 port " +
                                std::to_string(port) +
                                ": Connection refused; is the server running, and on this port?");
  }
}

TEST(Robot, throws_what_fits_the_failure) {
  std::atomic<bool> die = false;
  const ScriptedServer server{[&](Peer& peer) {
    test::serve(peer, false, [&](Peer& p, const Message& m) {
      if (die) p.close();
      return m.is(4, request_type, 1) || die;  // GET_GEOM is never answered
    });
  }};
  Robot robot{"127.0.0.1", server.port(), {.timeout = 80ms}};
  Position2dProxy& base = robot.position2d();
  EXPECT_THROW((void)base.geometry(), TimeoutError);
  EXPECT_THROW((void)base.request(position2d::ResetOdometry{}), RefusedError);
  EXPECT_THROW((void)robot.status(), RefusedError);  // a stock server has none
  die = true;
  EXPECT_THROW(base.reset_odometry(), ConnectionError);
  EXPECT_THROW(base.set_velocity({}), ConnectionError);
  EXPECT_THROW((void)robot.read(10ms), ConnectionError);
  EXPECT_FALSE(robot.connected());
}

TEST(Robot, gets_and_sets_properties_of_every_type) {
  const ScriptedServer server{[](Peer& peer) {
    std::map<std::uint32_t, Bytes> values;  // by the subtype of SET: the whole body
    test::serve(peer, false, [&](Peer& p, const Message& m) {
      if (m.interface() != 4 || m.subtype() < 247) return false;
      if (m.subtype() % 2 == 1) {
        values[m.subtype()] = m.body;
        return p.ack(m), true;
      }
      const auto value = values.find(m.subtype() - 1);
      value == values.end() ? p.nack(m) : p.ack(m, value->second);
      return true;
    });
  }};
  Robot robot{"127.0.0.1", server.port(), brief};
  Position2dProxy& base = robot.position2d();
  EXPECT_THROW((void)base.property<int>("n"), RefusedError);
  base.set_property("n", -3);
  base.set_property("gain", 0.25);
  base.set_property("on", true);
  base.set_property("label", "héllo wörld");
  EXPECT_EQ(base.property<int>("n"), -3);
  EXPECT_EQ(base.property<double>("gain"), 0.25);
  EXPECT_EQ(base.property<bool>("on"), true);
  EXPECT_EQ(base.property<std::string>("label"), "héllo wörld");
}

TEST(Robot, shows_each_interface_through_its_proxy) {
  Bytes gps;
  gps.u32(1000).u32(5).u32(481234567).u32(static_cast<std::uint32_t>(-116543210)).u32(519000);
  gps.f64(1.5).f64(0.1).f64(2).f64(3).u32(1).u32(9).u32(12).u32(13).f64(0.5).f64(0.75);
  const std::vector<Bytes> data{
      message(2, 0, data_type, 1, Bytes{}.u32(1 | 8).f32(12.5f).f32(80).f32(7).f32(8).u32(0), 1),
      message(67, 0, data_type, 1, Bytes{}.f32(220).u32(1).u32(1).f32(100).u32(3), 1),
      message(60, 0, data_type, 5, Bytes{}.f64(1).f64(2).f64(3).f64(0.1).f64(0.2).f64(0.3) + Bytes(96, '\0'), 1),
      message(13, 0, data_type, 1, gps, 1),
      message(20, 0, data_type, 1, Bytes{}.u32(4).u32(0b1010), 1),
      message(51, 0, data_type, 1, Bytes{}.u32(2).u32(2) + std::string{"\7\10\0\0", 4}, 1),
      message(52, 3, data_type, 1, Bytes{}.f32(0.5f).f32(0.25f).u32(0).u32(1), 1)};
  std::mutex mutex;
  std::vector<Message> commands;
  const ScriptedServer server{[&](Peer& peer) {
    test::serve(peer, false, [&](Peer& p, const Message& m) {
      if (m.type() != command_type) return false;
      const std::lock_guard lock{mutex};
      commands.push_back(m);
      if (m.interface() == 51) {
        for (const Bytes& bytes : data) p.send(bytes);
      }
      return true;
    });
  }};
  Robot robot{"127.0.0.1", server.port(), brief};
  const PowerProxy& power = robot.power();
  KickerProxy& kicker = robot.kicker();
  const ImuProxy& imu = robot.imu();
  const GpsProxy& receiver = robot.gps();
  DioProxy& dio = robot.dio();
  OpaqueProxy& opaque = robot.opaque();
  Proxy<Position1d>& lift = robot.device<Position1d>(3);

  kicker.kick(4);
  kicker.chip(3, 0.5f);
  dio.set_outputs(8, 0x81);
  lift.send(position1d::VelocityCommand{.velocity = 0.5f});
  opaque.send_bytes({1, 2, 3, 4, 5});
  while (lift.count() == 0) ASSERT_TRUE(robot.read(150ms));

  EXPECT_EQ(power.voltage_v(), 12.5);
  EXPECT_EQ(power.charge_percent(), 80);
  EXPECT_FALSE(power.power_w()) << "its valid bit is not set";
  EXPECT_EQ(kicker.state().kick_count, 3u);
  EXPECT_EQ(kicker.state().ball_detected, 1);
  EXPECT_EQ(imu.full_state().pose.yaw, 0.3);
  EXPECT_EQ(imu.latest<imu::State>().count, 0u);
  EXPECT_NEAR(receiver.latitude_deg(), 48.1234567, 1e-12);
  EXPECT_NEAR(receiver.longitude_deg(), -11.654321, 1e-12);
  EXPECT_EQ(receiver.altitude_m(), 519);
  EXPECT_TRUE(dio.input(1) && dio.input(3) && !dio.input(0) && !dio.input(4));
  EXPECT_EQ(opaque.bytes(), (std::vector<std::uint8_t>{7, 8}));
  EXPECT_EQ(lift.latest<position1d::State>().value.position, 0.5f);

  const std::lock_guard lock{mutex};
  ASSERT_EQ(commands.size(), 5u);
  EXPECT_TRUE(commands[0].is(67, command_type, 1));
  EXPECT_EQ(commands[0].body, Bytes{}.f32(4));
  EXPECT_EQ(commands[1].body, Bytes{}.f32(3).f32(0.5f));
  EXPECT_EQ(commands[2].body, Bytes{}.u32(8).u32(0x81));
  EXPECT_EQ(commands[3].index(), 3u);
  EXPECT_EQ(commands[4].body, (Bytes{}.u32(5).u32(5) + std::string{"\1\2\3\4\5\0\0\0", 8}));
}

// ---- Who drives

TEST(Robot, tells_who_drives_and_why_it_stands) {
  BaseServer server{true};
  Robot robot{"127.0.0.1", server.port(), brief};
  Position2dProxy& base = robot.position2d();
  auto seen = base.motion();
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->owner.view(), "teleop@desk");
  EXPECT_EQ(seen->reason.view(), "released");
  server.blocked = true;
  base.go_to({.x = 1});
  while (base.motion()->reason.view() != "bumper pressed") ASSERT_TRUE(robot.read(150ms));
  EXPECT_EQ(base.motion()->state, player::MotionState::stopped);
  EXPECT_EQ(server.count(1, request_type, 105), 1u) << "asked once, and followed since";

  base.take("motion", true);
  base.release();
  for (const Message& m : server.log()) {
    if (m.is(1, request_type, 102)) {
      EXPECT_EQ(m.body, Bytes{}.address(4, 0).text("motion").u32(1));
    }
  }
  EXPECT_EQ(server.count(1, request_type, 102), 1u);
  EXPECT_EQ(server.count(1, request_type, 103), 1u);
}

TEST(Robot, of_a_stock_server_is_driven_by_anybody) {
  BaseServer server{false};
  Robot robot{"127.0.0.1", server.port(), brief};
  EXPECT_FALSE(robot.position2d().motion());
  robot.position2d().take();
  robot.position2d().release();
  EXPECT_TRUE(robot.events().empty());
}

TEST(Robot, keeps_a_destination_alive_from_read_alone) {
  BaseServer server{true};
  Robot robot{"127.0.0.1", server.port(), {.timeout = 1s}};
  Position2dProxy& base = robot.position2d();
  base.go_to({.x = 1});
  // Each keep-alive is answered with an event, which is what is waited for here.
  std::size_t alive = 0;
  while (alive < 2) {
    ASSERT_TRUE(robot.read(1s));
    alive += robot.events().size();
  }
  base.set_velocity({});  // no destination any more
  const Time end = Clock::now() + 150ms;
  while (Clock::now() < end) (void)robot.read(end - Clock::now());
  EXPECT_LE(server.count(1, command_type, 100), alive + 1);
  EXPECT_EQ(server.count(4, command_type, 2), 1u) << "the destination itself is never said again";
}

TEST(Robot, sends_no_keep_alive_to_a_stock_server) {
  BaseServer server{false};
  {
    Robot robot{"127.0.0.1", server.port(), brief};
    robot.position2d().go_to({.x = 1});
    const Time end = Clock::now() + 150ms;
    while (Clock::now() < end) (void)robot.read(end - Clock::now());
  }
  EXPECT_EQ(server.count(1, command_type, 100), 0u);
}

// ---- Going places

TEST(Robot, follows_a_path_pose_by_pose) {
  BaseServer server{true};
  Robot robot{"127.0.0.1", server.port(), brief};
  const std::vector<Pose2d> path{{.x = 1}, {.x = 1, .y = 1}, {.x = 0, .y = 1, .heading = 3}};
  robot.position2d().follow(path, 1s);
  EXPECT_EQ(robot.position2d().state().pose, path.back());
  std::vector<double> goals;
  for (const Message& m : server.log()) {
    if (m.is(4, command_type, 2)) goals.push_back(m.body.f64_at(8));
  }
  EXPECT_EQ(goals, (std::vector<double>{0, 1, 1}));
}

TEST(Robot, is_there_only_with_the_right_heading) {
  BaseServer server{false};
  Robot robot{"127.0.0.1", server.port(), brief};
  Position2dProxy& base = robot.position2d();
  EXPECT_FALSE(base.is_at({})) << "nothing has been heard of it";
  base.go_to({.x = 1, .heading = 3.1});
  ASSERT_TRUE(robot.read(150ms));
  EXPECT_TRUE(base.is_at({.x = 1.04, .heading = -3.14}));
  EXPECT_FALSE(base.is_at({.x = 1.06, .heading = 3.1}));
  EXPECT_FALSE(base.is_at({.x = 1, .heading = 2.9}));
}

TEST(Robot, says_why_it_did_not_get_there) {
  BaseServer server{true};
  server.blocked = true;
  Robot robot{"127.0.0.1", server.port(), brief};
  try {
    robot.position2d().drive_to({.x = 1}, 1s);
    FAIL() << "it got there";
  } catch (const RefusedError& error) {
    EXPECT_EQ(error.reason(), "bumper pressed");
  }
}

TEST(Robot, stops_when_it_does_not_get_there_in_time) {
  const ScriptedServer server{[](Peer& peer) { test::serve(peer, true); }};
  Robot robot{"127.0.0.1", server.port(), {.timeout = 1s}};
  const Time begin = Clock::now();
  EXPECT_THROW(robot.position2d().drive_to({.x = 1}, 60ms), TimeoutError);
  EXPECT_LT(Clock::now() - begin, 300ms);
}

// ---- Reconnecting

TEST(Robot, subscribes_again_when_it_reconnects) {
  std::atomic<int> connections = 0;
  std::mutex mutex;
  std::vector<std::uint32_t> opened;
  std::vector<std::uint32_t> modes;
  const ScriptedServer server{[&](Peer& peer) {
    const int number = ++connections;
    test::serve(peer, false, [&](Peer& p, const Message& m) {
      const std::lock_guard lock{mutex};
      if (number == 2 && m.is(1, request_type, 3)) opened.push_back(m.body.u32_at(8));
      if (number == 2 && m.is(1, request_type, 5)) modes.push_back(m.body.u32_at(0));
      if (m.is(1, request_type, 4)) {
        p.ack(m);
        p.send(message(4, 0, data_type, 1, test::state(number), 10 - number));  // its clock may have been set back
        p.send(message(1, 0, test::synch_type, 1));
        return true;
      }
      if (m.type() == command_type) return p.close(), true;
      return false;
    });
  }};
  Robot robot{"127.0.0.1", server.port(), {.timeout = 150ms, .mode = player::DataMode::pull}};
  Position2dProxy& base = robot.position2d();
  (void)robot.power();
  ASSERT_TRUE(robot.read(150ms));
  EXPECT_EQ(base.state().pose.x, 1);
  base.set_velocity({});  // the server dies of it
  EXPECT_THROW(for (;;)(void) robot.read(150ms), ConnectionError);
  robot.reconnect();
  ASSERT_TRUE(robot.read(150ms));
  EXPECT_EQ(base.state().pose.x, 2);
  const std::lock_guard lock{mutex};
  EXPECT_EQ(opened, (std::vector<std::uint32_t>{4, 2}));
  EXPECT_EQ(modes, std::vector<std::uint32_t>{2});
}

TEST(Robot, reconnects_by_itself_when_asked_to) {
  auto server = std::make_unique<BaseServer>(true);
  const std::uint16_t port = server->port();
  Robot robot{"127.0.0.1", port, {.timeout = 200ms, .reconnect = true}};
  Position2dProxy& base = robot.position2d();
  base.go_to({.x = 1});
  ASSERT_TRUE(robot.read(200ms));

  // Killed with the connection open.
  robot.connection().close();
  server.reset();
  robot.connection().start();
  for (int i = 0; i < 3; ++i) {
    const Time begin = Clock::now();
    EXPECT_FALSE(robot.read(20ms));
    EXPECT_LT(Clock::now() - begin, 100ms);
  }
  EXPECT_FALSE(robot.connected());
  EXPECT_THROW(base.set_velocity({.x = 2}), ConnectionError);

  server = std::make_unique<BaseServer>(true, port);
  const Time end = Clock::now() + 5s;
  while (!robot.connected() && Clock::now() < end) (void)robot.read(50ms);
  ASSERT_TRUE(robot.connected());
  EXPECT_EQ(robot.connection().generation(), 2u);
  base.set_velocity({.x = 2});
  while (base.state().pose.x != 2) ASSERT_TRUE(robot.read(200ms));
  EXPECT_EQ(server->count(4, command_type, 2), 0u) << "the destination was not given again";
}

// ---- Several

TEST(Team, waits_for_whichever_robot_speaks_first) {
  BaseServer one{true};
  BaseServer two{false};
  Team team;
  Position2dProxy& first = team.add("127.0.0.1", one.port(), {.timeout = 1s}).position2d();
  Position2dProxy& second = team.add("127.0.0.1", two.port(), {.timeout = 1s}).position2d();
  EXPECT_EQ(team.size(), 2u);
  EXPECT_FALSE(team.read(10ms));
  second.set_velocity({.x = 2});
  ASSERT_TRUE(team.read(1s));
  EXPECT_EQ(second.state().pose.x, 2);
  EXPECT_EQ(first.count(), 0u);
  first.set_velocity({.x = 1});
  ASSERT_TRUE(team.read(1s));
  EXPECT_EQ(first.state().pose.x, 1);
}

TEST(Team, reads_the_others_before_it_tells_of_a_failure) {
  const ScriptedServer dying{[](Peer& peer) {
    test::serve(peer, false, [](Peer& p, const Message& m) { return m.type() == command_type && (p.close(), true); });
  }};
  BaseServer well{false};
  Team team;
  Position2dProxy& first = team.add("127.0.0.1", dying.port(), {.timeout = 1s}).position2d();
  Position2dProxy& second = team.add("127.0.0.1", well.port(), {.timeout = 1s}).position2d();
  first.set_velocity({});
  second.set_velocity({.x = 3});
  EXPECT_THROW(while (second.count() == 0 || team.begin()->connected())(void) team.read(1s), ConnectionError);
  while (second.count() == 0) {
    try {
      (void)team.read(1s);
    } catch (const ConnectionError&) {
      continue;
    }
  }
  EXPECT_EQ(second.state().pose.x, 3);
}

}  // namespace
}  // namespace regista::client
