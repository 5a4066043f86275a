// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/motor_board/board.h>

#include <algorithm>
#include <array>

namespace {

/// The firmware with its clock and its cable.
class Firmware : public testing::Test {
 protected:
  using Frame = std::array<std::uint8_t, motor_board_command_size>;

  Firmware() { motor_board_start(&board_); }

  static Frame packed(const MotorBoardCommand& command) {
    Frame frame{};
    motor_board_pack_command(&command, frame.data());
    return frame;
  }
  MotorBoardCommand drive(std::int32_t mradps) {
    MotorBoardCommand command{};
    command.sequence = ++sequence_;
    command.flags = motor_board_drive;
    std::ranges::fill(command.wheel_mradps, mradps);
    return command;
  }
  bool take(const Frame& frame) {
    bool answers = false;
    for (const std::uint8_t byte : frame) answers = motor_board_take(&board_, byte, now_us_) || answers;
    return answers;
  }
  bool take(const MotorBoardCommand& command) { return take(packed(command)); }
  void run(std::uint32_t us) {
    for (std::uint32_t t = 0; t < us; t += 1000) {
      now_us_ += 1000;
      motor_board_tick(&board_, now_us_);
    }
  }
  [[nodiscard]] bool turns() const {
    return std::ranges::any_of(board_.command.wheel_mradps, [](std::int32_t w) { return w != 0; });
  }

  MotorBoard board_{};
  std::uint32_t now_us_ = 0xFFFF0000;  // wraps within 66 ms
  std::uint8_t sequence_ = 0;
};

TEST_F(Firmware, starts_at_rest_and_timed_out) {
  run(1000);
  EXPECT_FALSE(turns());
  EXPECT_EQ(board_.telemetry.status, motor_board_timed_out);
}

TEST_F(Firmware, puts_all_wheels_into_force_with_the_last_byte_of_a_frame) {
  const Frame frame = packed(drive(5000));
  for (std::size_t i = 0; i + 1 < frame.size(); ++i) {
    EXPECT_FALSE(motor_board_take(&board_, frame[i], now_us_));
    EXPECT_FALSE(turns());
  }
  EXPECT_TRUE(motor_board_take(&board_, frame.back(), now_us_));
  EXPECT_TRUE(std::ranges::all_of(board_.command.wheel_mradps, [](std::int32_t w) { return w == 5000; }));
}

TEST_F(Firmware, stops_the_wheels_50_ms_after_the_last_command_for_good) {
  for (int i = 0; i < 100; ++i) {
    take(drive(5000));
    run(2000);
  }
  run(motor_board_watchdog_us - 2000);
  EXPECT_TRUE(turns());
  run(1000);
  EXPECT_FALSE(turns());
  EXPECT_EQ(board_.telemetry.status, motor_board_timed_out);
  for (int minute = 0; minute < 72; ++minute) {  // the clock wraps after 71 minutes
    now_us_ += 60'000'000;
    run(1000);
    ASSERT_EQ(board_.telemetry.status, motor_board_timed_out);
  }
  take(drive(5000));
  run(1000);
  EXPECT_TRUE(turns());
}

TEST_F(Firmware, is_not_kept_going_by_a_buffer_that_repeats_its_last_frame) {
  const Frame frame = packed(drive(5000));
  EXPECT_TRUE(take(frame));
  for (int i = 0; i < 60; ++i) {
    EXPECT_FALSE(take(frame));
    run(1000);
  }
  EXPECT_FALSE(turns());
}

TEST_F(Firmware, never_moves_a_wheel_for_a_frame_with_a_flipped_bit) {
  const Frame frame = packed(drive(5000));
  for (std::size_t bit = 0; bit < 8 * frame.size(); ++bit) {
    Frame flipped = frame;
    flipped[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    EXPECT_FALSE(take(flipped)) << bit;
    run(1000);
    EXPECT_FALSE(turns()) << bit;
    motor_board_start(&board_);
  }
}

TEST_F(Firmware, kicks_once_for_each_id_however_often_it_is_sent) {
  MotorBoardCommand command = drive(0);
  command.kick_id = 1;
  int kicks = 0;
  const auto send = [&] {
    command.sequence = ++sequence_;
    take(command);
    kicks += motor_board_take_kick(&board_, true) ? 1 : 0;
  };
  for (int i = 0; i < 10; ++i) send();
  EXPECT_EQ(kicks, 1);
  command.kick_id = 0;
  send();
  EXPECT_EQ(kicks, 1);
  command.kick_id = 2;
  send();
  EXPECT_EQ(kicks, 2);
  EXPECT_EQ(board_.telemetry.kicks, 2);
}

TEST_F(Firmware, drops_a_kick_without_charge_and_says_that_it_took_it) {
  MotorBoardCommand command = drive(0);
  command.kick_id = 9;
  take(command);
  EXPECT_FALSE(motor_board_take_kick(&board_, false));
  EXPECT_FALSE(motor_board_take_kick(&board_, true));
  std::array<std::uint8_t, motor_board_telemetry_size> frame{};
  EXPECT_EQ(motor_board_answer(&board_, now_us_, frame.data()), frame.size());
  MotorBoardTelemetry telemetry{};
  ASSERT_TRUE(motor_board_unpack_telemetry(frame.data(), &telemetry));
  EXPECT_EQ(telemetry.kick_id, 9);
  EXPECT_EQ(telemetry.kicks, 0);
  EXPECT_EQ(telemetry.echo, command.sequence);
}

TEST_F(Firmware, says_which_wheel_stalls_and_when_it_turns_again) {
  std::ranges::fill(board_.telemetry.speed_mradps, 5000);
  board_.telemetry.speed_mradps[2] = 100;
  for (int i = 0; i < 149; ++i) {
    take(drive(5000));
    run(2000);
    ASSERT_EQ(board_.telemetry.stalled, 0);
  }
  for (int i = 0; i < 5; ++i) {
    take(drive(5000));
    run(2000);
  }
  EXPECT_EQ(board_.telemetry.stalled, 1 << 2);
  board_.telemetry.speed_mradps[2] = -4000;  // braking from the other direction is turning, too
  take(drive(5000));
  run(1000);
  EXPECT_EQ(board_.telemetry.stalled, 0);
}

}  // namespace
