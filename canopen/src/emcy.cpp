// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/canopen/emcy.hpp>
#include <regista/canopen/nmt.hpp>

namespace regista::canopen {
namespace {

struct Text {
  std::uint16_t code;
  std::uint16_t mask;  ///< bits of the code that count
  const char* text;
};

// CiA 301, table 26, and CiA 402-2, table of error codes. The first that fits; classes come after what is in them.
constexpr std::array texts = std::to_array<Text>({
    {0x0000, 0xFF00, "no error, or error reset"},
    {0x2310, 0xFFFF, "continuous over-current"},
    {0x2320, 0xFFFF, "short circuit or earth leakage at the output"},
    {0x2330, 0xFFFF, "earth leakage at the output"},
    {0x2340, 0xFFFF, "short circuit at the output"},
    {0x2100, 0xFF00, "current, device input side"},
    {0x2200, 0xFF00, "current inside the device"},
    {0x2300, 0xFF00, "current, device output side"},
    {0x2000, 0xF000, "current"},
    {0x3110, 0xFFFF, "mains over-voltage"},
    {0x3120, 0xFFFF, "mains under-voltage"},
    {0x3130, 0xFFFF, "phase failure"},
    {0x3210, 0xFFFF, "DC link over-voltage"},
    {0x3220, 0xFFFF, "DC link under-voltage"},
    {0x3100, 0xFF00, "mains voltage"},
    {0x3200, 0xFF00, "voltage inside the device"},
    {0x3300, 0xFF00, "output voltage"},
    {0x3000, 0xF000, "voltage"},
    {0x4110, 0xFFFF, "ambient temperature too high"},
    {0x4210, 0xFFFF, "device temperature too high"},
    {0x4310, 0xFFFF, "drive temperature too high"},
    {0x4100, 0xFF00, "ambient temperature"},
    {0x4200, 0xFF00, "device temperature"},
    {0x4000, 0xF000, "temperature"},
    {0x5000, 0xF000, "device hardware"},
    {0x6100, 0xFF00, "internal software"},
    {0x6200, 0xFF00, "user software"},
    {0x6300, 0xFF00, "data set"},
    {0x6000, 0xF000, "device software"},
    {0x7121, 0xFFFF, "motor blocked"},
    {0x7122, 0xFFFF, "motor error or commutation malfunction"},
    {0x7120, 0xFFF0, "motor"},
    {0x7300, 0xFF00, "sensor"},
    {0x7500, 0xFF00, "communication module"},
    {0x7000, 0xF000, "additional modules"},
    {0x8110, 0xFFFF, "CAN overrun, messages lost"},
    {0x8120, 0xFFFF, "CAN in error passive mode"},
    {0x8130, 0xFFFF, "life guard or heartbeat error"},
    {0x8140, 0xFFFF, "recovered from bus-off"},
    {0x8150, 0xFFFF, "CAN-ID collision"},
    {0x8210, 0xFFFF, "PDO not processed: too short"},
    {0x8220, 0xFFFF, "PDO too long"},
    {0x8230, 0xFFFF, "DAM MPDO not processed: no such object"},
    {0x8240, 0xFFFF, "unexpected length of SYNC"},
    {0x8250, 0xFFFF, "RPDO time-out"},
    {0x8311, 0xFFFF, "excess torque"},
    {0x8400, 0xFF00, "velocity control"},
    {0x8500, 0xFF00, "position control"},
    {0x8611, 0xFFFF, "following error"},
    {0x8612, 0xFFFF, "reference limit"},
    {0x8100, 0xFF00, "communication"},
    {0x8200, 0xFF00, "protocol error"},
    {0x8000, 0xF000, "monitoring"},
    {0x9000, 0xFF00, "external error"},
    {0xF000, 0xFF00, "additional functions"},
    {0xFF00, 0xFF00, "device specific"},
    {0x1000, 0xF000, "generic error"},
});

constexpr std::array register_bits = std::to_array<const char*>(
    {"generic", "current", "voltage", "temperature", "communication", "profile", "reserved", "maker"});

}  // namespace

std::optional<Emcy> Emcy::decode(const CanFrame& frame) {
  const bool in_range = emcy_id < frame.id && frame.id <= emcy_id + last_node;
  if (!in_range || frame.extended || frame.remote || frame.error || frame.size != 8) return {};
  Emcy emcy{static_cast<std::uint16_t>(frame.data[0] | frame.data[1] << 8), frame.data[2], {}};
  std::copy(frame.data.begin() + 3, frame.data.end(), emcy.more.begin());
  return emcy;
}

CanFrame Emcy::encode(NodeId node) const {
  CanFrame frame = make_frame(emcy_id + node, {static_cast<std::uint8_t>(code), static_cast<std::uint8_t>(code >> 8),
                                               error_register, 0, 0, 0, 0, 0});
  std::ranges::copy(more, frame.data.begin() + 3);
  return frame;
}

std::string emcy_text(std::uint16_t code) {
  for (const Text& text : texts) {
    if ((code & text.mask) == text.code) return text.text;
  }
  return "unknown code";
}

std::string to_string(const Emcy& emcy) {
  std::string text =
      "EMCY 0x" + hex(emcy.code, 4) + " " + emcy_text(emcy.code) + " (reg 0x" + hex(emcy.error_register, 2);
  const char* separator = ": ";
  for (std::size_t bit = 0; bit < register_bits.size(); ++bit) {
    if ((emcy.error_register >> bit & 1U) == 0) continue;
    text += separator;
    text += register_bits[bit];
    separator = ", ";
  }
  text += ')';
  if (std::ranges::any_of(emcy.more, [](std::uint8_t byte) { return byte != 0; })) {
    text += " data";
    for (const std::uint8_t byte : emcy.more) text += " " + hex(byte, 2);
  }
  return text;
}

void EmcyHistory::add(const Emcy& emcy, Time now) {
  std::shift_right(entries_.begin(), entries_.end(), 1);
  entries_[0] = {emcy, now};
  count_ = std::min(count_ + 1, entries_.size());
  ++total_;
}

}  // namespace regista::canopen
