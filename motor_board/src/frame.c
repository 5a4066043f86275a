// SPDX-License-Identifier: Apache-2.0
#include <regista/motor_board/frame.h>
#include <string.h>

enum { sync_0 = 0xA5, sync_1 = 0x5A };
enum { command_type = 0xC1, telemetry_type = 0x71 };  // the low four bits: version 1 of the layout
enum { type_at = 2, head_size = 3, crc_size = 2 };

uint16_t motor_board_crc(const uint8_t* bytes, size_t size) {
  uint16_t crc = 0xFFFF;
  for (size_t i = 0; i < size; ++i) {
    // A byte at a time without a table; x holds the quotient's bits that feed back through x^12, x^5 and 1.
    uint8_t x = (uint8_t)((crc >> 8) ^ bytes[i]);
    x = (uint8_t)(x ^ (x >> 4));
    crc = (uint16_t)((uint32_t)(crc << 8) ^ ((uint32_t)x << 12) ^ ((uint32_t)x << 5) ^ x);
  }
  return crc;
}

// -- Writing: each puts its bytes and returns where the next go -------------------------------------------------------

static uint8_t* put_u8(uint8_t* at, uint8_t value) {
  *at = value;
  return at + 1;
}

static uint8_t* put_u16(uint8_t* at, uint16_t value) {
  at[0] = (uint8_t)value;
  at[1] = (uint8_t)(value >> 8);
  return at + 2;
}

static uint8_t* put_u32(uint8_t* at, uint32_t value) {
  at = put_u16(at, (uint16_t)value);
  return put_u16(at, (uint16_t)(value >> 16));
}

static uint8_t* put_head(uint8_t* at, uint8_t type) {
  at = put_u8(at, sync_0);
  at = put_u8(at, sync_1);
  return put_u8(at, type);
}

/// Over everything but the sync.
static uint16_t crc_of(const uint8_t* frame, size_t size) {
  return motor_board_crc(frame + type_at, size - type_at - crc_size);
}

static void put_crc(uint8_t* frame, size_t size) { (void)put_u16(frame + size - crc_size, crc_of(frame, size)); }

void motor_board_pack_command(const struct MotorBoardCommand* command, uint8_t frame[motor_board_command_size]) {
  uint8_t* at = put_head(frame, command_type);
  at = put_u8(at, command->sequence);
  at = put_u8(at, command->flags);
  at = put_u8(at, command->kick_id);
  at = put_u16(at, command->kick_speed_mmps);
  at = put_u16(at, command->kick_angle_mrad);
  at = put_u16(at, (uint16_t)command->dribbler_radps);
  for (int i = 0; i < motor_board_wheels; ++i) at = put_u32(at, (uint32_t)command->wheel_mradps[i]);
  put_crc(frame, motor_board_command_size);
}

void motor_board_pack_telemetry(const struct MotorBoardTelemetry* telemetry,
                                uint8_t frame[motor_board_telemetry_size]) {
  uint8_t* at = put_head(frame, telemetry_type);
  at = put_u8(at, telemetry->sequence);
  at = put_u8(at, telemetry->echo);
  at = put_u8(at, telemetry->status);
  at = put_u8(at, telemetry->stalled);
  at = put_u8(at, telemetry->kick_id);
  at = put_u16(at, telemetry->kicks);
  at = put_u16(at, telemetry->refused);
  at = put_u16(at, telemetry->battery_mv);
  at = put_u16(at, (uint16_t)telemetry->battery_ca);
  at = put_u16(at, telemetry->capacitor_dv);
  at = put_u16(at, (uint16_t)telemetry->dribbler_radps);
  at = put_u32(at, telemetry->time_us);
  for (int i = 0; i < motor_board_wheels; ++i) at = put_u32(at, (uint32_t)telemetry->count[i]);
  for (int i = 0; i < motor_board_wheels; ++i) at = put_u32(at, (uint32_t)telemetry->speed_mradps[i]);
  for (int i = 0; i < motor_board_wheels; ++i) at = put_u16(at, (uint16_t)telemetry->current_ma[i]);
  for (int i = 0; i < 3; ++i) at = put_u16(at, (uint16_t)telemetry->accel_mmps2[i]);
  for (int i = 0; i < 3; ++i) at = put_u16(at, (uint16_t)telemetry->rate_mradps[i]);
  put_crc(frame, motor_board_telemetry_size);
}

// -- Reading: each takes its bytes and moves on -----------------------------------------------------------------------

static uint8_t get_u8(const uint8_t** at) { return *(*at)++; }

static uint16_t get_u16(const uint8_t** at) {
  const uint16_t low = get_u8(at);
  return (uint16_t)(low | (uint16_t)(get_u8(at) << 8));
}

static uint32_t get_u32(const uint8_t** at) {
  const uint32_t low = get_u16(at);
  return low | (uint32_t)get_u16(at) << 16;
}

// Two's complement, as every compiler has it; C99 leaves the plain cast to the implementation.
static int16_t get_i16(const uint8_t** at) {
  const uint16_t bits = get_u16(at);
  int16_t value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

static int32_t get_i32(const uint8_t** at) {
  const uint32_t bits = get_u32(at);
  int32_t value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

static bool is_whole(const uint8_t* frame, size_t size, uint8_t type) {
  const uint8_t* crc = frame + size - crc_size;
  return frame[0] == sync_0 && frame[1] == sync_1 && frame[type_at] == type && get_u16(&crc) == crc_of(frame, size);
}

bool motor_board_unpack_command(const uint8_t frame[motor_board_command_size], struct MotorBoardCommand* command) {
  if (!is_whole(frame, motor_board_command_size, command_type)) return false;
  const uint8_t* at = frame + head_size;
  command->sequence = get_u8(&at);
  command->flags = get_u8(&at);
  command->kick_id = get_u8(&at);
  command->kick_speed_mmps = get_u16(&at);
  command->kick_angle_mrad = get_u16(&at);
  command->dribbler_radps = get_i16(&at);
  for (int i = 0; i < motor_board_wheels; ++i) command->wheel_mradps[i] = get_i32(&at);
  return true;
}

bool motor_board_unpack_telemetry(const uint8_t frame[motor_board_telemetry_size],
                                  struct MotorBoardTelemetry* telemetry) {
  if (!is_whole(frame, motor_board_telemetry_size, telemetry_type)) return false;
  const uint8_t* at = frame + head_size;
  telemetry->sequence = get_u8(&at);
  telemetry->echo = get_u8(&at);
  telemetry->status = get_u8(&at);
  telemetry->stalled = get_u8(&at);
  telemetry->kick_id = get_u8(&at);
  telemetry->kicks = get_u16(&at);
  telemetry->refused = get_u16(&at);
  telemetry->battery_mv = get_u16(&at);
  telemetry->battery_ca = get_i16(&at);
  telemetry->capacitor_dv = get_u16(&at);
  telemetry->dribbler_radps = get_i16(&at);
  telemetry->time_us = get_u32(&at);
  for (int i = 0; i < motor_board_wheels; ++i) telemetry->count[i] = get_i32(&at);
  for (int i = 0; i < motor_board_wheels; ++i) telemetry->speed_mradps[i] = get_i32(&at);
  for (int i = 0; i < motor_board_wheels; ++i) telemetry->current_ma[i] = get_i16(&at);
  for (int i = 0; i < 3; ++i) telemetry->accel_mmps2[i] = get_i16(&at);
  for (int i = 0; i < 3; ++i) telemetry->rate_mradps[i] = get_i16(&at);
  return true;
}

// -- Finding frames ---------------------------------------------------------------------------------------------------

void motor_board_parse_commands(struct MotorBoardParser* parser) {
  memset(parser, 0, sizeof *parser);
  parser->type = command_type;
  parser->size = motor_board_command_size;
}

void motor_board_parse_telemetry(struct MotorBoardParser* parser) {
  memset(parser, 0, sizeof *parser);
  parser->type = telemetry_type;
  parser->size = motor_board_telemetry_size;
}

/// What stands in the buffer may be the beginning of a frame.
static bool may_begin(const struct MotorBoardParser* parser) {
  return parser->frame[0] == sync_0 && (parser->filled < 2 || parser->frame[1] == sync_1) &&
         (parser->filled < head_size || parser->frame[type_at] == parser->type);
}

bool motor_board_parse(struct MotorBoardParser* parser, uint8_t byte) {
  if (parser->filled == parser->size) parser->filled = 0;  // it was taken
  parser->frame[parser->filled++] = byte;
  if (parser->filled == parser->size) {
    if (is_whole(parser->frame, parser->size, parser->type)) return true;
    ++parser->refused;
    memmove(parser->frame, parser->frame + 1, --parser->filled);  // a frame may begin within
  }
  while (parser->filled > 0 && !may_begin(parser)) memmove(parser->frame, parser->frame + 1, --parser->filled);
  return false;
}
