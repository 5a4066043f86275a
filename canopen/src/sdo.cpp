// SPDX-License-Identifier: Apache-2.0
#include <regista/canopen/sdo.hpp>

namespace regista::canopen {
namespace {

const char* text(SdoAbort code) {
  switch (code) {
    case SdoAbort::toggle:
      return "toggle bit not alternated";
    case SdoAbort::timed_out:
      return "SDO protocol timed out";
    case SdoAbort::unknown_command:
      return "command specifier not valid or unknown";
    case SdoAbort::block_size:
      return "invalid block size";
    case SdoAbort::sequence_number:
      return "invalid sequence number";
    case SdoAbort::crc:
      return "CRC error";
    case SdoAbort::out_of_memory:
      return "out of memory";
    case SdoAbort::unsupported_access:
      return "unsupported access to the object";
    case SdoAbort::write_only:
      return "the object is write-only";
    case SdoAbort::read_only:
      return "the object is read-only";
    case SdoAbort::no_object:
      return "no such object in the dictionary";
    case SdoAbort::not_mappable:
      return "the object cannot be mapped to the PDO";
    case SdoAbort::pdo_length:
      return "the mapped objects would exceed the length of the PDO";
    case SdoAbort::parameter_incompatible:
      return "general parameter incompatibility";
    case SdoAbort::internal_incompatibility:
      return "general internal incompatibility in the device";
    case SdoAbort::hardware:
      return "access failed due to a hardware error";
    case SdoAbort::length:
      return "the data type or the length does not match";
    case SdoAbort::too_long:
      return "the data are too long for the data type";
    case SdoAbort::too_short:
      return "the data are too short for the data type";
    case SdoAbort::no_subindex:
      return "no such sub-index";
    case SdoAbort::value:
      return "invalid value";
    case SdoAbort::value_too_high:
      return "value too high";
    case SdoAbort::value_too_low:
      return "value too low";
    case SdoAbort::maximum_below_minimum:
      return "maximum below minimum";
    case SdoAbort::no_resource:
      return "resource not available: SDO connection";
    case SdoAbort::general:
      return "general error";
    case SdoAbort::cannot_store:
      return "data cannot be transferred or stored";
    case SdoAbort::local_control:
      return "data cannot be transferred or stored because of local control";
    case SdoAbort::device_state:
      return "data cannot be transferred or stored in the present state of the device";
    case SdoAbort::no_dictionary:
      return "no object dictionary, or it could not be generated";
    case SdoAbort::no_data:
      return "no data available";
  }
  return "unknown code";
}

}  // namespace

const std::error_category& sdo_category() noexcept {
  static const class Category final : public std::error_category {
    [[nodiscard]] const char* name() const noexcept override { return "SDO"; }
    [[nodiscard]] std::string message(int code) const override {
      const auto number = static_cast<std::uint32_t>(code);
      return "SDO abort 0x" + hex(number, 8) + ": " + text(static_cast<SdoAbort>(number));
    }
  } category;
  return category;
}

std::uint16_t sdo_crc(ByteView bytes, std::uint16_t crc) {
  unsigned value = crc;
  for (const std::uint8_t byte : bytes) {
    value ^= static_cast<unsigned>(byte) << 8;
    for (int i = 0; i < 8; ++i) value = (value & 0x8000U) != 0 ? (value << 1 ^ 0x1021U) & 0xFFFFU : value << 1;
  }
  return static_cast<std::uint16_t>(value);
}

}  // namespace regista::canopen
