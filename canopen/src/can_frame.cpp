// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cassert>
#include <regista/canopen/can_frame.hpp>

namespace regista::canopen {
namespace {

/// Counts bits as a controller puts them on the bus.
class BitCounter {
 public:
  void put(std::uint32_t value, int width) {
    for (int i = width - 1; i >= 0; --i) bit(((value >> i) & 1U) != 0);
  }
  /// CRC-15 of what was put so far, x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1 (ISO 11898-1, 10.4.2.6).
  [[nodiscard]] std::uint32_t crc() const { return crc_; }
  [[nodiscard]] int count() const { return count_; }

 private:
  void bit(bool value) {
    const bool invert = value != ((crc_ & 0x4000U) != 0);
    crc_ = (crc_ << 1) & 0x7FFFU;
    if (invert) crc_ ^= 0x4599U;
    ++count_;
    run_ = value == last_ ? run_ + 1 : 1;
    last_ = value;
    if (run_ == 5) {  // a stuff bit of the other value follows, and begins a new run
      ++count_;
      last_ = !value;
      run_ = 1;
    }
  }

  std::uint32_t crc_ = 0;
  int count_ = 0;
  int run_ = 0;
  bool last_ = true;  // the idle bus
};

// Of linux/can/error.h: the ids are classes, the second byte is the state of the controller.
constexpr std::uint32_t controller = 0x04, no_acknowledge = 0x20, bus_off = 0x40, restarted = 0x100, counters = 0x200;
constexpr std::uint8_t warning = 0x04 | 0x08, passive = 0x10 | 0x20, active = 0x40;

}  // namespace

CanFrame make_frame(std::uint32_t id, std::initializer_list<std::uint8_t> bytes) {
  assert(bytes.size() <= 8);
  CanFrame frame{.id = id, .size = static_cast<std::uint8_t>(bytes.size())};
  std::ranges::copy(bytes, frame.data.begin());
  return frame;
}

int frame_bits(const CanFrame& frame) {
  const auto is_remote = static_cast<std::uint32_t>(frame.remote);
  BitCounter bits;
  bits.put(0, 1);  // start of frame
  if (frame.extended) {
    bits.put(frame.id >> 18, 11);
    bits.put(0b11, 2);  // SRR, IDE
    bits.put(frame.id & 0x3FFFFU, 18);
    bits.put(is_remote << 2, 3);  // RTR, r1, r0
  } else {
    bits.put(frame.id, 11);
    bits.put(is_remote << 2, 3);  // RTR, IDE, r0
  }
  bits.put(frame.size, 4);
  for (const std::uint8_t byte : frame.bytes()) bits.put(byte, 8);
  bits.put(bits.crc(), 15);
  return bits.count() + 13;  // both delimiters, acknowledgement, end of frame, intermission
}

std::string to_string(BusState state) {
  switch (state) {
    case BusState::active:
      return "active";
    case BusState::warning:
      return "warning";
    case BusState::passive:
      return "error passive";
    case BusState::off:
      return "bus-off";
    case BusState::down:
      return "down";
  }
  return "unknown";
}

BusReport bus_report(const CanFrame& frame) {
  BusReport report;
  if ((frame.id & restarted) != 0) report.state = BusState::active;
  if ((frame.id & controller) != 0) {
    const std::uint8_t status = frame.data[1];
    if ((status & passive) != 0) {
      report.state = BusState::passive;
    } else if ((status & warning) != 0) {
      report.state = BusState::warning;
    } else if ((status & active) != 0) {
      report.state = BusState::active;
    }
  }
  if ((frame.id & bus_off) != 0) report.state = BusState::off;
  report.no_acknowledge = (frame.id & no_acknowledge) != 0;
  if ((frame.id & counters) != 0) {
    report.transmit_errors = frame.data[6];
    report.receive_errors = frame.data[7];
  }
  return report;
}

CanFrame error_frame(BusState state) {
  CanFrame frame{.id = controller, .error = true, .size = 8};
  switch (state) {
    case BusState::active:
      frame.data[1] = active;
      break;
    case BusState::warning:
      frame.data[1] = warning;
      break;
    case BusState::passive:
      frame.data[1] = passive;
      break;
    case BusState::off:
    case BusState::down:
      frame.id = bus_off;
      break;
  }
  return frame;
}

std::string hex(std::uint64_t value, int digits) {
  std::string text(static_cast<std::size_t>(digits), '0');
  for (auto digit = text.rbegin(); digit != text.rend(); ++digit, value >>= 4) *digit = "0123456789ABCDEF"[value & 0xF];
  return text;
}

std::string to_string(ObjectIndex object) { return hex(object.index, 4) + ":" + hex(object.sub, 2); }

std::uint64_t get_le(ByteView bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < std::min<std::size_t>(bytes.size(), 8); ++i) value |= std::uint64_t{bytes[i]} << (8 * i);
  return value;
}

Bytes le_bytes(std::uint64_t value, std::size_t size) {
  Bytes bytes(size);
  for (std::uint8_t& byte : bytes) {
    byte = static_cast<std::uint8_t>(value);
    value >>= 8;
  }
  return bytes;
}

}  // namespace regista::canopen
