// SPDX-License-Identifier: Apache-2.0
#include <regista/motor_board/board.h>
#include <string.h>

static uint32_t magnitude(int32_t value) { return value < 0 ? 0U - (uint32_t)value : (uint32_t)value; }

/// Everything at rest, the charger off. What was taken stays known, so that no kick is done twice.
static void rest(struct MotorBoard* board) {
  board->command.flags = 0;
  board->command.dribbler_radps = 0;
  memset(board->command.wheel_mradps, 0, sizeof board->command.wheel_mradps);
  board->kick_waits = false;
}

void motor_board_start(struct MotorBoard* board) {
  memset(board, 0, sizeof *board);
  motor_board_parse_commands(&board->parser);
}

bool motor_board_take(struct MotorBoard* board, uint8_t byte, uint32_t now_us) {
  if (!motor_board_parse(&board->parser, byte)) return false;
  struct MotorBoardCommand command;
  if (!motor_board_unpack_command(board->parser.frame, &command)) return false;
  // A buffer that sends its last frame for ever must not keep the wheels turning.
  if (board->commanded && command.sequence == board->command.sequence) return false;
  if (!board->commanded) {
    for (int i = 0; i < motor_board_wheels; ++i) board->turned_us[i] = now_us;
  }
  board->command = command;
  board->commanded_us = now_us;
  board->commanded = true;
  if (command.kick_id != 0 && command.kick_id != board->last_kick_id) {
    board->last_kick_id = command.kick_id;
    board->kick_waits = true;
  }
  return true;
}

void motor_board_tick(struct MotorBoard* board, uint32_t now_us) {
  const bool timed_out = !board->commanded || now_us - board->commanded_us > motor_board_watchdog_us;
  if (timed_out) {
    rest(board);
    // So that it stays timed out when the clock has wrapped.
    board->commanded_us = now_us - motor_board_watchdog_us - 1;
  }
  const bool driving = (board->command.flags & motor_board_drive) != 0;
  board->telemetry.status &= motor_board_charged | motor_board_ball | motor_board_imu;
  if (timed_out) board->telemetry.status |= motor_board_timed_out;
  if (driving) board->telemetry.status |= motor_board_driving;

  board->telemetry.stalled = 0;
  for (int i = 0; i < motor_board_wheels; ++i) {
    // Turning at a tenth of what it should is turning; below 1 rad/s friction alone may hold a wheel.
    const uint32_t wanted = driving ? magnitude(board->command.wheel_mradps[i]) : 0;
    const bool turns = wanted < 1000 || magnitude(board->telemetry.speed_mradps[i]) >= wanted / 10;
    if (turns) board->turned_us[i] = now_us;
    if (now_us - board->turned_us[i] > motor_board_stall_us) {
      board->telemetry.stalled = (uint8_t)(board->telemetry.stalled | 1U << i);
      board->turned_us[i] = now_us - motor_board_stall_us - 1;
    }
  }
}

bool motor_board_take_kick(struct MotorBoard* board, bool charged) {
  const bool now = board->kick_waits && charged;
  board->kick_waits = false;
  if (now) ++board->telemetry.kicks;
  return now;
}

size_t motor_board_answer(struct MotorBoard* board, uint32_t now_us, uint8_t frame[motor_board_telemetry_size]) {
  ++board->telemetry.sequence;
  board->telemetry.echo = board->command.sequence;
  board->telemetry.kick_id = board->last_kick_id;
  board->telemetry.refused = board->parser.refused;
  board->telemetry.time_us = now_us;
  motor_board_pack_telemetry(&board->telemetry, frame);
  return motor_board_telemetry_size;
}
