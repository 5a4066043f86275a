// SPDX-License-Identifier: Apache-2.0
// The frames between a robot's computer and its motor board, for both ends of the cable: C99 and C++, no dependencies,
// no allocation. docs/motor-board.md draws them; all numbers are little-endian.
#ifndef REGISTA_MOTOR_BOARD_FRAME_H
#define REGISTA_MOTOR_BOARD_FRAME_H

// NOLINTBEGIN(modernize-deprecated-headers, modernize-use-using): this is C, too.
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { motor_board_wheels = 4 };

/// [bytes] of a whole frame, from the first byte of sync to the last of the CRC.
enum { motor_board_command_size = 30, motor_board_telemetry_size = 78 };

/// Of MotorBoardCommand::flags.
enum {
  motor_board_drive = 1,  ///< the wheels follow their set-points; without it they brake
  motor_board_charge = 2  ///< keep the kicker's capacitor charged
};

/// Of MotorBoardTelemetry::status.
enum {
  motor_board_timed_out = 1,  ///< no command within the watchdog's time: all set-points are 0
  motor_board_driving = 2,    ///< the wheels follow their set-points
  motor_board_charged = 4,    ///< ready to kick
  motor_board_ball = 8,       ///< the ball is before the kicker
  motor_board_imu = 16        ///< `accel_mmps2` and `rate_mradps` are measured
};

/// To the board: everything that it is to do, in one frame, so that all wheels start together.
struct MotorBoardCommand {
  uint8_t sequence;  ///< one more each time; a frame with the number of the one before is a repetition, and ignored
  uint8_t flags;
  uint8_t kick_id;  ///< 0: no kick; another number than that of the last kick: kick once
  uint16_t kick_speed_mmps;
  uint16_t kick_angle_mrad;                  ///< above the floor; 0: a flat kick
  int16_t dribbler_radps;                    ///< positive holds the ball
  int32_t wheel_mradps[motor_board_wheels];  ///< set-points at the wheel, not the motor
};

/// From the board: the answer to each command that it took.
struct MotorBoardTelemetry {
  uint8_t sequence;  ///< one more each time
  uint8_t echo;      ///< `sequence` of the last command taken
  uint8_t status;
  uint8_t stalled;   ///< bit n: wheel n does not turn although its set-point says so
  uint8_t kick_id;   ///< of the last kick taken, whether the capacitor had the charge for it or not
  uint16_t kicks;    ///< done since power-on
  uint16_t refused;  ///< frames with a wrong CRC since power-on
  uint16_t battery_mv;
  int16_t battery_ca;                        ///< [10 mA] drawn from the battery
  uint16_t capacitor_dv;                     ///< [0.1 V]
  int16_t dribbler_radps;                    ///< measured
  uint32_t time_us;                          ///< of the board's clock, when the rest was measured; wraps
  int32_t count[motor_board_wheels];         ///< edges of the encoders; wraps
  int32_t speed_mradps[motor_board_wheels];  ///< measured at the wheels
  int16_t current_ma[motor_board_wheels];    ///< of the motors
  int16_t accel_mmps2[3];  ///< specific force along the board's axes; at rest the axis that points up reads +9807
  int16_t rate_mradps[3];  ///< turn rates about them, counter-clockwise
};

/// CRC-16/IBM-3740 (polynomial 0x1021, initial value 0xFFFF, nothing reflected) of `size` bytes.
uint16_t motor_board_crc(const uint8_t* bytes, size_t size);

void motor_board_pack_command(const struct MotorBoardCommand* command, uint8_t frame[motor_board_command_size]);
void motor_board_pack_telemetry(const struct MotorBoardTelemetry* telemetry, uint8_t frame[motor_board_telemetry_size]);

/// False, and nothing is written, unless sync, type and CRC are right.
bool motor_board_unpack_command(const uint8_t frame[motor_board_command_size], struct MotorBoardCommand* command);
bool motor_board_unpack_telemetry(const uint8_t frame[motor_board_telemetry_size],
                                  struct MotorBoardTelemetry* telemetry);

/// Finds the frames of one type in a stream of bytes that may begin anywhere and lose or change some.
struct MotorBoardParser {
  uint8_t type;
  uint8_t size;  ///< [bytes] of a frame of that type
  uint8_t filled;
  uint16_t refused;  ///< frames with a wrong CRC; wraps
  uint8_t frame[motor_board_telemetry_size];
};

/// For the board, and for the computer.
void motor_board_parse_commands(struct MotorBoardParser* parser);
void motor_board_parse_telemetry(struct MotorBoardParser* parser);

/// One byte more. True: `frame` holds a whole one whose sync, type and CRC are right, until the next call.
bool motor_board_parse(struct MotorBoardParser* parser, uint8_t byte);

#ifdef __cplusplus
}
#endif
// NOLINTEND(modernize-deprecated-headers, modernize-use-using)

#endif
