// SPDX-License-Identifier: Apache-2.0
#include "microstrain.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>

namespace regista::microstrain {

namespace {

/// Single byte protocol.
constexpr std::uint8_t all_vectors = 0xCC;
constexpr std::size_t all_vectors_size = 79;  // header, 18 floats, timer, checksum
constexpr std::uint8_t continuous_mode = 0xC4;
constexpr std::size_t continuous_mode_size = 8;

/// MIP.
constexpr std::size_t mip_header = 4;
constexpr std::size_t mip_checksum = 2;
namespace set {
constexpr std::uint8_t base = 0x01, sensor_3dm = 0x0C, imu_data = 0x80;
}  // namespace set
namespace command {
constexpr std::uint8_t idle = 0x02, resume = 0x06;                              // of set base
constexpr std::uint8_t imu_base_rate = 0x06, imu_format = 0x08, stream = 0x11;  // of set 3DM
constexpr std::uint8_t acknowledge = 0xF1, imu_base_rate_reply = 0x83;
}  // namespace command
namespace field {
constexpr std::uint8_t acceleration = 0x04, rate = 0x05, magnetic = 0x06, matrix = 0x09;
}  // namespace field

std::uint16_t big_endian16(const std::uint8_t* bytes) { return static_cast<std::uint16_t>(bytes[0] << 8 | bytes[1]); }

float big_endian_float(const std::uint8_t* bytes) {
  return std::bit_cast<float>(static_cast<std::uint32_t>(bytes[0]) << 24 | static_cast<std::uint32_t>(bytes[1]) << 16 |
                              static_cast<std::uint32_t>(bytes[2]) << 8 | bytes[3]);
}

template <std::size_t n>
void read(const std::uint8_t* bytes, std::array<float, n>& values) {
  for (std::size_t i = 0; i < n; ++i) values[i] = big_endian_float(bytes + 4 * i);
}

template <std::size_t n>
bool all_finite(const std::array<float, n>& values) {
  return std::ranges::all_of(values, [](float value) { return std::isfinite(value); });
}

/// A checksum of 16 bits lets one piece of noise in 65536 pass; what has sane numbers besides is a sample.
bool is_sane(const Sample& sample) {
  if (!all_finite(sample.acceleration_g) || !all_finite(sample.rate_radps) || !all_finite(sample.field_gauss) ||
      !all_finite(sample.sensor_from_earth)) {
    return false;
  }
  for (std::size_t row = 0; row < 3; ++row) {
    float square = 0;
    for (std::size_t i = 0; i < 3; ++i)
      square += sample.sensor_from_earth[3 * row + i] * sample.sensor_from_earth[3 * row + i];
    if (!(std::abs(square - 1) < 0.01F)) return false;
  }
  return true;
}

std::uint16_t sum(std::span<const std::uint8_t> bytes) {
  std::uint16_t total = 0;
  for (const std::uint8_t byte : bytes) total = static_cast<std::uint16_t>(total + byte);
  return total;
}

/// Fletcher's checksum modulo 256, as the MIP manual prints it.
std::uint16_t fletcher(std::span<const std::uint8_t> bytes) {
  std::uint8_t first = 0;
  std::uint8_t second = 0;
  for (const std::uint8_t byte : bytes) {
    first = static_cast<std::uint8_t>(first + byte);
    second = static_cast<std::uint8_t>(second + first);
  }
  return static_cast<std::uint16_t>(first << 8 | second);
}

Packet read_imu_data(std::span<const std::uint8_t> payload) {
  Sample sample;
  int found = 0;
  while (payload.size() >= 2 && payload[0] >= 2 && payload[0] <= payload.size()) {
    const std::uint8_t* data = payload.data() + 2;
    const std::size_t size = payload[0] - 2U;
    switch (payload[1]) {
      case field::acceleration:
        if (size == 12) read(data, sample.acceleration_g), found |= 1;
        break;
      case field::rate:
        if (size == 12) read(data, sample.rate_radps), found |= 2;
        break;
      case field::magnetic:
        if (size == 12) read(data, sample.field_gauss), found |= 4;
        break;
      case field::matrix:
        if (size == 36) read(data, sample.sensor_from_earth), found |= 8;
        break;
      default:
        break;
    }
    payload = payload.subspan(payload[0]);
  }
  if (found != 15 || !is_sane(sample)) return {};
  return {.sample = sample, .answer = {}};
}

Packet read_answer(std::uint8_t set, std::span<const std::uint8_t> payload) {
  std::optional<Answer> answer;
  while (payload.size() >= 4 && payload[0] >= 4 && payload[0] <= payload.size()) {
    if (payload[1] == command::acknowledge) answer = Answer{.set = set, .command = payload[2], .error = payload[3]};
    if (payload[1] == command::imu_base_rate_reply && answer) answer->base_hz = big_endian16(&payload[2]);
    payload = payload.subspan(payload[0]);
  }
  return {.sample = {}, .answer = answer};
}

}  // namespace

std::span<std::uint8_t> Reader::space() {
  if (begin_ > 0) {
    std::copy(bytes_.begin() + static_cast<std::ptrdiff_t>(begin_), bytes_.begin() + static_cast<std::ptrdiff_t>(end_),
              bytes_.begin());
    end_ -= begin_;
    begin_ = 0;
  }
  return std::span{bytes_}.subspan(end_);
}

void Reader::skip(std::size_t count) {
  begin_ += count;
  skipped_ += count;
}

std::optional<Packet> Reader::next() { return protocol_ == Protocol::mip ? next_mip() : next_single_byte(); }

std::optional<Packet> Reader::next_single_byte() {
  while (begin_ < end_) {
    const std::uint8_t* packet = &bytes_[begin_];
    const std::size_t size = packet[0] == all_vectors       ? all_vectors_size
                             : packet[0] == continuous_mode ? continuous_mode_size
                                                            : 0;
    if (size == 0) {
      skip(1);
      continue;
    }
    if (end_ - begin_ < size) return {};
    if (sum({packet, size - 2}) != big_endian16(packet + size - 2)) {
      skip(1);
      continue;
    }
    if (packet[0] == continuous_mode) {
      begin_ += size;
      return Packet{};
    }
    Sample sample;
    read(packet + 1, sample.acceleration_g);
    read(packet + 13, sample.rate_radps);
    read(packet + 25, sample.field_gauss);
    read(packet + 37, sample.sensor_from_earth);
    if (!is_sane(sample)) {
      skip(1);
      continue;
    }
    begin_ += size;
    return Packet{.sample = sample, .answer = {}};
  }
  return {};
}

std::optional<Packet> Reader::next_mip() {
  while (begin_ < end_) {
    const std::uint8_t* packet = &bytes_[begin_];
    const std::size_t there = end_ - begin_;
    if (packet[0] != 0x75 || (there > 1 && packet[1] != 0x65)) {
      skip(1);
      continue;
    }
    if (there < mip_header) return {};
    const std::size_t size = mip_header + packet[3] + mip_checksum;
    if (there < size) return {};
    if (fletcher({packet, size - mip_checksum}) != big_endian16(packet + size - mip_checksum)) {
      skip(1);
      continue;
    }
    begin_ += size;
    const std::span payload{packet + mip_header, std::size_t{packet[3]}};
    if (packet[2] == set::imu_data) return read_imu_data(payload);
    return read_answer(packet[2], payload);
  }
  return {};
}

std::vector<std::uint8_t> stop_single_byte() { return {0xFA, 0x75, 0xB4}; }

std::vector<std::uint8_t> start_single_byte() {
  std::vector<std::uint8_t> bytes = stop_single_byte();
  for (const std::uint8_t byte : {continuous_mode, std::uint8_t{0xC1}, std::uint8_t{0x29}, all_vectors}) {
    bytes.push_back(byte);
  }
  return bytes;
}

std::vector<std::uint8_t> mip_command(std::uint8_t set, std::uint8_t command, std::span<const std::uint8_t> arguments) {
  const auto length = static_cast<std::uint8_t>(arguments.size() + 2);
  std::vector<std::uint8_t> packet{0x75, 0x65, set, length, length, command};
  packet.insert(packet.end(), arguments.begin(), arguments.end());
  const std::uint16_t checksum = fletcher(packet);
  packet.push_back(static_cast<std::uint8_t>(checksum >> 8));
  packet.push_back(static_cast<std::uint8_t>(checksum & 0xFF));
  return packet;
}

std::vector<std::uint8_t> stop_mip() { return mip_command(set::base, command::idle); }

std::vector<std::uint8_t> ask_mip() {
  std::vector<std::uint8_t> bytes = stop_mip();
  const auto ask = mip_command(set::sensor_3dm, command::imu_base_rate);
  bytes.insert(bytes.end(), ask.begin(), ask.end());
  return bytes;
}

std::vector<std::uint8_t> start_mip(std::uint16_t decimation) {
  constexpr std::array fields{field::acceleration, field::rate, field::magnetic, field::matrix};
  constexpr std::uint8_t use = 0x01;
  std::vector<std::uint8_t> format{use, static_cast<std::uint8_t>(fields.size())};
  for (const std::uint8_t field : fields) {
    format.push_back(field);
    format.push_back(static_cast<std::uint8_t>(decimation >> 8));
    format.push_back(static_cast<std::uint8_t>(decimation & 0xFF));
  }
  std::vector<std::uint8_t> bytes = mip_command(set::sensor_3dm, command::imu_format, format);
  constexpr std::uint8_t imu = 0x01;
  constexpr std::uint8_t on = 0x01;
  for (const auto& packet : {mip_command(set::sensor_3dm, command::stream, std::array{use, imu, on}),
                             mip_command(set::base, command::resume)}) {
    bytes.insert(bytes.end(), packet.begin(), packet.end());
  }
  return bytes;
}

std::string to_string(const Answer& answer) {
  // 3DM-GX5 DCP manual, "MIP packet error codes".
  const char* why = answer.error == 1   ? "unknown command"
                    : answer.error == 2 ? "invalid checksum"
                    : answer.error == 3 ? "invalid parameter"
                    : answer.error == 4 ? "command failed"
                    : answer.error == 5 ? "command timed out"
                                        : "error";
  char text[80];
  (void)std::snprintf(text, sizeof text, "%s command 0x%02X: %s (%u)", answer.set == set::base ? "base" : "3DM",
                      unsigned{answer.command}, why, unsigned{answer.error});
  return text;
}

}  // namespace regista::microstrain
