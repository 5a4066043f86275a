// SPDX-License-Identifier: Apache-2.0
// The board's end of the cable, to be ported with frame.h: what a command does, the watchdog, the stall detection.
// Reads no clock and touches no hardware: the firmware hands in bytes, the time and what it measured.
//
//   struct MotorBoard board;
//   motor_board_start(&board);
//   for (;;) {                                                            // every millisecond, or oftener
//     const uint32_t now_us = clock_us();                                 // may wrap
//     while (uart_has_byte()) answer = motor_board_take(&board, uart_byte(), now_us) || answer;
//     measure(&board.telemetry);                                          // counts, speeds, currents, battery …
//     motor_board_tick(&board, now_us);
//     run_wheels(board.command.wheel_mradps, board.command.flags & motor_board_drive);
//     if (motor_board_take_kick(&board, charged)) fire(board.command.kick_speed_mmps, board.command.kick_angle_mrad);
//     if (answer) uart_send(frame, motor_board_answer(&board, now_us, frame));
//   }
#ifndef REGISTA_MOTOR_BOARD_BOARD_H
#define REGISTA_MOTOR_BOARD_BOARD_H

#include "frame.h"

#ifdef __cplusplus
extern "C" {
#endif

/// [µs] Without a fresh command for so long all set-points become 0. With the beats that the wheels need to slow down,
/// a robot whose computer died stands within 100 ms.
enum { motor_board_watchdog_us = 50000 };
/// [µs] A wheel that does not turn for so long although it should is stalled.
enum { motor_board_stall_us = 300000 };

struct MotorBoard {
  struct MotorBoardParser parser;
  struct MotorBoardCommand command;      ///< in force: what the wheels, the dribbler and the charger are to do
  struct MotorBoardTelemetry telemetry;  ///< the firmware writes what it measures; the rest is the board's
  bool commanded;                        ///< since power-on
  bool kick_waits;
  uint8_t last_kick_id;
  uint32_t commanded_us;                   ///< when the last fresh command came
  uint32_t turned_us[motor_board_wheels];  ///< when a wheel last did what it should
};

/// At power-on: nothing moves.
void motor_board_start(struct MotorBoard* board);

/// One byte from the cable. True: a fresh command is in force; answer it.
bool motor_board_take(struct MotorBoard* board, uint8_t byte, uint32_t now_us);

/// Every millisecond: the watchdog, and who stalls.
void motor_board_tick(struct MotorBoard* board, uint32_t now_us);

/// True once for each kick that is to be done now. Without the charge for it, the kick is dropped.
bool motor_board_take_kick(struct MotorBoard* board, bool charged);

/// Write the answer; its size.
size_t motor_board_answer(struct MotorBoard* board, uint32_t now_us, uint8_t frame[motor_board_telemetry_size]);

#ifdef __cplusplus
}
#endif

#endif
