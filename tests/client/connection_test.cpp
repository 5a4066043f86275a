// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <atomic>
#include <mutex>
#include <regista/client/connection.hpp>
#include <set>

#include "scripted_server.hpp"

namespace regista::client {
namespace {

using namespace std::chrono_literals;
using test::ack_type;
using test::Bytes;
using test::data_type;
using test::message;
using test::Message;
using test::Peer;
using test::request_type;
using test::ScriptedServer;

constexpr Address base{position2d::code, 0};
constexpr Options brief{.timeout = 150ms};

/// All that the client sent; read when the connection has ended.
class Log {
 public:
  void add(const Message& message) {
    const std::lock_guard lock{mutex_};
    messages_.push_back(message);
  }
  std::vector<Message> messages() {
    const std::lock_guard lock{mutex_};
    return messages_;
  }
  /// Of one interface, type and subtype.
  std::vector<Message> find(std::uint32_t interface, std::uint32_t type, std::uint32_t subtype) {
    std::vector<Message> found;
    for (const Message& m : messages()) {
      if (m.is(interface, type, subtype)) found.push_back(m);
    }
    return found;
  }

 private:
  std::mutex mutex_;
  std::vector<Message> messages_;
};

/// How long something took, for what must not hang.
template <typename F>
Duration time_of(F&& action) {
  const Time begin = Clock::now();
  action();
  return Clock::now() - begin;
}

const auto ignore = [](const xdr::Header&, const AnyData&, Time) {};

// ---- Connecting

TEST(Connection, takes_a_banner_piece_by_piece) {
  const ScriptedServer server{[](Peer& peer) {
    for (const char c : test::banner) peer.send(std::string(1, c));
    while (const auto m = peer.next()) m->subtype() == 100 ? peer.nack(*m) : peer.ack(*m);
  }};
  Connection connection{"127.0.0.1", server.port(), brief};
  const Result<> connected = connection.connect();
  ASSERT_TRUE(connected) << connected.error().message();
  EXPECT_EQ(connection.server(), "Player v.3.1.1-dev");
}

TEST(Connection, finds_a_server_by_name) {
  const ScriptedServer server{[](Peer& peer) { test::serve(peer, false); }};
  Connection connection{"localhost", server.port(), brief};
  const Result<> connected = connection.connect();
  EXPECT_TRUE(connected) << connected.error().message();
}

TEST(Connection, says_so_when_nobody_listens) {
  std::uint16_t port = 0;
  {
    port = ScriptedServer{nullptr}.port();
  }
  Connection connection{"127.0.0.1", port, brief};
  const Result<> connected = connection.connect();
  ASSERT_FALSE(connected);
  EXPECT_EQ(connected.error().code, std::errc::connection_refused);
  EXPECT_EQ(connected.error().what, "connect to 127.0.0.1 port " + std::to_string(port));
}

TEST(Connection, says_so_when_a_host_has_no_address) {
  Connection connection{"no-such-host.invalid", 6665, {.timeout = 2s}};
  const Result<> connected = connection.connect();
  ASSERT_FALSE(connected);
  // Without any resolver the look-up itself may last longer than the time-out.
  EXPECT_TRUE(connected.error().code == Errc::unknown_host || connected.error().code == Errc::no_answer);
}

TEST(Connection, gives_up_a_server_that_accepts_and_says_nothing) {
  const ScriptedServer half_open{nullptr};  // the kernel accepts, nobody else does
  Connection connection{"127.0.0.1", half_open.port(), brief};
  const Duration taken = time_of([&] {
    const Result<> connected = connection.connect();
    ASSERT_FALSE(connected);
    EXPECT_EQ(connected.error().code, std::errc::timed_out);
    EXPECT_EQ(connected.error().message(), "no greeting, 150 ms: no answer in time");
  });
  EXPECT_GE(taken, 150ms);
  EXPECT_LT(taken, 400ms);
}

TEST(Connection, refuses_whoever_does_not_greet_as_player) {
  const ScriptedServer server{[](Peer& peer) {
    peer.send("SSH-2.0-OpenSSH_9.2p1 Debian-2+deb12u3\r\n");
    peer.wait_for_end();
  }};
  Connection connection{"127.0.0.1", server.port(), brief};
  const Result<> connected = connection.connect();
  ASSERT_FALSE(connected);
  EXPECT_EQ(connected.error().code, Errc::foreign);
  EXPECT_NE(connected.error().what.find("SSH-2.0-OpenSSH"), std::string::npos);
}

TEST(Connection, refuses_garbage_after_the_banner) {
  for (const std::string& garbage : {std::string(4096, '\xab'), std::string(400, '\0')}) {
    const ScriptedServer server{[&](Peer& peer) {
      peer.send(test::banner);
      peer.send(garbage);
      peer.wait_for_end();
    }};
    Connection connection{"127.0.0.1", server.port(), brief};
    const Result<> connected = connection.connect();
    ASSERT_FALSE(connected);
    EXPECT_EQ(connected.error().code, Errc::foreign) << connected.error().message();
  }
}

// ---- What a stock server needs (docs/protocol.md)

TEST(StockServer, is_told_nothing_that_it_does_not_know) {
  Log log;
  const ScriptedServer server{
      [&](Peer& peer) { test::serve(peer, false, [&](Peer&, const Message& m) { return log.add(m), false; }); }};
  Connection connection{"127.0.0.1", server.port(), brief};
  ASSERT_TRUE(connection.connect());
  EXPECT_FALSE(connection.extended());
  ASSERT_TRUE(connection.subscribe(base, ignore));

  // HasCapability is a remote kill; the extension's messages are nonsense to it.
  const auto capability = connection.request(base, property::HasCapability{.kind = 2, .subtype = 1});
  ASSERT_FALSE(capability);
  EXPECT_EQ(capability.error().code, Errc::stock);
  EXPECT_FALSE(connection.request(server_address, player::Stop{}));
  EXPECT_FALSE(connection.send(server_address, player::KeepAlive{}));
  connection.close();

  EXPECT_EQ(log.find(1, request_type, 100).size(), 1u);
  for (const Message& m : log.messages()) {
    EXPECT_NE(m.subtype(), 255u);
    if (m.interface() == 1) {
      EXPECT_LE(m.subtype(), 100u);
    }
  }
}

TEST(StockServer, never_gets_an_empty_body_where_one_is_defined) {
  Log log;
  const ScriptedServer server{
      [&](Peer& peer) { test::serve(peer, false, [&](Peer&, const Message& m) { return log.add(m), false; }); }};
  Connection connection{"127.0.0.1", server.port(), brief};
  ASSERT_TRUE(connection.connect());
  ASSERT_TRUE(connection.subscribe(base, ignore));
  (void)connection.request(server_address, player::GetDriverInfo{});
  (void)connection.request(server_address, player::AddReplaceRule{});
  (void)connection.request(base, property::GetInt{.key = "n"});
  (void)connection.request(base, property::GetText{.key = "label"});
  (void)connection.request(base, property::SetBool{.key = "on", .value = 1});
  connection.close();

  const std::map<std::pair<std::uint32_t, std::uint32_t>, std::size_t> sizes{
      {{1, 1}, 0},   {{1, 2}, 24},   {{1, 3}, 28},   {{1, 5}, 4},   {{1, 10}, 20},
      {{1, 100}, 0}, {{4, 254}, 16}, {{4, 250}, 24}, {{4, 247}, 16}};
  std::set<std::pair<std::uint32_t, std::uint32_t>> seen;
  for (const Message& m : log.messages()) {
    const std::pair key{m.interface(), m.subtype()};
    ASSERT_TRUE(sizes.contains(key)) << key.first << '/' << key.second;
    EXPECT_EQ(m.body.size(), sizes.at(key)) << key.first << '/' << key.second;
    seen.insert(key);
  }
  EXPECT_EQ(seen.size(), sizes.size());
}

TEST(StockServer, gets_every_text_with_its_nul) {
  Log log;
  const ScriptedServer server{
      [&](Peer& peer) { test::serve(peer, false, [&](Peer&, const Message& m) { return log.add(m), false; }); }};
  Connection connection{"127.0.0.1", server.port(), brief};
  ASSERT_TRUE(connection.connect());
  // As it may come from another peer, to be passed on.
  (void)connection.request(base, property::GetDouble{.key = Text::from_bytes("label")});
  connection.close();
  const auto sent = log.find(4, request_type, 252);
  ASSERT_EQ(sent.size(), 1u);
  EXPECT_EQ(sent[0].body, Bytes{}.text("label").f64(0));
}

TEST(StockServer, may_send_data_before_a_reply_and_they_wait_for_read) {
  const ScriptedServer server{[](Peer& peer) {
    test::serve(peer, false, [](Peer& p, const Message& m) {
      if (!m.is(4, request_type, 1)) return false;
      for (int i = 1; i <= 700; ++i) p.send(message(4, 0, data_type, 1, test::state(i), i));
      p.ack(m, Bytes(72, '\0'));
      return true;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), brief};
  ASSERT_TRUE(connection.connect());
  std::vector<double> seen;
  ASSERT_TRUE(connection.subscribe(base, [&](const xdr::Header& header, const AnyData& data, Time) {
    EXPECT_EQ(header.timestamp_s, std::get<position2d::State>(data).pose.x);
    seen.push_back(header.timestamp_s);
  }));
  ASSERT_TRUE(connection.request(base, position2d::GetGeometry{}));
  EXPECT_TRUE(seen.empty());
  ASSERT_TRUE(connection.read(0ms));
  // One slot for each device and type: the newest.
  EXPECT_EQ(seen, std::vector<double>{700});
  EXPECT_EQ(connection.counters().superseded, 699u);
}

TEST(StockServer, may_leave_a_request_unanswered) {
  std::atomic<int> asked = 0;
  const ScriptedServer server{[&](Peer& peer) {
    test::serve(peer, false, [&](Peer& p, const Message& m) {
      if (!m.is(1, request_type, 1)) return false;
      if (asked++ == 0) return true;
      Message late = m;  // the answer to the first, then that to this one
      late.header.replace(32, 4, Bytes{}.u32(m.sequence() - 1));
      p.ack(late, Bytes{}.u32(1).u32(1).address(4, 7));
      p.ack(m, Bytes{}.u32(1).u32(1).address(4, 8));
      return true;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), {.timeout = 80ms}};
  ASSERT_TRUE(connection.connect());
  const Duration taken = time_of([&] {
    const auto list = connection.request(server_address, player::GetDeviceList{});
    ASSERT_FALSE(list);
    EXPECT_EQ(list.error().code, Errc::no_answer);
  });
  EXPECT_GE(taken, 80ms);
  EXPECT_LT(taken, 300ms);
  ASSERT_TRUE(connection.connected());
  const auto list = connection.request(server_address, player::GetDeviceList{});
  ASSERT_TRUE(list);
  EXPECT_EQ(list->devices.at(0).index, 8);
  EXPECT_EQ(connection.counters().stray, 1u);
}

TEST(StockServer, sends_garbage_in_the_header_of_a_synch) {
  const ScriptedServer server{[](Peer& peer) {
    test::serve(peer, false, [](Peer& p, const Message& m) {
      if (!m.is(1, request_type, 4)) return false;
      p.ack(m);
      p.send(message(4, 0, data_type, 1, test::state(1), 1));
      // Stamp and sequence are what was on its stack; the overflow count is a C++ bool with its padding.
      p.send(message(1, 0, test::synch_type, 2, Bytes{}.u32(1), 6.92357823894693e-310, 3012725687u));
      return true;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), {.timeout = 150ms, .mode = player::DataMode::pull}};
  ASSERT_TRUE(connection.connect());
  ASSERT_TRUE(connection.subscribe(base, ignore));
  for (int i = 1; i <= 3; ++i) {
    const auto count = connection.read(150ms);
    ASSERT_TRUE(count);
    EXPECT_EQ(*count, 1u);
    EXPECT_EQ(connection.counters().dropped_by_server, static_cast<std::uint64_t>(i));
  }
}

TEST(StockServer, stays_armed_in_pull_mode_until_data_come) {
  std::atomic<int> asked = 0;
  const ScriptedServer server{[&](Peer& peer) {
    test::serve(peer, false, [&](Peer& p, const Message& m) {
      if (m.is(1, request_type, 4)) return ++asked, p.ack(m), true;
      if (!m.is(4, test::command_type, 1)) return false;
      p.send(message(4, 0, data_type, 1, test::state(1), 1));
      p.send(message(1, 0, test::synch_type, 1));
      return true;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), {.timeout = 1s, .mode = player::DataMode::pull}};
  ASSERT_TRUE(connection.connect());
  ASSERT_TRUE(connection.subscribe(base, ignore));
  for (int i = 0; i < 3; ++i) EXPECT_EQ(*connection.read(10ms), 0u);
  ASSERT_TRUE(connection.send(base, position2d::VelocityCommand{}));
  EXPECT_EQ(*connection.read(1s), 1u);
  EXPECT_EQ(asked, 1);
}

TEST(StockServer, says_in_an_ack_that_a_driver_could_not_start) {
  const ScriptedServer server{[](Peer& peer) {
    test::serve(peer, false, [](Peer& p, const Message& m) {
      if (!m.is(1, request_type, 3)) return false;
      const Bytes body = Bytes{}.address(4, m.body.u32_at(12)).u32(3).text("");
      m.body.u32_at(12) == 0 ? p.ack(m, body) : p.nack(m, body);  // 1: there is no such device
      return true;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), brief};
  ASSERT_TRUE(connection.connect());
  for (const std::uint16_t index : std::array<std::uint16_t, 2>{0, 1}) {
    const auto driver = connection.subscribe({position2d::code, index}, ignore);
    ASSERT_FALSE(driver);
    EXPECT_EQ(driver.error().code.category(), refusal_category());
  }
}

TEST(StockServer, is_asked_to_close_only_what_was_opened_and_answers_before_the_end) {
  Log log;
  const ScriptedServer server{[&](Peer& peer) {
    test::serve(peer, false, [&](Peer& p, const Message& m) {
      log.add(m);
      if (!m.is(1, request_type, 3) || m.body.u32_at(8) == 4) return false;
      return p.nack(m, m.body), true;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), brief};
  ASSERT_TRUE(connection.connect());
  ASSERT_TRUE(connection.subscribe(base, ignore));
  EXPECT_FALSE(connection.subscribe(base, ignore)) << "twice: every DATA would come twice";
  EXPECT_FALSE(connection.subscribe({power::code, 0}, ignore));
  EXPECT_TRUE(connection.unsubscribe({power::code, 0})) << "never opened: CLOSE would shut another's driver";
  ASSERT_TRUE(connection.send(base, position2d::VelocityCommand{}));
  connection.close();

  const auto all = log.messages();
  std::vector<std::uint32_t> closed;
  for (const Message& m : log.find(1, request_type, 3)) {
    if (m.body.u32_at(16) == 2) closed.push_back(m.body.u32_at(8));
  }
  EXPECT_EQ(closed, std::vector<std::uint32_t>{4});
  EXPECT_TRUE(all.back().is(1, request_type, 1)) << "else the last command is discarded unparsed";
}

// ---- An extended server

TEST(Connection, hears_the_reason_of_a_refusal) {
  const ScriptedServer server{[](Peer& peer) {
    test::serve(peer, true, [](Peer& p, const Message& m) {
      if (!m.is(4, request_type, 5)) return false;
      return p.nack(m, Bytes{}.u32(0x72656173).u32(EBUSY).text("the base is moving; stop it first")), true;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), brief};
  ASSERT_TRUE(connection.connect());
  EXPECT_TRUE(connection.extended());
  EXPECT_EQ(connection.server(), "regista 0.1.0");
  const auto done = connection.request(base, position2d::SetOdometry{});
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, std::errc::device_or_resource_busy);
  EXPECT_EQ(done.error().code.category(), refusal_category());
  EXPECT_EQ(done.error().what, "the base is moving; stop it first");
  const auto plain = connection.request(base, position2d::ResetOdometry{});  // an empty NACK
  ASSERT_FALSE(plain);
  EXPECT_EQ(plain.error().what, "no reason given");
}

TEST(Connection, gives_the_reason_of_a_refusal_once) {
  std::atomic<bool> with_reason = false;
  const ScriptedServer server{[&](Peer& peer) {
    test::serve(peer, true, [&](Peer& p, const Message& m) {
      if (!m.is(1, request_type, 3)) return false;
      return p.nack(m, with_reason ? Bytes{}.u32(0x72656173).u32(ENODEV).text("there is no base") : Bytes{}), true;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), brief};
  ASSERT_TRUE(connection.subscribe(base, [](const xdr::Header&, const AnyData&, Time) {}));
  EXPECT_EQ(connection.connect().error().what, "position2d:0: no reason given");
  with_reason = true;
  const Result<> refused = connection.connect();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "position2d:0: there is no base");
  EXPECT_EQ(refused.error().message(), "position2d:0: there is no base: No such device");
}

TEST(Connection, says_who_it_is) {
  Log log;
  const ScriptedServer server{
      [&](Peer& peer) { test::serve(peer, true, [&](Peer&, const Message& m) { return log.add(m), false; }); }};
  Connection connection{"127.0.0.1", server.port(), {.timeout = 150ms, .name = "teleop@desk", .priority = 20}};
  ASSERT_TRUE(connection.connect());
  connection.close();
  const auto identify = log.find(1, request_type, 101);
  ASSERT_EQ(identify.size(), 1u);
  EXPECT_EQ(identify[0].body, Bytes{}.text("teleop@desk").u32(20));
}

// ---- Broken servers

TEST(Connection, finds_out_that_a_server_has_fallen_silent) {
  const ScriptedServer server{[](Peer& peer) {
    std::atomic<bool> stopped = false;
    test::serve(peer, false, [&](Peer&, const Message& m) {
      stopped = stopped || m.is(4, test::command_type, 1);
      return stopped.load();  // SIGSTOP
    });
  }};
  Connection connection{"127.0.0.1", server.port(), brief};
  ASSERT_TRUE(connection.connect());
  ASSERT_TRUE(connection.send(base, position2d::VelocityCommand{}));
  const Duration taken = time_of([&] {
    for (;;) {
      const auto count = connection.read(20ms);
      if (!count) {
        EXPECT_EQ(count.error().code, Errc::no_answer) << count.error().message();
        break;
      }
    }
  });
  EXPECT_GE(taken, 140ms);
  EXPECT_LT(taken, 400ms);
  EXPECT_FALSE(connection.connected());
  EXPECT_LT(time_of([&] { connection.close(); }), 20ms);
}

TEST(Connection, keeps_a_quiet_server_that_is_alive) {
  const ScriptedServer server{[](Peer& peer) { test::serve(peer, false); }};
  Connection connection{"127.0.0.1", server.port(), {.timeout = 60ms}};
  ASSERT_TRUE(connection.connect());
  const Time end = Clock::now() + 200ms;
  while (Clock::now() < end) ASSERT_TRUE(connection.read(20ms));
  EXPECT_EQ(connection.counters().stray, 0u);
}

TEST(Connection, hands_on_what_came_before_the_end) {
  for (const bool reset : {false, true}) {
    std::atomic<bool> closed = false;
    const ScriptedServer server{[&](Peer& peer) {
      test::serve(peer, false, [&](Peer& p, const Message& m) {
        if (!m.is(4, test::command_type, 1)) return false;
        if (!reset) p.send(message(4, 0, data_type, 1, test::state(5), 1));
        reset ? p.reset() : p.close();
        return closed = true;
      });
    }};
    Connection connection{"127.0.0.1", server.port(), brief};
    ASSERT_TRUE(connection.connect());
    double x = 0;
    ASSERT_TRUE(connection.subscribe(
        base, [&](const xdr::Header&, const AnyData& data, Time) { x = std::get<position2d::State>(data).pose.x; }));
    ASSERT_TRUE(connection.send(base, position2d::VelocityCommand{}));
    if (!reset) {
      const auto count = connection.read(1s);
      ASSERT_TRUE(count) << count.error().message();
      EXPECT_EQ(*count, 1u);
      EXPECT_EQ(x, 5);
    }
    const auto count = connection.read(1s);
    ASSERT_FALSE(count);
    EXPECT_EQ(count.error().code, reset ? std::errc::connection_reset : std::errc::not_connected);
    const Result<> sent = connection.send(base, position2d::VelocityCommand{});
    ASSERT_FALSE(sent);
    EXPECT_EQ(sent.error().message(), count.error().message());
  }
}

TEST(Connection, is_not_held_up_by_a_flood) {
  std::atomic<bool> done = false;
  const ScriptedServer server{[&](Peer& peer) {
    test::serve(peer, false, [&](Peer& p, const Message& m) {
      if (!m.is(4, request_type, 1)) return false;
      Bytes much;
      for (int i = 0; i < 1000; ++i) much += message(4, 0, data_type, 1, test::state(i), i);
      while (!done && p.send(much)) {
      }
      return true;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), {.timeout = 100ms}};
  ASSERT_TRUE(connection.connect());
  ASSERT_TRUE(connection.subscribe(base, ignore));
  const Duration taken = time_of([&] {
    const auto geometry = connection.request(base, position2d::GetGeometry{});  // never answered
    ASSERT_FALSE(geometry);
    EXPECT_EQ(geometry.error().code, Errc::no_answer);
  });
  EXPECT_LT(taken, 500ms);
  // A call ends although data never do.
  for (int i = 0; i < 3; ++i) {
    const auto count = connection.read(0ms);
    ASSERT_TRUE(count);
    EXPECT_LE(*count, (1u << 20) / 92 + 1000);
  }
  done = true;
}

TEST(Connection, refuses_commands_that_the_server_does_not_take) {
  std::atomic<bool> done = false;
  const ScriptedServer server{[&](Peer& peer) {
    test::serve(peer, false, [&](Peer&, const Message& m) {
      while (m.is(4, test::command_type, 1) && !done) std::this_thread::yield();
      return false;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), brief};
  ASSERT_TRUE(connection.connect());
  Result<> sent;
  const Duration taken = time_of([&] {
    for (int i = 0; i < 200'000 && sent; ++i) sent = connection.send(base, position2d::VelocityCommand{});
  });
  done = true;
  ASSERT_FALSE(sent);
  EXPECT_EQ(sent.error().code, Errc::congested);
  EXPECT_LT(taken, 5s);
}

TEST(Connection, drops_and_counts_data_that_it_cannot_use) {
  const ScriptedServer server{[](Peer& peer) {
    test::serve(peer, false, [](Peer& p, const Message& m) {
      if (!m.is(4, test::command_type, 1)) return false;
      p.send(message(4, 0, data_type, 77, "1234"));                      // unknown subtype
      p.send(message(4, 0, data_type, 1, "cut short..."));               // no whole state
      p.send(message(6, 0, data_type, 1, "1234"));                       // of no device of ours
      p.send(message(4, 0, test::nack_type, 1));                         // nobody asked
      p.send(message(4, 0, data_type, 1, test::state(1) + "and more"));  // an extension of somebody's
      return true;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), brief};
  ASSERT_TRUE(connection.connect());
  ASSERT_TRUE(connection.subscribe(base, ignore));
  ASSERT_TRUE(connection.send(base, position2d::VelocityCommand{}));
  ASSERT_EQ(*connection.read(1s), 1u);
  EXPECT_EQ(connection.counters().undecodable, 2u);
  EXPECT_EQ(connection.counters().unwanted, 1u);
  EXPECT_EQ(connection.counters().stray, 1u);
}

// ---- Without blocking

TEST(Connection, connects_and_asks_from_an_event_loop_without_blocking) {
  const ScriptedServer server{[](Peer& peer) {
    test::serve(peer, false, [](Peer& p, const Message& m) {
      if (!m.is(opaque::code, request_type, 1)) return false;
      p.send(message(opaque::code, 2, data_type, 1, Bytes{}.u32(3).u32(3) + std::string{"abc\0", 4}, 7.5));
      p.ack(m, m.body);
      return true;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), {.timeout = 1s}};
  const Address device{opaque::code, 2};
  std::optional<AnyData> data;
  double stamp = 0;
  // Noted, and opened by the handshake.
  ASSERT_TRUE(connection.subscribe(device, [&](const xdr::Header& header, const AnyData& any, Time) {
    data = any;
    stamp = header.timestamp_s;
  }));
  connection.start();
  const Time end = Clock::now() + 2s;
  std::optional<std::string> answer;
  bool asked = false;
  while (Clock::now() < end && !(answer && data)) {
    ASSERT_TRUE(connection.read(0ms));
    if (connection.connected() && !asked) {
      const AnyRequest request = opaque::Request{{1, 2, 3}};
      const auto on_reply = [&](Result<std::span<const std::byte>> body) {
        ASSERT_TRUE(body);
        answer = std::string(reinterpret_cast<const char*>(body->data()), body->size());
      };
      asked = bool{connection.post(device, request, on_reply)};
      ASSERT_TRUE(asked);
      const Result<> second = connection.post(device, request, on_reply);
      ASSERT_FALSE(second);
      EXPECT_EQ(second.error().code, Errc::busy);
      EXPECT_TRUE(connection.request_pending());
    }
    pollfd poll{.fd = connection.fileno(), .events = connection.poll_events(), .revents = 0};
    const auto pause = std::chrono::ceil<std::chrono::milliseconds>(connection.wake_time() - Clock::now());
    ::poll(&poll, 1, static_cast<int>(std::clamp(pause, 0ms, 100ms).count()));
  }
  ASSERT_TRUE(answer);
  EXPECT_EQ(*answer, (Bytes{}.u32(3).u32(3) + std::string{"\1\2\3\0", 4}));
  ASSERT_TRUE(data);
  EXPECT_EQ(std::get<opaque::State>(*data).bytes, (std::vector<std::uint8_t>{'a', 'b', 'c'}));
  EXPECT_EQ(stamp, 7.5);
  EXPECT_EQ(connection.generation(), 1u);
}

TEST(Connection, a_stop_of_everything_does_not_wait_for_the_answer_that_a_driver_owes) {
  std::optional<Message> owed;
  const ScriptedServer server{[&owed](Peer& peer) {
    test::serve(peer, true, [&owed](Peer& p, const Message& m) {
      if (m.is(opaque::code, request_type, 1)) {
        owed = m;
        return true;
      }
      if (!m.is(player::code, request_type, player::Stop::message.subtype)) return false;
      const bool everything = m.body.u32_at(8) == 0;
      if (everything) p.ack(m, "");
      if (everything && owed) p.ack(*owed, owed->body);
      return true;
    });
  }};
  Connection connection{"127.0.0.1", server.port(), {.timeout = 2s}};
  ASSERT_TRUE(connection.connect());
  std::vector<std::string> answered;
  const auto note = [&](std::string what) {
    return [&answered, what](Result<std::span<const std::byte>> body) { answered.push_back(body ? what : "none"); };
  };
  ASSERT_TRUE(connection.post({opaque::code, 2}, opaque::Request{{1, 2, 3}}, note("question")));
  EXPECT_EQ(connection.post(server_address, player::Stop{{.interface = 4}}, note("one")).error().code, Errc::busy);
  ASSERT_TRUE(connection.post(server_address, player::Stop{}, note("stop")));
  EXPECT_EQ(connection.post(server_address, player::Stop{}, note("again")).error().code, Errc::busy);
  const Time end = Clock::now() + 2s;
  while (answered.size() < 2 && Clock::now() < end) ASSERT_TRUE(connection.read(10ms));
  EXPECT_EQ(answered, (std::vector<std::string>{"stop", "question"}));
}

TEST(Connection, a_stop_that_is_not_answered_says_so_as_does_one_whose_connection_ends) {
  const ScriptedServer server{[](Peer& peer) {
    test::serve(peer, true, [](Peer&, const Message& m) {
      return m.is(player::code, request_type, player::Stop::message.subtype);
    });
  }};
  Connection connection{"127.0.0.1", server.port(), {.timeout = 100ms}};
  ASSERT_TRUE(connection.connect());
  EXPECT_EQ(connection.request(server_address, player::Stop{}).error().code, Errc::no_answer);
  std::optional<std::error_code> told;
  const auto note = [&](const Result<std::span<const std::byte>>& body) { told = body.error().code; };
  ASSERT_TRUE(connection.post(server_address, player::Stop{}, note));
  EXPECT_LT(connection.wake_time(), Clock::now() + 110ms);
  connection.abandon();
  EXPECT_EQ(told, Errc::lost);
}

TEST(Connection, read_keeps_to_its_time) {
  const ScriptedServer server{[](Peer& peer) { test::serve(peer, false); }};
  Connection connection{"127.0.0.1", server.port(), {.timeout = 2s}};
  ASSERT_TRUE(connection.connect());
  EXPECT_LT(time_of([&] { EXPECT_EQ(*connection.read(0ms), 0u); }), 20ms);
  const Duration taken = time_of([&] { EXPECT_EQ(*connection.read(30ms), 0u); });
  EXPECT_GE(taken, 30ms);
  EXPECT_LT(taken, 130ms);
}

}  // namespace
}  // namespace regista::client
