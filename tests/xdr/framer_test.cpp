// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <random>
#include <regista/xdr/framer.hpp>
#include <regista/xdr/registry.hpp>

namespace regista::xdr {
namespace {

using Bytes = std::vector<std::byte>;

Bytes from_hex(std::string_view hex) {
  Bytes bytes;
  for (std::size_t i = 0; i < hex.size(); i += 2) {
    bytes.push_back(static_cast<std::byte>(std::stoi(std::string{hex.substr(i, 2)}, nullptr, 16)));
  }
  return bytes;
}

void append(Bytes& to, std::span<const std::byte> from) { to.insert(to.end(), from.begin(), from.end()); }

/// A message decoded and encoded anew.
Bytes reencoded(const Frame& frame) {
  Bytes bytes(header_size + frame.body.size());
  const bool known = with_body_type(frame.header, [&]<typename Body>() {
    if (frame.body.empty()) {
      encode_message(frame.header, Empty{}, bytes);
      return;
    }
    Body body;
    ASSERT_TRUE(decode(frame.body, body));
    ASSERT_EQ(encode_message(frame.header, body, bytes), bytes.size());
  });
  EXPECT_TRUE(known);
  return bytes;
}

void feed(Framer& framer, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const auto space = framer.space();
    const std::size_t size = std::min(space.size(), bytes.size());
    std::ranges::copy(bytes.first(size), space.begin());
    framer.commit(size);
    bytes = bytes.subspan(size);
  }
}

/// All messages of a stream that arrives in these chunks, encoded anew.
std::vector<Bytes> messages(std::span<const std::byte> stream, const std::function<std::size_t()>& chunk_size) {
  Framer framer;
  std::vector<Bytes> found;
  while (!stream.empty()) {
    const std::size_t size = std::min(chunk_size(), stream.size());
    feed(framer, stream.first(size));
    stream = stream.subspan(size);
    for (;;) {
      const auto frame = framer.next();
      EXPECT_TRUE(frame);
      if (!frame || !*frame) break;
      found.push_back(reencoded(**frame));
    }
  }
  EXPECT_FALSE(framer.within_message());
  return found;
}

struct Recording {
  std::vector<Bytes> chunks;
  std::vector<Bytes> messages;
};

/// One direction of a session between stock programs, without the banner.
Recording recording(const std::string& file, const std::string& direction) {
  const auto session = nlohmann::json::parse(std::ifstream{TEST_DATA "/" + file});
  Recording recording;
  for (const auto& [key, list] : {std::pair{"chunks", &recording.chunks}, std::pair{"messages", &recording.messages}}) {
    for (const auto& entry : session[key]) {
      if (entry["dir"] == direction && entry.contains("hex"))
        list->push_back(from_hex(entry["hex"].get<std::string>()));
    }
  }
  if (direction == "s2c") {
    EXPECT_EQ(recording.chunks.front().size(), banner_size);
    recording.chunks.erase(recording.chunks.begin());
    recording.messages.erase(recording.messages.begin());
  }
  return recording;
}

TEST(Framer, finds_the_messages_of_recorded_sessions_however_they_are_cut) {
  std::mt19937 random{7};
  for (const std::string file : {"player-session-libplayercpp.json", "player-session-playerprint.json"}) {
    for (const std::string direction : {"c2s", "s2c"}) {
      const Recording recorded = recording(file, direction);
      Bytes stream;
      for (const Bytes& chunk : recorded.chunks) append(stream, chunk);

      std::size_t next = 0;
      EXPECT_EQ(messages(stream, [&] { return recorded.chunks[next++].size(); }), recorded.messages);
      EXPECT_EQ(messages(stream, [&] { return stream.size(); }), recorded.messages);
      for (std::size_t size = 1; size <= 100; ++size) {
        EXPECT_EQ(messages(stream, [&] { return size; }), recorded.messages) << "cut every " << size << " bytes";
      }
      for (int i = 0; i < 20; ++i) {
        EXPECT_EQ(messages(stream, [&] { return 1 + random() % 300; }), recorded.messages);
      }
    }
  }
}

Bytes message(std::uint32_t size, std::size_t sent) {
  Bytes bytes(header_size);
  encode_message({}, Empty{}, bytes);
  for (int i = 0; i < 4; ++i) bytes[39 - static_cast<std::size_t>(i)] = static_cast<std::byte>(size >> (8 * i));
  bytes.resize(header_size + sent, std::byte{0x5a});
  return bytes;
}

TEST(Framer, names_the_byte_at_which_a_size_is_too_large) {
  Framer framer;
  feed(framer, message(1158, 1158));  // 1198 bytes; the next size stands 36 further
  feed(framer, message(0xffffffff, 0));
  ASSERT_TRUE(*framer.next());
  const auto frame = framer.next();
  ASSERT_FALSE(frame);
  EXPECT_EQ(frame.error().code, Errc::oversize);
  EXPECT_EQ(frame.error().what, "size 4294967295 > limit 1 MiB at byte 1234");
}

TEST(Framer, counts_bytes_across_moves_of_its_buffer) {
  Framer framer;
  for (int i = 0; i < 1000; ++i) {
    feed(framer, message(60, 60));
    ASSERT_TRUE(*framer.next());
  }
  feed(framer, message(0xffffffff, 0));
  EXPECT_EQ(framer.next().error().what, "size 4294967295 > limit 1 MiB at byte 100036");
}

TEST(Framer, refuses_negative_sizes) {
  for (const std::int32_t size : {-1, -40, -1'000'000, std::numeric_limits<std::int32_t>::min()}) {
    Framer framer;
    feed(framer, message(static_cast<std::uint32_t>(size), 0));
    EXPECT_EQ(framer.next().error().code, Errc::oversize);
  }
}

TEST(Framer, takes_what_is_just_at_the_limit) {
  Framer framer{100};
  feed(framer, message(100, 100));
  const auto frame = framer.next();
  ASSERT_TRUE(frame && *frame);
  EXPECT_EQ((*frame)->body.size(), 100U);
  feed(framer, message(101, 101));
  EXPECT_EQ(framer.next().error().what, "size 101 > limit 100 bytes at byte 176");
}

TEST(Framer, refuses_a_web_browser) {
  Framer framer;
  const std::string_view request = "GET / HTTP/1.1\r\nHost: robot:6665\r\nUser-Agent: x\r\n\r\n";
  feed(framer, std::as_bytes(std::span{request}));
  EXPECT_EQ(framer.next().error().code, Errc::oversize);
}

TEST(Framer, takes_memory_for_bytes_that_came_not_for_those_promised) {
  Framer framer;
  feed(framer, message(1 << 20, 100));
  ASSERT_TRUE(framer.next());
  EXPECT_LE(framer.space().size(), 8U * 1024);
  EXPECT_TRUE(framer.within_message());
}

}  // namespace
}  // namespace regista::xdr
