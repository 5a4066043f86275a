// SPDX-License-Identifier: Apache-2.0
// What stock Player does badly with unusual input, and we must do well: one test for each line.
#include <sys/resource.h>

#include <chrono>
#include <cmath>
#include <limits>

#include "player.hpp"

namespace regista::testing {
namespace {

/// Alive: a new client gets its answer.
void expect_alive(const TestServer& server) { EXPECT_EQ(Player{server.port()}.ask(1, 0, 1).type, ack); }

TEST(PlayerWire, greets_with_32_bytes) {
  const Robot robot;
  EXPECT_TRUE(Player{robot.server.port()}.banner().starts_with("Player v."));
}

TEST(PlayerWire, nacks_a_request_to_an_unknown_device) {
  const Robot robot;
  Player client{robot.server.port()};
  const RawMessage reply = client.ask(position2d, 7, 1);
  EXPECT_EQ(reply.type, nack);
  EXPECT_EQ(reply.interface, position2d);
  EXPECT_EQ(reply.index, 7U);
  EXPECT_EQ(reply.subtype, 1U);
  EXPECT_TRUE(reply.body.empty());
}

TEST(PlayerWire, nacks_a_request_that_the_driver_does_not_handle) {
  const Robot robot;
  Player client{robot.server.port()};
  client.open();
  const RawMessage reply = client.ask(position2d, 0, 7, Pack{}.u32(0).u32(0).u32(0).bytes);  // SPEED_PID
  EXPECT_EQ(reply.type, nack);
  EXPECT_TRUE(reply.body.empty());
}

TEST(PlayerWire, nacks_an_unknown_subtype_with_and_without_a_body) {
  const Robot robot;
  Player client{robot.server.port()};
  client.open();
  EXPECT_EQ(client.ask(position2d, 0, 99).type, nack);
  EXPECT_EQ(client.ask(position2d, 0, 99, Pack{}.u32(1).bytes).type, nack);
  EXPECT_EQ(client.ask(1, 0, 99).type, nack);
  EXPECT_EQ(client.ask(1, 0, 99, Pack{}.u32(1).bytes).type, nack);
}

TEST(PlayerWire, nacks_authentication_and_name_service_as_player_does) {
  const Robot robot;
  Player client{robot.server.port()};
  EXPECT_EQ(client.ask(1, 0, 6).type, nack);
  EXPECT_EQ(client.ask(1, 0, 7, Player::text("key")).type, nack);
  EXPECT_EQ(client.ask(1, 0, 8, Pack{}.raw(Player::text("name")).u32(0).bytes).type, nack);
  EXPECT_EQ(client.ask(1, 0, 9).type, nack);
}

TEST(PlayerWire, nacks_a_body_that_is_too_short) {
  const Robot robot;
  Player client{robot.server.port()};
  client.open();
  EXPECT_EQ(client.ask(position2d, 0, 5, Pack{}.f64(1).bytes).type, nack);  // SET_ODOM wants three
}

TEST(PlayerWire, disregards_what_follows_a_body) {
  const Robot robot;
  Player client{robot.server.port()};
  client.open();
  EXPECT_EQ(client.ask(position2d, 0, 5, Pack{}.f64(1).f64(2).f64(0).u32(5).u32(6).bytes).type, ack);
}

TEST(PlayerWire, nacks_requests_and_drops_commands_to_a_device_that_is_not_subscribed) {
  const Robot robot;
  Player owner{robot.server.port()};
  owner.open();
  Player stranger{robot.server.port()};
  EXPECT_EQ(stranger.ask(position2d, 0, 1).type, nack);
  stranger.velocity(0.75);
  EXPECT_EQ(stranger.ask(1, 0, 1).type, ack);
  owner.sync();
  EXPECT_TRUE(robot.recorder.events("velocity").empty());
}

TEST(PlayerWire, does_not_keep_a_command_for_the_next_subscription) {
  const Robot robot;
  Player client{robot.server.port()};
  client.velocity(0.75);
  client.open();
  client.sync();
  EXPECT_TRUE(robot.recorder.events("velocity").empty());
}

TEST(PlayerWire, nacks_empty_bodies) {
  const Robot robot;
  Player client{robot.server.port()};
  for (const std::uint32_t subtype : {2U, 3U, 5U, 10U}) EXPECT_EQ(client.ask(1, 0, subtype).type, nack) << subtype;
  client.open();
  for (std::uint32_t subtype = 247; subtype <= 255; ++subtype) {
    EXPECT_EQ(client.ask(position2d, 0, subtype).type, nack) << subtype;
  }
}

TEST(PlayerWire, drops_an_empty_command_before_the_driver) {
  const Robot robot;
  Player client{robot.server.port()};
  client.open();
  for (std::uint32_t subtype = 1; subtype <= 4; ++subtype) {
    client.send(RawMessage{.interface = position2d, .type = command, .subtype = subtype});
  }
  client.sync();
  EXPECT_TRUE(robot.recorder.events("velocity").empty());
}

TEST(PlayerWire, never_answers_a_command) {
  const Robot robot;
  Player client{robot.server.port()};
  client.open();
  client.pull();
  client.velocity(std::nan(""));
  client.send(RawMessage{.interface = position2d, .index = 9, .type = command, .subtype = 1});
  EXPECT_EQ(client.ask(1, 0, 1).subtype, 1U);  // the first answer is that to the request
}

TEST(PlayerWire, answers_a_capability_request) {
  const Robot robot;
  Player client{robot.server.port()};
  client.open();
  EXPECT_EQ(client.ask(position2d, 0, 255, Pack{}.u32(command).u32(1).bytes).type, ack);
  EXPECT_EQ(client.ask(position2d, 0, 255, Pack{}.u32(request).u32(1).bytes).type, ack);
  EXPECT_EQ(client.ask(position2d, 0, 255, Pack{}.u32(request).u32(8).bytes).type, nack);
  EXPECT_EQ(client.ask(position2d, 0, 255, Pack{}.u32(77).u32(77).bytes).type, nack);
}

TEST(PlayerWire, closes_on_a_size_that_cannot_be) {
  const Robot robot;
  for (const std::uint32_t size : {0xFFFFFFD8U, 0xFFFFFFFFU, 0x80000000U, 0xABABABABU, 33U << 20, (1U << 20) + 1}) {
    const Player client{robot.server.port()};
    client.send(RawMessage{.interface = 1, .type = request, .subtype = 1}.encode(size));
    EXPECT_TRUE(client.closed_by_peer()) << size;
    EXPECT_EQ(robot.server.logged("size " + std::to_string(size)),
              robot.server.logged("protocol error: size " + std::to_string(size) + " > limit 1 MiB at byte 36"));
  }
  expect_alive(robot.server);
}

TEST(PlayerWire, bounds_a_count_by_the_bytes_that_are_there) {
  const Robot robot;
  Player client{robot.server.port()};
  client.open();
  const Bytes body = Pack{}.u32(0x7ffffff0).u32(0x7ffffff0).u32(0).u32(0).bytes;
  for (int i = 0; i < 50; ++i) ASSERT_EQ(client.ask(position2d, 0, 254, body).type, nack);
}

TEST(PlayerWire, closes_on_http) {
  const Robot robot;
  const Player client{robot.server.port()};
  Bytes text;
  for (const char c : std::string_view{"GET / HTTP/1.1\r\nHost: 127.0.0.1:6665\r\nUser-Agent: curl/7.88.1\r\n\r\n"}) {
    text.push_back(static_cast<std::byte>(c));
  }
  client.send(text);
  EXPECT_TRUE(client.closed_by_peer());
  EXPECT_NE(robot.server.logged("closed: protocol error").find("client 1"), std::string::npos);
  expect_alive(robot.server);
}

TEST(PlayerWire, executes_a_command_that_is_followed_by_a_close) {
  const Robot robot;
  for (int i = 1; i <= 50; ++i) {
    Player client{robot.server.port()};
    client.open();
    client.pull();  // no data come: unread ones would turn the close into a reset
    while (!client.silent_for(1ms)) (void)client.receive_message();
    const Time sent = Clock::now();
    client.velocity(i / 64.0);
    client.close();
    EXPECT_EQ(robot.recorder.velocity(sent, i / 64.0).numbers[0], i / 64.0);
    robot.recorder.rest(sent);
  }
}

TEST(PlayerWire, answers_after_the_client_has_closed_its_side) {
  const Robot robot;
  Player client{robot.server.port()};
  for (int i = 0; i < 50; ++i) client.send(RawMessage{.interface = 1, .type = request, .subtype = 1});
  client.end_output();
  for (int i = 0; i < 50; ++i) EXPECT_EQ(client.answer().type, ack);
  EXPECT_TRUE(client.closed_by_peer());
}

TEST(PlayerWire, serves_beyond_1024_descriptors) {
  constexpr rlim_t enough = 2600;  // both ends are ours
  rlimit limit{};
  ASSERT_EQ(::getrlimit(RLIMIT_NOFILE, &limit), 0);
  if (limit.rlim_max < enough) GTEST_SKIP() << "at most " << limit.rlim_max << " descriptors are allowed here";
  const rlimit raised{.rlim_cur = std::max(limit.rlim_cur, enough), .rlim_max = limit.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &raised), 0);
  const Robot robot;
  std::vector<Player> clients;
  for (int i = 0; i < 1100; ++i) clients.emplace_back(robot.server.port());
  EXPECT_EQ(clients.front().ask(1, 0, 1).type, ack);
  EXPECT_EQ(clients.back().ask(1, 0, 1).type, ack);
  clients.back().open();
  EXPECT_EQ(clients.back().next(data).interface, position2d);
}

// PUSH and PULL.

RawMessage get_data() { return {.interface = 1, .type = request, .subtype = 4}; }

TEST(PlayerWire, pull_sends_the_ack_then_data_then_synch) {
  const Robot robot;
  Player client{robot.server.port()};
  client.pull();
  client.open();
  for (int i = 0; i < 5; ++i) {
    client.send(get_data());
    RawMessage message = client.receive_message();
    EXPECT_EQ(message.type, ack);
    EXPECT_EQ(message.subtype, 4U);
    EXPECT_TRUE(message.body.empty());
    std::size_t data_messages = 0;
    while ((message = client.receive_message()).type == data) ++data_messages;
    EXPECT_GE(data_messages, 1U);
    EXPECT_EQ(message.type, synch);
    EXPECT_EQ(message.interface, 1U);
    EXPECT_EQ(message.subtype, 1U);
    EXPECT_TRUE(message.body.empty());
  }
}

TEST(PlayerWire, pull_stays_armed_until_data_come) {
  const Robot robot;
  Player client{robot.server.port()};
  client.pull();
  client.send(get_data());
  client.send(get_data());  // a second ACK, one SYNCH
  EXPECT_EQ(client.answer().subtype, 4U);
  EXPECT_EQ(client.answer().subtype, 4U);
  EXPECT_TRUE(client.silent_for(50ms));
  client.send(RawMessage{.interface = 1, .type = request, .subtype = 3, .body = Player::device_body(0, 1)});
  EXPECT_EQ(client.receive_message().type, ack);
  EXPECT_EQ(client.receive_message().type, data);
  EXPECT_EQ(client.receive_message().type, synch);
  EXPECT_TRUE(client.silent_for(50ms));
}

TEST(PlayerWire, pull_says_how_many_were_lost) {
  const Robot robot{"", 5000};
  Player client{robot.server.port()};
  client.pull();
  client.open();
  // The queue holds 1024, the newest.
  RawMessage end;
  double first = 0;
  double last = 0;
  std::uint32_t kept = 0;
  for (int i = 0; i < 100 && end.subtype != 2; ++i) {
    std::this_thread::sleep_for(400ms);  // what a slow client does, not a wait for something
    client.send(get_data());
    (void)client.answer();
    first = 0;
    kept = 0;
    for (end = client.receive_message(); end.type == data; end = client.receive_message(), ++kept) {
      first = first == 0 ? end.timestamp_s : first;
      last = end.timestamp_s;
    }
  }
  ASSERT_EQ(end.type, synch);
  ASSERT_EQ(end.body.size(), 4U);
  EXPECT_GT(end.u32(0), 1U);
  EXPECT_EQ(kept, 1024U);
  EXPECT_GT(last, first);
  client.send(get_data());  // counted once
  EXPECT_EQ(client.next(synch).subtype, 1U);
}

Bytes rule(std::int32_t interface, std::int32_t index, std::int32_t type, std::int32_t subtype, std::int32_t replace) {
  Pack pack;
  for (const std::int32_t value : {interface, index, type, subtype, replace})
    pack.u32(static_cast<std::uint32_t>(value));
  return pack.bytes;
}

/// The data of one round of pulling.
std::size_t pulled(Player& client) {
  client.send(get_data());
  (void)client.answer();
  std::size_t count = 0;
  while (client.receive_message().type == data) ++count;
  return count;
}

TEST(PlayerWire, a_replace_rule_keeps_the_newest_only) {
  const Robot robot;
  Player client{robot.server.port()};
  client.pull();
  EXPECT_EQ(client.ask(1, 0, 10, rule(-1, -1, 1, -1, 1)).type, ack);
  client.open();
  for (int i = 0; i < 10; ++i) {
    std::this_thread::sleep_for(30ms);
    EXPECT_EQ(pulled(client), 1U);
  }
}

TEST(PlayerWire, an_ignore_rule_drops_and_an_equal_pattern_changes_it) {
  const Robot robot;
  Player client{robot.server.port()};
  client.pull();
  EXPECT_EQ(client.ask(1, 0, 10, rule(4, 0, 1, 1, 2)).type, ack);
  client.open();
  client.send(get_data());
  (void)client.answer();
  EXPECT_TRUE(client.silent_for(100ms));
  EXPECT_EQ(client.ask(1, 0, 10, rule(4, 0, 1, 1, 0)).type, ack);
  EXPECT_EQ(client.next(data).interface, position2d);
}

TEST(PlayerWire, the_first_rule_that_fits_wins) {
  const Robot robot;
  Player client{robot.server.port()};
  client.pull();
  EXPECT_EQ(client.ask(1, 0, 10, rule(4, 0, 1, 1, 1)).type, ack);
  EXPECT_EQ(client.ask(1, 0, 10, rule(-1, -1, -1, -1, 2)).type, ack);
  client.open();
  EXPECT_EQ(pulled(client), 1U);
}

TEST(PlayerWire, an_unknown_data_mode_is_acknowledged_and_changes_nothing) {
  const Robot robot;
  Player client{robot.server.port()};
  client.pull();
  EXPECT_EQ(client.ask(1, 0, 5, Pack{}.u32(9).bytes).type, ack);
  client.open();
  EXPECT_TRUE(client.silent_for(50ms));
}

// Subscriptions.

TEST(PlayerWire, opening_twice_delivers_data_once) {
  const Robot robot;
  Player client{robot.server.port()};
  client.open();
  client.open();
  double last = 0;
  for (int i = 0; i < 20; ++i) {
    const RawMessage message = client.next(data);
    EXPECT_GT(message.timestamp_s, last);  // libplayerc++ asks for strictly increasing stamps
    last = message.timestamp_s;
  }
  // Closing once is enough, then nothing comes.
  EXPECT_EQ(client.device(0, 2).u32(16), 2U);
  EXPECT_TRUE(client.silent_for(50ms));
}

TEST(PlayerWire, data_do_not_come_twice) {
  const Robot robot;
  Player once{robot.server.port()};
  Player twice{robot.server.port()};
  once.open();
  twice.open();
  twice.open();
  const double start = std::max(once.next(data).timestamp_s, twice.next(data).timestamp_s);
  const auto count = [&](Player& client) {
    int seen = 0;
    for (double stamp = 0; stamp < start + 0.5;) {
      stamp = client.next(data).timestamp_s;
      seen += stamp > start && stamp < start + 0.5 ? 1 : 0;
    }
    return seen;
  };
  EXPECT_EQ(count(once), count(twice));
}

TEST(PlayerWire, a_foreign_close_takes_nothing_from_others) {
  const Robot robot;
  Player owner{robot.server.port()};
  owner.open();
  Player stranger{robot.server.port()};
  const RawMessage reply = stranger.device(0, 2);
  EXPECT_EQ(reply.type, ack);
  EXPECT_EQ(reply.u32(16), 3U);
  owner.sync();
  EXPECT_TRUE(robot.recorder.events("close").empty());
  EXPECT_EQ(owner.next(data).interface, position2d);
}

TEST(PlayerWire, an_unknown_device_cannot_be_opened) {
  const Robot robot;
  Player client{robot.server.port()};
  const RawMessage reply = client.device(5);
  EXPECT_EQ(reply.type, nack);
  ASSERT_EQ(reply.body.size(), 28U);
  EXPECT_EQ(reply.u32(16), 3U);
}

TEST(PlayerWire, an_unknown_access_is_access_3) {
  const Robot robot;
  Player client{robot.server.port()};
  const RawMessage reply = client.device(0, 9);
  EXPECT_EQ(reply.type, ack);
  EXPECT_EQ(reply.u32(16), 3U);
}

TEST(PlayerWire, a_driver_that_does_not_open_is_a_nack) {
  const Robot robot{"fault \"error\" at \"open\" times 1000"};
  Player client{robot.server.port()};
  const RawMessage reply = client.device(0);
  EXPECT_EQ(reply.type, nack);
  EXPECT_EQ(reply.u32(16), 3U);
}

TEST(PlayerWire, an_open_is_answered_with_the_address_and_the_drivers_name) {
  const Robot robot;
  Player client{robot.server.port()};
  const RawMessage reply = client.device(0);
  EXPECT_EQ(to_hex(reply.body).substr(0, 8), "0100007f");
  EXPECT_EQ(reply.u32(4), robot.server.port());
  EXPECT_EQ(reply.u32(20), 10U);  // "fake_base" and its NUL
  EXPECT_EQ(to_hex(reply.body).substr(56), "66616b655f62617365000000");
}

TEST(PlayerWire, the_first_subscriber_opens_and_the_last_closes) {
  const Robot robot;
  const Time begin = Clock::now();
  {
    Player first{robot.server.port()};
    Player second{robot.server.port()};
    first.open();
    second.open();
    EXPECT_EQ(first.device(0, 2).u32(16), 2U);
    second.sync();
    EXPECT_EQ(robot.recorder.events("open").size(), 1U);
    EXPECT_TRUE(robot.recorder.events("close").empty());
  }
  robot.recorder.event(begin, "close");
}

}  // namespace
}  // namespace regista::testing
