// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <optional>
#include <regista/core/time.hpp>
#include <span>
#include <string>
#include <vector>

namespace regista::canopen {

/// 1 to 127; 0 means all nodes where a function says so.
using NodeId = std::uint8_t;
inline constexpr NodeId first_node = 1;
inline constexpr NodeId last_node = 127;

using Bytes = std::vector<std::uint8_t>;
using ByteView = std::span<const std::uint8_t>;

/// A classical CAN frame (CAN 2.0). Error frames are those of SocketCAN: not on the wire, but told by the controller.
struct CanFrame {
  std::uint32_t id = 0;  ///< 11 bits, 29 when extended; the class when it is an error frame
  bool extended = false;
  bool remote = false;    ///< a request for data: `size` bytes are asked for, `data` is void
  bool error = false;     ///< see BusReport
  std::uint8_t size = 0;  ///< of data, 0 to 8
  std::array<std::uint8_t, 8> data{};

  [[nodiscard]] ByteView bytes() const { return {data.data(), remote ? std::size_t{0} : size}; }
  bool operator==(const CanFrame&) const = default;
};

/// A data frame with an 11-bit id. `bytes` are at most 8.
CanFrame make_frame(std::uint32_t id, std::initializer_list<std::uint8_t> bytes);

/// Bits that the frame takes on the bus, its own stuff bits and the 3 bits of intermission included (ISO 11898-1).
int frame_bits(const CanFrame& frame);
/// The most that a data frame of this size can take.
constexpr int worst_frame_bits(int size, bool extended = false) {
  const int stuffable = (extended ? 54 : 34) + 8 * size;
  return stuffable + 13 + (stuffable - 1) / 4;
}

/// `bits` at a bit rate [bit/s].
constexpr Duration bus_time(int bits, int bit_rate) {
  return std::chrono::nanoseconds{1'000'000'000LL * bits / bit_rate};
}

/// How a controller stands on its bus (ISO 11898-1, fault confinement).
enum class BusState : std::uint8_t {
  active,
  warning,  ///< an error counter is above 95
  passive,  ///< above 127: it may no longer destroy other nodes' frames
  off,      ///< the transmit counter went above 255: it takes no part until it is restarted
  down,     ///< the interface is down or gone, or nothing could be sent for the link time-out
};
std::string to_string(BusState state);

/// What a controller told in an error frame.
struct BusReport {
  std::optional<BusState> state;  ///< empty: as before
  bool no_acknowledge = false;    ///< nobody heard our frame: no other node, wrong bit rate, broken cable
  std::optional<std::uint8_t> transmit_errors;
  std::optional<std::uint8_t> receive_errors;
};

/// Of a frame with `error` set.
BusReport bus_report(const CanFrame& error_frame);
/// The error frame with which a controller tells its state; what the tests' buses use.
CanFrame error_frame(BusState state);

/// An entry of a node's dictionary.
struct ObjectIndex {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  auto operator<=>(const ObjectIndex&) const = default;
};
/// "6040:00", hexadecimal.
std::string to_string(ObjectIndex object);

/// `bytes` hexadecimal digits: "60FF".
std::string hex(std::uint64_t value, int digits);

/// Little-endian, as CANopen has it; of more than 8 bytes, which a node may send for any object, the first 8.
std::uint64_t get_le(ByteView bytes);
/// The lowest `size` bytes of a value, 1 to 8.
Bytes le_bytes(std::uint64_t value, std::size_t size);

}  // namespace regista::canopen
