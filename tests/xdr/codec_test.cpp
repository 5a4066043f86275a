// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <new>
#include <nlohmann/json.hpp>
#include <regista/xdr/registry.hpp>

#include "counting_new.hpp"
#include "random_message.hpp"

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

/// Big-endian words of 32 bits.
Bytes words(std::initializer_list<std::uint32_t> values) {
  Bytes bytes;
  for (const std::uint32_t value : values) {
    for (int shift = 24; shift >= 0; shift -= 8) bytes.push_back(static_cast<std::byte>(value >> shift));
  }
  return bytes;
}

template <typename Body>
Bytes encoded(const Body& body, const Header& header = {}) {
  Bytes bytes(header_size + encoded_size(body));
  EXPECT_EQ(encode_message(header, body, bytes), bytes.size());
  return bytes;
}

template <typename Body>
Bytes encoded_body(const Body& body) {
  Bytes bytes = encoded(body);
  bytes.erase(bytes.begin(), bytes.begin() + header_size);
  return bytes;
}

/// What the properties below need of the layout of one body; the types end here, so that the checks compile once.
struct Layout {
  std::string_view name;
  Bytes (*random)(RandomMessage&);
  /// Decodes, and encodes what came out.
  Result<> (*recode)(std::span<const std::byte> from, Bytes& to, std::size_t& used);
  /// How often a random body allocates to be encoded, and to be decoded into itself.
  std::pair<std::size_t, std::size_t> (*allocated)(RandomMessage&);
};

template <typename Body>
Layout layout_of(std::string_view name) {
  return {.name = name,
          .random =
              [](RandomMessage& random) {
                Body body;
                random.fill(body);
                return encoded_body(body);
              },
          .recode =
              [](std::span<const std::byte> from, Bytes& to, std::size_t& used) {
                Body body;
                Result<> decoded = decode(from, body, &used);
                if (decoded) to = encoded_body(body);
                return decoded;
              },
          .allocated =
              [](RandomMessage& random) {
                Body body;
                random.fill(body);
                Bytes bytes(header_size + encoded_size(body));
                const std::size_t before = allocations().count;
                encode_message({}, body, bytes);
                const std::size_t between = allocations().count;
                (void)decode(std::span{bytes}.subspan(header_size), body);
                return std::pair{between - before, allocations().count - between};
              }};
}

std::vector<Layout> layouts() {
  std::vector<Layout> all;
  any_message(AllMessages{}, [&]<typename M>() {
    all.push_back(layout_of<M>(M::message.name));
    if constexpr (RequestType<M>) {
      if constexpr (!std::same_as<M, typename M::Reply>) all.push_back(layout_of<typename M::Reply>(M::message.name));
    }
    return false;
  });
  return all;
}

nlohmann::json golden() { return nlohmann::json::parse(std::ifstream{TEST_DATA "/player-golden.json"}); }

// --- against Player --------------------------------------------------------------------------------------------------

TEST(Header, matches_players_bytes) {
  int count = 0;
  for (const auto& vector : golden()) {
    const bool alone = vector.value("kind", "") == "header";
    const auto& fields_json = alone ? vector["fields"] : vector["header"];
    const Bytes bytes = from_hex((alone ? vector["hex"] : vector["message_hex"]).get<std::string>());
    Header header;
    ASSERT_TRUE(decode(bytes, header));
    const auto& addr = fields_json["addr"];
    const Header expected{
        .address = {.host = addr["host"], .robot = addr["robot"], .interface = addr["interf"], .index = addr["index"]},
        .kind = static_cast<Kind>(fields_json["type"].get<int>()),
        .subtype = fields_json["subtype"],
        .timestamp_s = fields_json["timestamp"],
        .sequence = fields_json["seq"],
        .size = fields_json["size"]};
    EXPECT_EQ(header, expected) << vector["name"];
    EXPECT_EQ(std::signbit(header.timestamp_s), std::signbit(expected.timestamp_s)) << vector["name"];
    EXPECT_EQ(encoded_body(expected), Bytes(bytes.begin(), bytes.begin() + header_size)) << vector["name"];
    ++count;
  }
  EXPECT_EQ(count, 80);
}

TEST(Codec, decodes_and_encodes_players_messages_to_the_same_bytes) {
  int ours = 0;
  int others = 0;
  for (const auto& vector : golden()) {
    if (vector.contains("kind")) continue;
    const Bytes bytes = from_hex(vector["message_hex"].get<std::string>());
    Header header;
    ASSERT_TRUE(decode(bytes, header));
    const auto body = std::span{bytes}.subspan(header_size);
    const bool known = with_body_type(header, [&]<typename Body>() {
      if (body.empty()) return;
      Body value;
      std::size_t used = 0;
      ASSERT_TRUE(decode(body, value, &used)) << vector["name"];
      EXPECT_EQ(used, body.size()) << vector["name"];
      EXPECT_EQ(encoded(value, header), bytes) << vector["name"];
    });
    (known ? ours : others) += 1;
    if (!known) {
      EXPECT_EQ(unknown_message(header).code, Errc::unknown_interface) << vector["name"];
    }
  }
  EXPECT_EQ(ours, 63);
  EXPECT_EQ(others, 14);
}

TEST(Codec, keeps_the_low_bits_of_small_numbers) {
  player::FindName name;
  ASSERT_TRUE(decode(words({0, 0, 65540}), name));
  EXPECT_EQ(name.port, 4);
  power::SetChargingPolicy policy;
  ASSERT_TRUE(decode(words({0x101, 0xffffff00}), policy));
  EXPECT_EQ(policy.enable_input, 1);
  EXPECT_EQ(policy.enable_output, 0);
}

TEST(Codec, extends_the_sign_of_a_char) {
  property::SetBool set;
  set.value = -1;
  EXPECT_EQ(encoded_body(set), words({0, 0, 0xffffffff}));
}

TEST(Codec, pads_with_zeros_and_does_not_look_at_padding) {
  EXPECT_EQ(encoded_body(opaque::State{{std::uint8_t{1}}}), words({1, 1, 0x01000000}));
  opaque::State state;
  ASSERT_TRUE(decode(words({1, 1, 0x01abcdef}), state));
  EXPECT_EQ(state.bytes, std::vector<std::uint8_t>{1});
}

TEST(Codec, takes_the_length_of_an_array_over_its_count_as_stock_decoders_do) {
  opaque::State state;  // allocated there: no longer than its count
  ASSERT_TRUE(decode(words({4, 1, 0x01000000}), state));
  EXPECT_EQ(state.bytes.size(), 1U);
  EXPECT_EQ(decode(words({1, 2, 0x01020000}), state).error().code, Errc::bad_count);
  player::Authenticate key;  // a buffer of 32 there: whatever its count
  ASSERT_TRUE(decode(words({0, 2, 0x01020000}), key));
  EXPECT_EQ(key.key.size(), 2U);
}

TEST(Codec, lays_the_kicker_out_as_the_protocol_says) {
  const kicker::State state{
      .capacitor_v = 200, .charged = 1, .ball_detected = 0, .dribbler_radps = -2, .kick_count = 7};
  EXPECT_EQ(encoded_body(state), words({0x43480000, 1, 0, 0xc0000000, 7}));
  EXPECT_EQ(encoded_body(kicker::KickCommand{.speed_mps = 8}), words({0x41000000}));
  EXPECT_EQ(encoded_body(kicker::ChipCommand{.speed_mps = 8, .angle_rad = 0.5}), words({0x41000000, 0x3f000000}));
  EXPECT_EQ(encoded_body(kicker::DribblerCommand{.speed_radps = 2}), words({0x40000000}));
  EXPECT_EQ(encoded_body(kicker::ChargeCommand{.on = 1}), words({1}));
  EXPECT_EQ(encoded_size(kicker::Geometry{}), 72U);
  EXPECT_EQ(encoded_body(kicker::Limits{8, 6, 0.25, 0.5, 2}),
            words({0x41000000, 0x40c00000, 0x3e800000, 0x3f000000, 0x40000000}));
}

// --- properties ------------------------------------------------------------------------------------------------------

TEST(Codec, round_trips_random_messages_of_every_type_bit_by_bit) {
  RandomMessage random{2};
  for (const Layout& layout : layouts()) {
    for (int i = 0; i < 100; ++i) {
      const Bytes once = layout.random(random);
      ASSERT_EQ(once.size() % 4, 0U) << layout.name;
      Bytes again;
      std::size_t used = 0;
      ASSERT_TRUE(layout.recode(once, again, used)) << layout.name;
      ASSERT_EQ(used, once.size()) << layout.name;
      ASSERT_EQ(again, once) << layout.name;  // compares NaN too
    }
  }
}

TEST(Codec, says_where_a_body_that_is_too_short_ends) {
  RandomMessage random{3, RandomMessage::Optional::never};
  for (const Layout& layout : layouts()) {
    const Bytes whole = layout.random(random);
    for (std::size_t size = 0; size < whole.size(); ++size) {
      const Bytes part(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));  // so that ASan sees its end
      Bytes again;
      std::size_t used = 0;
      const Result<> decoded = layout.recode(part, again, used);
      ASSERT_FALSE(decoded) << layout.name;
      const Error& error = decoded.error();
      ASSERT_TRUE(error.code == Errc::short_body || error.code == Errc::bad_count) << error.message();
      ASSERT_NE(error.what.find(std::to_string(size) + " bytes"), std::string::npos) << error.what;
      ASSERT_NE(error.what.find(" in `"), std::string::npos) << error.what;
    }
  }
}

TEST(Codec, disregards_bytes_after_the_last_field) {
  RandomMessage random{4};
  for (const Layout& layout : layouts()) {
    const Bytes whole = layout.random(random);
    Bytes longer = whole;
    longer.resize(whole.size() + 4);  // fewer than any optional field takes
    Bytes again;
    std::size_t used = 0;
    ASSERT_TRUE(layout.recode(longer, again, used)) << layout.name;
    ASSERT_EQ(used, whole.size()) << layout.name;
    ASSERT_EQ(again, whole) << layout.name;
  }
}

TEST(Codec, names_field_and_bytes) {
  const Bytes body = encoded_body(position2d::State{});
  position2d::State state;
  const Result<> decoded = decode(std::span{body}.first(20), state);
  EXPECT_EQ(decoded.error().what, "body of 20 bytes ends in `pos.pa`, which takes bytes 16 to 24");
}

TEST(Codec, reads_the_age_of_a_velocity_only_when_it_is_there) {
  position2d::VelocityCommand command{.velocity = {1, 2, 3}, .motors_on = 1, .age_s = 0.25};
  const Bytes body = encoded_body(command);
  ASSERT_EQ(body.size(), 36U);
  position2d::VelocityCommand again;
  ASSERT_TRUE(decode(body, again));
  EXPECT_EQ(again, command);
  ASSERT_TRUE(decode(std::span{body}.first(28), again));
  EXPECT_EQ(again.age_s, std::nullopt);
  EXPECT_EQ(encoded_body(again).size(), 28U);
}

TEST(Codec, writes_nothing_into_a_buffer_that_is_too_small) {
  Bytes small(header_size + 51, std::byte{0xaa});
  EXPECT_EQ(encode_message({}, position2d::State{}, small), header_size + 52);
  EXPECT_EQ(small, Bytes(header_size + 51, std::byte{0xaa}));
}

// --- memory ----------------------------------------------------------------------------------------------------------

TEST(Codec, allocates_nothing_to_encode_nor_to_decode_into_a_message_that_has_room) {
  RandomMessage random{5};
  for (const Layout& layout : layouts()) {
    EXPECT_EQ(layout.allocated(random), (std::pair<std::size_t, std::size_t>{0, 0})) << layout.name;
  }
}

TEST(Codec, takes_no_memory_for_a_claimed_count) {
  for (const std::uint32_t count : {0x7ffffff0U, 0xffffffffU, 0x80000000U, 5U}) {
    const Bytes body = words({count, count, 0});
    allocations().largest = 0;
    opaque::State bytes;
    localize::State hypotheses;
    planner::Waypoints waypoints;
    property::GetText text;
    EXPECT_EQ(decode(body, bytes).error().code, Errc::bad_count);
    EXPECT_EQ(decode(words({0, 0, 0, count, count, 0}), hypotheses).error().code, Errc::bad_count);
    EXPECT_EQ(decode(words({0, 0, count, count, 0}), waypoints).error().code, Errc::bad_count);
    EXPECT_EQ(decode(body, text).error().code, Errc::bad_count);
    EXPECT_LT(allocations().largest, 1024U);
  }
}

// --- the registry ----------------------------------------------------------------------------------------------------

Header header_of(std::uint16_t interface, Kind kind, std::uint8_t subtype) {
  return {.address = {.interface = interface}, .kind = kind, .subtype = subtype};
}

TEST(Registry, decodes_into_the_variant_of_its_kind) {
  AnyCommand command;
  const kicker::ChipCommand chip{.speed_mps = 4, .angle_rad = 0.7F};
  ASSERT_TRUE(decode_any(header_of(67, Kind::command, 2), encoded_body(chip), command));
  EXPECT_EQ(std::get<kicker::ChipCommand>(command), chip);
}

TEST(Registry, finds_universal_requests_in_any_interface) {
  AnyRequest request;
  const property::GetDouble get{.key = "gain", .value = 2.5};
  ASSERT_TRUE(decode_any(header_of(53, Kind::request, 252), encoded_body(get), request));
  EXPECT_EQ(std::get<property::GetDouble>(request), get);
}

TEST(Registry, says_what_is_unknown) {
  AnyCommand command;
  EXPECT_EQ(decode_any(header_of(6, Kind::command, 1), {}, command).error().message(),
            "interface 6: unknown interface");
  EXPECT_EQ(decode_any(header_of(4, Kind::command, 9), {}, command).error().message(),
            "position2d has no command of subtype 9: unknown message");
  EXPECT_EQ(decode_any(header_of(4, Kind::command, 1), words({0}), command).error().message(),
            "position2d VEL: body of 4 bytes ends in `vel.px`, which takes bytes 0 to 8: message too short");
}

}  // namespace
}  // namespace regista::xdr
