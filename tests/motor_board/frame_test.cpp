// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/motor_board/frame.h>

#include <array>
#include <cstring>
#include <random>
#include <string_view>
#include <vector>

namespace {

using Command = std::array<std::uint8_t, motor_board_command_size>;
using Telemetry = std::array<std::uint8_t, motor_board_telemetry_size>;

/// CRC-16/IBM-3740 as its definition has it, a bit at a time: not the code under test.
std::uint16_t crc_by_definition(const std::uint8_t* bytes, std::size_t size) {
  std::uint32_t crc = 0xFFFF;
  for (std::size_t i = 0; i < size; ++i) {
    for (int bit = 7; bit >= 0; --bit) {
      const bool feedback = ((crc >> 15) & 1U) != ((bytes[i] >> bit) & 1U);
      crc = (crc << 1) & 0xFFFFU;
      if (feedback) crc ^= 0x1021U;
    }
  }
  return static_cast<std::uint16_t>(crc);
}

template <std::size_t n>
void seal(std::array<std::uint8_t, n>& frame) {
  const std::uint16_t crc = crc_by_definition(frame.data() + 2, n - 4);
  frame[n - 2] = static_cast<std::uint8_t>(crc & 0xFF);
  frame[n - 1] = static_cast<std::uint8_t>(crc >> 8);
}

/// Written by hand from the tables of docs/motor-board.md.
Command command_by_hand() {
  Command frame{0xA5, 0x5A, 0xC1,        // sync, command of version 1
                0x07, 0x03, 0x02,        // sequence 7, drive and charge, kick 2
                0x70, 0x17, 0x0B, 0x02,  // 6000 mm/s, 523 mrad
                0x9C, 0xFF,              // dribbler -100 rad/s
                0x10, 0x27, 0x00, 0x00,  // 10 000 mrad/s
                0xF0, 0xD8, 0xFF, 0xFF,  // -10 000 mrad/s
                0x00, 0x00, 0x00, 0x00,  //
                0xFF, 0xFF, 0xFF, 0x7F,  // 2147483647 mrad/s
                0,    0};
  seal(frame);
  return frame;
}

TEST(BoardFrame, has_the_standard_crc) {
  // The check value of CRC-16/IBM-3740 in the catalogue of parametrised CRC algorithms (reveng.sourceforge.io).
  const std::string_view digits = "123456789";
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(digits.data());
  EXPECT_EQ(motor_board_crc(bytes, digits.size()), 0x29B1);
  std::mt19937 random{1};
  for (std::size_t size = 0; size < 100; ++size) {
    std::vector<std::uint8_t> noise(size);
    for (auto& byte : noise) byte = static_cast<std::uint8_t>(random());
    EXPECT_EQ(motor_board_crc(noise.data(), size), crc_by_definition(noise.data(), size));
  }
}

TEST(BoardFrame, reads_a_command_written_by_hand_and_writes_the_same) {
  const Command frame = command_by_hand();
  MotorBoardCommand command{};
  ASSERT_TRUE(motor_board_unpack_command(frame.data(), &command));
  EXPECT_EQ(command.sequence, 7);
  EXPECT_EQ(command.flags, motor_board_drive | motor_board_charge);
  EXPECT_EQ(command.kick_id, 2);
  EXPECT_EQ(command.kick_speed_mmps, 6000);
  EXPECT_EQ(command.kick_angle_mrad, 523);
  EXPECT_EQ(command.dribbler_radps, -100);
  EXPECT_EQ(command.wheel_mradps[0], 10'000);
  EXPECT_EQ(command.wheel_mradps[1], -10'000);
  EXPECT_EQ(command.wheel_mradps[2], 0);
  EXPECT_EQ(command.wheel_mradps[3], 2147483647);
  Command again{};
  motor_board_pack_command(&command, again.data());
  EXPECT_EQ(again, frame);
}

TEST(BoardFrame, reads_telemetry_written_by_hand_and_writes_the_same) {
  Telemetry frame{
      0xA5, 0x5A, 0x71, 0x09, 0x07, 0x1E, 0x05, 0x02,  // 9 answers 7; all but timed out; wheels 0, 2; kick 2
      0x03, 0x00, 0x2A, 0x00,                          // 3 kicks, 42 refused
      0xE0, 0x2E, 0x9C, 0xFF, 0xD0, 0x07, 0x32, 0x00,  // 12.000 V, -1 A, 200.0 V, 50 rad/s
      0x40, 0x42, 0x0F, 0x00};                         // 1 s
  for (int i = 0; i < 4; ++i) frame[static_cast<std::size_t>(24 + 4 * i)] = static_cast<std::uint8_t>(i + 1);  // counts
  frame[40 + 12 + 3] = 0x80;                   // speed of wheel 3: -2147483648
  frame[56 + 2] = 0xD0, frame[56 + 3] = 0x07;  // current of wheel 1: 2000 mA
  frame[64 + 4] = 0x4F, frame[64 + 5] = 0x26;  // up: 9807 mm/s²
  frame[70 + 4] = 0x18, frame[70 + 5] = 0xFC;  // about it: -1000 mrad/s
  seal(frame);
  MotorBoardTelemetry t{};
  ASSERT_TRUE(motor_board_unpack_telemetry(frame.data(), &t));
  EXPECT_EQ(t.sequence, 9);
  EXPECT_EQ(t.echo, 7);
  EXPECT_EQ(t.status, motor_board_driving | motor_board_charged | motor_board_ball | motor_board_imu);
  EXPECT_EQ(t.stalled, 5);
  EXPECT_EQ(t.kick_id, 2);
  EXPECT_EQ(t.kicks, 3);
  EXPECT_EQ(t.refused, 42);
  EXPECT_EQ(t.battery_mv, 12'000);
  EXPECT_EQ(t.battery_ca, -100);
  EXPECT_EQ(t.capacitor_dv, 2000);
  EXPECT_EQ(t.dribbler_radps, 50);
  EXPECT_EQ(t.time_us, 1'000'000U);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(t.count[i], i + 1);
  EXPECT_EQ(t.speed_mradps[3], -2147483647 - 1);
  EXPECT_EQ(t.current_ma[1], 2000);
  EXPECT_EQ(t.accel_mmps2[2], 9807);
  EXPECT_EQ(t.rate_mradps[2], -1000);
  Telemetry again{};
  motor_board_pack_telemetry(&t, again.data());
  EXPECT_EQ(again, frame);
}

TEST(BoardFrame, with_any_one_two_or_three_bits_flipped_is_refused) {
  const Command good = command_by_hand();
  MotorBoardCommand command{};
  constexpr std::size_t bits = 8 * motor_board_command_size;
  const auto flip = [](Command& frame, std::size_t bit) { frame[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8); };
  const auto refused = [&](const Command& frame) { return !motor_board_unpack_command(frame.data(), &command); };
  for (std::size_t a = 0; a < bits; ++a) {
    Command frame = good;
    flip(frame, a);
    EXPECT_TRUE(refused(frame)) << a;
    for (std::size_t b = a + 1; b < bits; ++b) {
      flip(frame, b);
      EXPECT_TRUE(refused(frame)) << a << ' ' << b;
      flip(frame, b);
    }
  }
  std::mt19937 random{1};
  for (int i = 0; i < 100'000; ++i) {
    const std::size_t a = random() % bits, b = random() % bits, c = random() % bits;
    if (a == b || b == c || a == c) continue;
    Command frame = good;
    for (const std::size_t bit : {a, b, c}) flip(frame, bit);
    ASSERT_TRUE(refused(frame)) << a << ' ' << b << ' ' << c;
  }
  EXPECT_EQ(command.sequence, 0) << "nothing was written";
}

TEST(BoardFrame, telemetry_with_a_flipped_bit_is_refused) {
  Telemetry frame{};
  const MotorBoardTelemetry good{};
  motor_board_pack_telemetry(&good, frame.data());
  MotorBoardTelemetry telemetry{};
  for (std::size_t bit = 0; bit < 8 * frame.size(); ++bit) {
    frame[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    EXPECT_FALSE(motor_board_unpack_telemetry(frame.data(), &telemetry)) << bit;
    frame[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
  }
}

class Parser : public testing::Test {
 protected:
  Parser() { motor_board_parse_commands(&parser_); }
  int feed(const std::vector<std::uint8_t>& bytes) {
    int found = 0;
    for (const std::uint8_t byte : bytes) found += motor_board_parse(&parser_, byte) ? 1 : 0;
    return found;
  }
  int feed_frame(const Command& frame) { return feed(std::vector(frame.begin(), frame.end())); }

  MotorBoardParser parser_{};
};

TEST_F(Parser, finds_frames_within_noise) {
  EXPECT_EQ(feed({0, 0xA5, 0xA5, 0x5A, 0xFF, 0xA5}), 0);
  EXPECT_EQ(feed_frame(command_by_hand()), 1);
  EXPECT_EQ(feed_frame(command_by_hand()), 1);
  EXPECT_EQ(parser_.refused, 0);
}

TEST_F(Parser, finds_the_frame_that_begins_within_a_broken_one) {
  const Command frame = command_by_hand();
  std::vector<std::uint8_t> bytes(frame.begin(), frame.begin() + 11);  // the rest was lost
  bytes.insert(bytes.end(), frame.begin(), frame.end());
  bytes.insert(bytes.end(), frame.begin(), frame.end());
  EXPECT_EQ(feed(bytes), 2);
  EXPECT_EQ(parser_.refused, 1);
}

TEST_F(Parser, loses_at_most_two_frames_to_a_lost_or_changed_byte) {
  std::mt19937 random{1};
  for (int run = 0; run < 2000; ++run) {
    std::vector<std::uint8_t> bytes;
    for (int i = 0; i < 5; ++i) {
      const Command frame = command_by_hand();
      bytes.insert(bytes.end(), frame.begin(), frame.end());
    }
    const std::size_t at = random() % bytes.size();
    if (random() % 2 == 0) {
      bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(at));
    } else {
      bytes[at] ^= static_cast<std::uint8_t>(1 + random() % 255);
    }
    const int found = feed(bytes);
    ASSERT_GE(found, 3);
    ASSERT_LE(found, 4);
    motor_board_parse_commands(&parser_);
  }
}

TEST_F(Parser, takes_no_telemetry_for_a_command) {
  Telemetry frame{};
  const MotorBoardTelemetry telemetry{};
  motor_board_pack_telemetry(&telemetry, frame.data());
  EXPECT_EQ(feed(std::vector(frame.begin(), frame.end())), 0);
}

}  // namespace
