// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

/// MicroStrain's two protocols. Pure: bytes in, packets out.
namespace regista::microstrain {

/// A sample as the sensor says it, in its own axes: x ahead, y right, z down; the earth's are north, east, down.
struct Sample {
  std::array<float, 3> acceleration_g{};  ///< specific force: level and at rest (0, 0, -1)
  std::array<float, 3> rate_radps{};
  std::array<float, 3> field_gauss{};
  std::array<float, 9> sensor_from_earth{};  ///< by rows: M of both manuals, v_sensor = M v_earth

  friend bool operator==(const Sample&, const Sample&) = default;
};

/// What a MIP sensor answers to a command.
struct Answer {
  std::uint8_t set = 0;
  std::uint8_t command = 0;
  std::uint8_t error = 0;     ///< 0: done
  std::uint16_t base_hz = 0;  ///< of GET_IMU_BASE_RATE; 0: another command

  friend bool operator==(const Answer&, const Answer&) = default;
};

/// What one packet brought. Neither: one that is of no interest here.
struct Packet {
  std::optional<Sample> sample;
  std::optional<Answer> answer;
};

enum class Protocol : std::uint8_t { single_byte, mip };

/// Finds packets among bytes, whatever was lost or added between them. After a wrong checksum it drops one byte, not a
/// packet: what begins within a broken one is not lost.
class Reader {
 public:
  explicit Reader(Protocol protocol) : protocol_{protocol} {}

  /// Where the next bytes may be written, never empty; then say how many there are by filled(), and take all packets.
  [[nodiscard]] std::span<std::uint8_t> space();
  void filled(std::size_t count) { end_ += count; }
  std::optional<Packet> next();

  /// Bytes that were no part of a packet; those of broken ones among them.
  [[nodiscard]] std::uint64_t skipped() const { return skipped_; }

 private:
  std::optional<Packet> next_single_byte();
  std::optional<Packet> next_mip();
  void skip(std::size_t count);

  Protocol protocol_;
  std::array<std::uint8_t, 1024> bytes_{};
  std::size_t begin_ = 0;
  std::size_t end_ = 0;
  std::uint64_t skipped_ = 0;
};

/// 3DM-GX3-25 Data Communications Protocol (single byte), version 1.14: stop, then send "Acceleration, Angular Rate &
/// Magnetometer Vectors & Orientation Matrix" (0xCC) continuously.
[[nodiscard]] std::vector<std::uint8_t> start_single_byte();
[[nodiscard]] std::vector<std::uint8_t> stop_single_byte();

/// One MIP packet with one field: 3DM-GX5 DCP manual, 2.1.
[[nodiscard]] std::vector<std::uint8_t> mip_command(std::uint8_t set, std::uint8_t command,
                                                    std::span<const std::uint8_t> arguments = {});
/// Be still, and tell the base rate, which start_mip() needs.
[[nodiscard]] std::vector<std::uint8_t> ask_mip();
/// Send accelerations, turn rates, field and orientation matrix each `decimation` samples of the base rate.
[[nodiscard]] std::vector<std::uint8_t> start_mip(std::uint16_t decimation);
[[nodiscard]] std::vector<std::uint8_t> stop_mip();

/// "3DM command 0x08: invalid parameter (3)"
[[nodiscard]] std::string to_string(const Answer& answer);

}  // namespace regista::microstrain
