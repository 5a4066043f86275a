// SPDX-License-Identifier: Apache-2.0
// What a program uses that knows its devices only at run time, such as our Python package.
#include <gtest/gtest.h>

#include <pthread.h>
#include <algorithm>

#include <atomic>
#include <csignal>
#include <regista/client/robot.hpp>

#include "scripted_server.hpp"

namespace regista::client {
namespace {

using namespace std::chrono_literals;
using test::Bytes;
using test::command_type;
using test::data_type;
using test::Message;
using test::message;
using test::Peer;
using test::request_type;
using test::ScriptedServer;

/// Tells its pose as often as the y of a velocity command says; answers GET_GEOM and no other request of a base.
void serve_base(Peer& peer) {
  test::serve(peer, true, [](Peer& p, const Message& m) {
    if (m.is(4, command_type, 1)) {
      for (int i = 1; i <= static_cast<int>(m.body.f64_at(8)); ++i) {
        p.send(message(4, 0, data_type, 1, test::state(i), i));
      }
    }
    if (m.is(4, request_type, 1)) {
      Bytes body;
      for (int i = 0; i < 9; ++i) body.f64(i);
      p.ack(m, body);
      return true;
    }
    return m.interface() == 4 && m.type() == request_type;  // says nothing
  });
}

TEST(RunTime, devices_by_address_give_samples_and_take_any_request) {
  const ScriptedServer server{serve_base};
  Robot robot{"127.0.0.1", server.port()};
  ProxyBase& base = robot.device(Address{position2d::code, 0});
  EXPECT_EQ(&base, &robot.position2d());
  EXPECT_EQ(base.count_of(1), 0u);
  EXPECT_EQ(base.latest_of(99), std::nullopt);

  robot.position2d().set_velocity({.y = 2});
  while (base.count_of(1) < 2) ASSERT_TRUE(robot.read(2s));
  const std::optional<AnySample> sample = base.latest_of(1);
  ASSERT_TRUE(sample);
  EXPECT_EQ(std::get<position2d::State>(sample->value), robot.position2d().state());
  EXPECT_EQ(sample->count, 2u);
  EXPECT_EQ(sample->stamp_s, 2);
  EXPECT_EQ(base.count_of(2), 0u);

  const Result<AnyReply> reply = robot.connection().request(base.address(), AnyRequest{position2d::GetGeometry{}});
  ASSERT_TRUE(reply);
  EXPECT_EQ(std::get<position2d::Geometry>(*reply).size.height, 8);
  EXPECT_THROW(robot.device(Address{4711, 0}), std::invalid_argument);
}

TEST(RunTime, devices_open_without_waiting) {
  const ScriptedServer server{[](Peer& peer) {
    test::serve(peer, true, [](Peer& p, const Message& m) {
      const bool refused = m.is(1, request_type, 3) && m.body.u32_at(8) == gps::code;
      if (refused) p.nack(m);
      return refused;
    });
  }};
  Robot robot{"127.0.0.1", server.port()};
  std::vector<std::string> opened;
  const auto note = [&](const Result<std::string>& driver) { opened.push_back(driver ? *driver : "refused"); };
  robot.open({gps::code, 0}, note);
  EXPECT_TRUE(opened.empty());
  EXPECT_THROW(robot.open({position2d::code, 0}, note), Error) << "one request at a time";
  while (opened.empty()) robot.read(2s);
  robot.open({position2d::code, 0}, note);
  while (opened.size() < 2) robot.read(2s);
  EXPECT_EQ(opened, (std::vector<std::string>{"refused", "fakedriver"}));
  EXPECT_EQ(robot.position2d().driver(), "fakedriver");
}

TEST(RunTime, a_listener_is_told_every_message_in_order) {
  const ScriptedServer server{serve_base};
  Robot robot{"127.0.0.1", server.port()};
  std::vector<double> stamps;
  robot.listen([&](const xdr::Header& header, const AnyData&, Time) { stamps.push_back(header.timestamp_s); });
  auto& base = robot.position2d();
  base.set_velocity({.y = 100});
  while (base.count() < 100) ASSERT_TRUE(robot.read(2s));
  ASSERT_EQ(stamps.size(), 100u);
  EXPECT_TRUE(std::ranges::is_sorted(stamps));
  robot.listen({});
  base.set_velocity({.y = 1});
  while (base.count() < 101) ASSERT_TRUE(robot.read(2s));
  EXPECT_EQ(stamps.size(), 100u);
}

std::atomic<bool> interrupted = false;

/// Sends signals to this thread until the test is over: one that comes before the wait is in vain.
class Signals {
 public:
  Signals() : target_{::pthread_self()} {
    struct sigaction action{};
    action.sa_handler = [](int) {};
    (void)::sigaction(SIGUSR1, &action, nullptr);
    thread_ = std::thread{[this] {
      while (!done_) {
        std::this_thread::sleep_for(10ms);
        (void)::pthread_kill(target_, SIGUSR1);
      }
    }};
  }
  ~Signals() {
    done_ = true;
    thread_.join();
  }

 private:
  pthread_t target_;
  std::atomic<bool> done_ = false;
  std::thread thread_;
};

TEST(RunTime, a_signal_ends_a_wait_if_asked_to_and_the_connection_stays) {
  const ScriptedServer server{serve_base};
  Robot robot{"127.0.0.1", server.port(), {.timeout = 20s, .interrupted = [] { return interrupted.load(); }}};
  auto& base = robot.position2d();
  const auto code = [](auto&& work) {
    try {
      work();
    } catch (const Error& error) {
      return error.code();
    }
    return std::error_code{};
  };
  {
    const Signals signals;
    EXPECT_FALSE(robot.read(100ms)) << "nobody asks";
    interrupted = true;
    EXPECT_EQ(code([&] { (void)robot.read(20s); }), std::errc::interrupted);
    EXPECT_EQ(code([&] { (void)base.request(position2d::ResetOdometry{}); }), std::errc::interrupted);
    interrupted = false;
  }
  EXPECT_TRUE(robot.connected());
  base.set_velocity({.y = 1});
  while (base.count() < 1) ASSERT_TRUE(robot.read(2s));
}

}  // namespace
}  // namespace regista::client
