// SPDX-License-Identifier: Apache-2.0
// Clients that read nothing, send nonsense, or are too many.
#include <nlohmann/json.hpp>
#include <random>

#include "player.hpp"

namespace regista::testing {
namespace {

constexpr int small_buffer = 4096;  ///< so that what is not read waits in the server soon

nlohmann::json status(Player& client) {
  const RawMessage reply = client.ask(1, 0, 106);
  std::string text;
  for (std::uint32_t i = 0; i < reply.u32(0); ++i) text += static_cast<char>(reply.body.at(8 + i));
  while (!text.empty() && text.back() == '\0') text.pop_back();
  return nlohmann::json::parse(text);
}

Bytes requests(std::size_t count) {
  Bytes all;
  const Bytes one = RawMessage{.interface = 1, .type = request, .subtype = 1}.encode();
  for (std::size_t i = 0; i < count; ++i) all.insert(all.end(), one.begin(), one.end());
  return all;
}

TEST(Faults, f04_slow_reader_of_data_loses_some_and_they_are_counted) {
  const Robot robot{"", 2000};
  Player slow{robot.server.port(), small_buffer};
  slow.open();
  Player brisk{robot.server.port()};
  brisk.open();
  Player watcher{robot.server.port()};
  watcher.extend();
  const auto dropped = [&] { return status(watcher)["clients"][0]["data_dropped"].get<std::uint64_t>(); };
  const Time end = Clock::now() + 20s;
  while (dropped() == 0 && Clock::now() < end) {
    for (int i = 0; i < 20; ++i) (void)brisk.receive_message();
  }
  EXPECT_GT(dropped(), 0U);
  EXPECT_LE(status(watcher)["clients"][0]["pending_bytes"].get<std::size_t>(), std::size_t{256} << 10);
  EXPECT_EQ(status(watcher)["clients"][1]["data_dropped"].get<std::uint64_t>(), 0U) << "of who reads";
  EXPECT_EQ(slow.ask(1, 0, 1).type, ack);  // data alone are no reason to close
}

TEST(Faults, f04_slow_reader_of_replies_is_closed_after_five_seconds) {
  const Robot robot;
  const Player slow{robot.server.port(), small_buffer};
  Player other{robot.server.port()};
  // Replies until some wait in the server, far from filling its queue.
  const Time end = Clock::now() + 20s;
  for (bool waits = false; !waits && Clock::now() < end;) {
    slow.send(requests(50));
    (void)other.ask(1, 0, 1);
    waits = status(other)["clients"][0]["pending_bytes"].get<std::size_t>() > 0;
  }
  const Time full = Clock::now();
  const std::string text = robot.server.logged("slow consumer", 20s);
  const Duration took = Clock::now() - full;
  EXPECT_TRUE(text.starts_with("client 1 closed: slow consumer, 0.")) << text;
  EXPECT_NE(text.find(" MiB pending for 5."), std::string::npos) << text;
  EXPECT_GT(took, 4s);
  EXPECT_LT(took, 8s);
  EXPECT_EQ(other.ask(1, 0, 1).type, ack);
}

TEST(Faults, f05_request_flood_without_reading) {
  const Robot robot;
  const Player flood{robot.server.port(), small_buffer};
  Player other{robot.server.port()};
  other.open();
  const Bytes many = requests(1000);
  Durations round_trips;
  const Time end = Clock::now() + 20s;
  while (flood.try_send(many) != std::numeric_limits<std::size_t>::max() && Clock::now() < end) {
    const Time asked = Clock::now();
    other.sync();
    round_trips.add(Clock::now() - asked);
  }
  const std::string text = robot.server.logged("closed: slow consumer, ");
  EXPECT_TRUE(text.starts_with("client 1 closed: slow consumer, 0.")) << text;
  EXPECT_TRUE(text.ends_with(": more than 1024 messages")) << "why so few bytes were too many: " << text;
  for (int i = 0; i < 200; ++i) {
    const Time asked = Clock::now();
    other.sync();
    round_trips.add(Clock::now() - asked);
  }
  round_trips.print("f05_round_trip_of_others");
  EXPECT_LT(round_trips.quantile(0.5), 20ms);
}

TEST(Faults, f07_random_bytes) {
  const Robot robot;
  std::mt19937 random{7};
  for (int i = 0; i < 300; ++i) {
    const Player client{robot.server.port()};
    Bytes bytes(random() % 400);
    for (std::byte& byte : bytes) byte = static_cast<std::byte>(random() & 0xff);
    if (!bytes.empty()) client.send(bytes);
  }
  Player client{robot.server.port()};
  EXPECT_EQ(client.ask(1, 0, 1).type, ack);
}

TEST(Faults, f07_any_body_for_any_message) {
  const Robot robot{"alwayson yes"};
  std::mt19937 random{8};
  Player client{robot.server.port()};
  client.open();
  for (int i = 0; i < 3000; ++i) {
    Bytes body(random() % 80);
    for (std::byte& byte : body) byte = static_cast<std::byte>(random() % 3 == 0 ? random() & 0xff : 0);
    const std::uint32_t interface = random() % 4 == 0 ? 1 : position2d;
    client.send({.interface = interface,
                 .index = 0,
                 .type = random() % 3 == 0 ? command : request,
                 .subtype = static_cast<std::uint32_t>(random() & 0xff),
                 .body = std::move(body)});
    // Nobody asks without reading; PULL may have been asked for.
    while (!client.silent_for(0ms)) (void)client.receive_message();
  }
  Player other{robot.server.port()};
  EXPECT_EQ(other.ask(1, 0, 1).type, ack);
}

TEST(Faults, f07_protocol_error_says_what_and_where) {
  const Robot robot;
  Player client{robot.server.port()};
  EXPECT_EQ(client.ask(1, 0, 1).type, ack);  // 40 bytes before
  client.send(RawMessage{.interface = 1, .type = request, .subtype = 1}.encode(0xFFFFFFFFU));
  EXPECT_TRUE(client.closed_by_peer());
  EXPECT_EQ(robot.server.logged("protocol error"),
            "client 1 closed: protocol error: size 4294967295 > limit 1 MiB at byte 76");
}

TEST(Faults, f07_slowloris) {
  const Robot robot;
  const Player client{robot.server.port()};
  const Bytes header = RawMessage{.interface = 1, .type = request, .subtype = 1}.encode();
  const Time begin = Clock::now();
  for (std::size_t i = 0; i < header.size() && Clock::now() - begin < 20s; ++i) {
    if (client.try_send({header[i]}) != 1 || !client.silent_for(1s)) break;
  }
  const Duration took = Clock::now() - begin;
  EXPECT_GT(took, 9s);
  EXPECT_LT(took, 15s);
  EXPECT_TRUE(
      robot.server.logged("incomplete").starts_with("client 1 closed: protocol error: message incomplete after 10"));
}

TEST(Faults, f25_too_many_clients) {
  const Robot robot{"", 100, "server ( max_clients 3 )"};
  std::vector<Player> clients;
  for (int i = 0; i < 3; ++i) clients.emplace_back(robot.server.port());
  EXPECT_EQ(clients[2].ask(1, 0, 1).type, ack);
  const Player refused{robot.server.port()};
  EXPECT_TRUE(refused.banner().starts_with("Player v. refused: max_clients")) << refused.banner();
  EXPECT_TRUE(refused.closed_by_peer());
  EXPECT_EQ(robot.server.logged("refused"), "client 127.0.0.1 refused: max_clients 3 reached");
  clients.pop_back();
  const Time end = Clock::now() + 10s;
  bool served = false;
  while (!served && Clock::now() < end)
    served = Player{robot.server.port()}.banner().find("refused") == std::string::npos;
  EXPECT_TRUE(served);
}

TEST(Faults, f26_all_clients_together_are_bounded) {
  const Robot robot{"", 5000, "server ( max_pending 1048576 )"};
  std::vector<Player> clients;
  for (int i = 0; i < 16; ++i) {  // 1024 messages of 92 bytes each, if nothing bounded them: 1.4 MiB
    clients.emplace_back(robot.server.port());
    clients.back().pull();
    clients.back().open();
  }
  EXPECT_NE(robot.server.logged("max_pending").find("closed: the server holds 1 MiB for clients (max_pending)"),
            std::string::npos);
  Player other{robot.server.port()};
  EXPECT_EQ(other.ask(1, 0, 1).type, ack);
}

}  // namespace
}  // namespace regista::testing
