// SPDX-License-Identifier: Apache-2.0
#include <regista/motor_board/board.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>

namespace {

/// The search goes on until one of these aborts.
void require(bool condition) {
  if (!condition) std::abort();
}

}  // namespace

/// Any bytes, at the board and at the computer: what is taken for a frame is one, byte by byte, and nothing else moves
/// a wheel or kicks.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  MotorBoard board;
  motor_board_start(&board);
  MotorBoardParser computer;
  motor_board_parse_telemetry(&computer);
  std::uint32_t now_us = 0xFFFFF000;
  for (std::size_t i = 0; i < size; ++i) {
    const MotorBoardCommand before = board.command;
    now_us += 1 + data[i] * 10U;
    if (motor_board_take(&board, data[i], now_us)) {
      std::uint8_t frame[motor_board_command_size];
      motor_board_pack_command(&board.command, frame);
      require(i + 1 >= sizeof frame && std::memcmp(frame, data + i + 1 - sizeof frame, sizeof frame) == 0);
    } else {
      require(std::memcmp(before.wheel_mradps, board.command.wheel_mradps, sizeof before.wheel_mradps) == 0);
      require(!board.kick_waits);
    }
    (void)motor_board_take_kick(&board, true);
    motor_board_tick(&board, now_us);
    const bool timed_out = (board.telemetry.status & motor_board_timed_out) != 0;
    require(!timed_out || std::ranges::all_of(board.command.wheel_mradps, [](std::int32_t w) { return w == 0; }));

    if (motor_board_parse(&computer, data[i])) {
      MotorBoardTelemetry telemetry;
      require(motor_board_unpack_telemetry(computer.frame, &telemetry));
      std::uint8_t frame[motor_board_telemetry_size];
      motor_board_pack_telemetry(&telemetry, frame);
      require(i + 1 >= sizeof frame && std::memcmp(frame, data + i + 1 - sizeof frame, sizeof frame) == 0);
    }
  }
  return 0;
}
