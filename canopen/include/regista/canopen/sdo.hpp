// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/canopen/can_frame.hpp>
#include <regista/core/result.hpp>
#include <system_error>

namespace regista::canopen {

/// Why a node, or our client, ended an SDO transfer (CiA 301, table 22).
enum class SdoAbort : std::uint32_t {
  toggle = 0x05030000,
  timed_out = 0x05040000,
  unknown_command = 0x05040001,
  block_size = 0x05040002,
  sequence_number = 0x05040003,
  crc = 0x05040004,
  out_of_memory = 0x05040005,
  unsupported_access = 0x06010000,
  write_only = 0x06010001,
  read_only = 0x06010002,
  no_object = 0x06020000,
  not_mappable = 0x06040041,
  pdo_length = 0x06040042,
  parameter_incompatible = 0x06040043,
  internal_incompatibility = 0x06040047,
  hardware = 0x06060000,
  length = 0x06070010,
  too_long = 0x06070012,
  too_short = 0x06070013,
  no_subindex = 0x06090011,
  value = 0x06090030,
  value_too_high = 0x06090031,
  value_too_low = 0x06090032,
  maximum_below_minimum = 0x06090036,
  no_resource = 0x060A0023,
  general = 0x08000000,
  cannot_store = 0x08000020,
  local_control = 0x08000021,
  device_state = 0x08000022,
  no_dictionary = 0x08000023,
  no_data = 0x08000024,
};

/// Its messages are "SDO abort 0x06010002: the object is read-only"; codes that CiA 301 does not know keep their
/// number.
const std::error_category& sdo_category() noexcept;
inline std::error_code make_error_code(SdoAbort code) { return {static_cast<int>(code), sdo_category()}; }

/// CRC-16 of block transfers: x^16 + x^12 + x^5 + 1, from 0 (CiA 301, 7.2.4.3.16).
std::uint16_t sdo_crc(ByteView bytes, std::uint16_t crc = 0);

}  // namespace regista::canopen

template <>
struct std::is_error_code_enum<regista::canopen::SdoAbort> : std::true_type {};
