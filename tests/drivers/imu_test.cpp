// SPDX-License-Identifier: Apache-2.0
#include "imu.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <random>

namespace regista::microstrain {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes operator+(Bytes a, const Bytes& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

// Printed in the DCP manual of the 3DM-GX5-35, 4.1.1 and 4.2.
const Bytes ping{0x75, 0x65, 0x01, 0x02, 0x02, 0x01, 0xE0, 0xC6};
const Bytes ping_done{0x75, 0x65, 0x01, 0x04, 0x04, 0xF1, 0x01, 0x00, 0xD5, 0x6A};
const Bytes idle{0x75, 0x65, 0x01, 0x02, 0x02, 0x02, 0xE1, 0xC7};
const Bytes resume{0x75, 0x65, 0x01, 0x02, 0x02, 0x06, 0xE5, 0xCB};
const Bytes stream_on{0x75, 0x65, 0x0C, 0x05, 0x05, 0x11, 0x01, 0x01, 0x01, 0x04, 0x1A};
const Bytes format_of_two{0x75, 0x65, 0x0C, 0x0A, 0x0A, 0x08, 0x01, 0x02,
                          0x04, 0x00, 0x01, 0x05, 0x00, 0x01, 0x10, 0x73};

TEST(Mip, commands_are_those_that_the_manual_prints) {
  EXPECT_EQ(mip_command(0x01, 0x01), ping);
  EXPECT_EQ(stop_mip(), idle);
  EXPECT_EQ(mip_command(0x0C, 0x08, Bytes{0x01, 0x02, 0x04, 0x00, 0x01, 0x05, 0x00, 0x01}), format_of_two);
  const Bytes start = start_mip(5);
  EXPECT_TRUE(std::ranges::equal(std::span{start}.last(19), stream_on + resume));
}

TEST(SingleByte, starts_with_a_stop) {
  EXPECT_EQ(start_single_byte(), (Bytes{0xFA, 0x75, 0xB4, 0xC4, 0xC1, 0x29, 0xCC}));
}

void put(Bytes& bytes, float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  for (const int shift : {24, 16, 8, 0}) bytes.push_back(static_cast<std::uint8_t>(bits >> shift));
}

const Sample some{.acceleration_g = {0.01F, -0.02F, -0.99F},
                  .rate_radps = {0.1F, 0.2F, 0.3F},
                  .field_gauss = {0.17F, 0.01F, 0.47F},
                  .sensor_from_earth = {0.6F, 0.8F, 0, -0.8F, 0.6F, 0, 0, 0, 1}};

Bytes packet_of(Protocol protocol, const Sample& sample) {
  const auto all = [](auto... arrays) {
    Bytes bytes;
    (std::ranges::for_each(arrays, [&](float value) { put(bytes, value); }), ...);
    return bytes;
  };
  if (protocol == Protocol::single_byte) {
    Bytes packet = Bytes{0xCC} +
                   all(sample.acceleration_g, sample.rate_radps, sample.field_gauss, sample.sensor_from_earth) +
                   Bytes{0, 1, 2, 3};
    int sum = 0;
    for (const int byte : packet) sum += byte;
    return packet + Bytes{static_cast<std::uint8_t>(sum >> 8), static_cast<std::uint8_t>(sum)};
  }
  Bytes packet = Bytes{0x75, 0x65, 0x80, 80} + Bytes{14, 4} + all(sample.acceleration_g) + Bytes{14, 5} +
                 all(sample.rate_radps) + Bytes{14, 6} + all(sample.field_gauss) + Bytes{38, 9} +
                 all(sample.sensor_from_earth);
  int first = 0;
  int second = 0;
  for (const int byte : packet) second += first += byte;
  return packet + Bytes{static_cast<std::uint8_t>(first), static_cast<std::uint8_t>(second)};
}

std::vector<Packet> read(Reader& reader, std::span<const std::uint8_t> bytes) {
  std::vector<Packet> packets;
  while (!bytes.empty()) {
    const auto space = reader.space();
    const std::size_t count = std::min(space.size(), bytes.size());
    std::copy_n(bytes.begin(), count, space.begin());
    reader.filled(count);
    bytes = bytes.subspan(count);
    while (const auto packet = reader.next()) packets.push_back(*packet);
  }
  return packets;
}

class Both : public testing::TestWithParam<Protocol> {
 protected:
  Reader reader_{GetParam()};
  Bytes packet_ = packet_of(GetParam(), some);
};
INSTANTIATE_TEST_SUITE_P(MicroStrain, Both, testing::Values(Protocol::single_byte, Protocol::mip),
                         [](const auto& each) { return each.param == Protocol::mip ? "mip" : "single_byte"; });

TEST_P(Both, packet_is_read_whole_and_in_any_pieces) {
  for (std::size_t cut = 0; cut <= packet_.size(); ++cut) {
    const auto front = read(reader_, std::span{packet_}.first(cut));
    const auto back = read(reader_, std::span{packet_}.subspan(cut));
    const auto& packets = cut == packet_.size() ? front : back;
    ASSERT_EQ(packets.size(), 1U) << cut;
    EXPECT_EQ(packets[0].sample, some);
  }
  EXPECT_EQ(reader_.skipped(), 0U);
}

TEST_P(Both, each_flipped_bit_is_refused_and_the_next_packet_read) {
  for (std::size_t bit = 0; bit < 8 * packet_.size(); ++bit) {
    Bytes broken = packet_;
    broken[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
    Reader reader{GetParam()};
    // A wrong length may make the reader wait for as many bytes as there can be: three packets more.
    const auto packets = read(reader, broken + packet_ + packet_ + packet_ + packet_);
    ASSERT_GE(packets.size(), 1U) << bit;
    std::size_t samples = 0;
    for (const Packet& packet : packets) {
      if (!packet.sample) continue;
      ++samples;
      EXPECT_EQ(packet.sample, some) << bit;
    }
    EXPECT_EQ(samples, 4U) << bit;
  }
}

TEST_P(Both, noise_between_packets_costs_none_of_them) {
  std::mt19937 random{3};
  for (int run = 0; run < 200; ++run) {
    Bytes noise(random() % 60);
    std::ranges::generate(noise, [&] { return static_cast<std::uint8_t>(random()); });
    Reader reader{GetParam()};
    const auto packets = read(reader, noise + packet_ + packet_ + packet_ + packet_);
    const auto samples = std::ranges::count_if(packets, [](const Packet& p) { return p.sample == some; });
    EXPECT_EQ(samples, 4) << run;
  }
}

TEST_P(Both, what_is_no_number_or_no_rotation_is_no_sample) {
  Sample sample = some;
  sample.rate_radps[1] = std::nanf("");
  for (const Packet& packet : read(reader_, packet_of(GetParam(), sample))) EXPECT_FALSE(packet.sample);
  sample = some;
  sample.sensor_from_earth[0] = 0.7F;
  for (const Packet& packet : read(reader_, packet_of(GetParam(), sample))) EXPECT_FALSE(packet.sample);
}

TEST(Mip, answers_tell_command_and_error) {
  Reader reader{Protocol::mip};
  const auto packets = read(reader, ping_done);
  ASSERT_EQ(packets.size(), 1U);
  EXPECT_EQ(packets[0].answer, (Answer{.set = 1, .command = 1, .error = 0}));
  EXPECT_EQ(to_string({.set = 0x0C, .command = 0x08, .error = 3}), "3DM command 0x08: invalid parameter (3)");
}

TEST(ToHouse, agrees_with_the_manuals_euler_angles) {
  // Both manuals: pitch = asin(-M13), roll = atan2(M23, M33), yaw = atan2(M12, M11), yaw clockwise from north.
  std::mt19937 random{5};
  std::uniform_real_distribution<float> any{-3, 3};
  for (int run = 0; run < 100; ++run) {
    const Eigen::Matrix3f m =
        Eigen::Quaternionf{any(random), any(random), any(random), any(random)}.normalized().toRotationMatrix();
    Sample sample;
    for (int i = 0; i < 9; ++i) sample.sensor_from_earth[static_cast<std::size_t>(i)] = m(i / 3, i % 3);
    const Orientation3d house = to_orientation(to_house(sample, Eigen::Matrix3d::Identity(), 0).field_from_body);
    EXPECT_NEAR(house.pitch, -std::asin(-m(0, 2)), 1e-3);
    EXPECT_NEAR(angle_between(house.roll, std::atan2(m(1, 2), m(2, 2))), 0, 1e-3);
    EXPECT_NEAR(angle_between(house.yaw, std::numbers::pi / 2 - std::atan2(m(0, 1), m(0, 0))), 0, 1e-3);
  }
}

}  // namespace
}  // namespace regista::microstrain
