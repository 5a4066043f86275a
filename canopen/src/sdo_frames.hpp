// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/canopen/can_frame.hpp>

// What client and server find in the same places of their frames (CiA 301, 7.2.4.3).

namespace regista::canopen {

inline constexpr std::size_t segment_bytes = 7;
inline constexpr std::uint8_t last_segment = 0x80;  ///< flag of a block's segment
inline constexpr std::uint8_t abort_command = 0x80;
inline constexpr std::uint8_t most_segments = 127;  ///< in a block

inline ObjectIndex object_of(const CanFrame& frame) {
  return {static_cast<std::uint16_t>(get_le(ByteView{frame.data}.subspan(1, 2))), frame.data[3]};
}
inline std::uint32_t word_of(const CanFrame& frame) {
  return static_cast<std::uint32_t>(get_le(ByteView{frame.data}.subspan(4, 4)));
}
inline std::uint16_t crc_of(const CanFrame& frame) {
  return static_cast<std::uint16_t>(get_le(ByteView{frame.data}.subspan(1, 2)));
}
inline bool is_block_size(std::uint8_t segments) { return 1 <= segments && segments <= most_segments; }

}  // namespace regista::canopen
