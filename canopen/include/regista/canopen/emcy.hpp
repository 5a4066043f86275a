// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/canopen/can_frame.hpp>

namespace regista::canopen {

/// An emergency message: a node tells that an error came or went (CiA 301, 7.2.7).
struct Emcy {
  std::uint16_t code = 0;              ///< 0: all errors are gone
  std::uint8_t error_register = 0;     ///< object 1001
  std::array<std::uint8_t, 5> more{};  ///< the maker's own

  static std::optional<Emcy> decode(const CanFrame& frame);
  [[nodiscard]] CanFrame encode(NodeId node) const;
  bool operator==(const Emcy&) const = default;
};

/// "EMCY 0x3210 DC link over-voltage (reg 0x05: generic, voltage)". The texts are those of CiA 301 (table 26) and CiA
/// 402-2.
std::string to_string(const Emcy& emcy);
/// "DC link over-voltage", or that of the class of errors.
std::string emcy_text(std::uint16_t code);

/// The last emergencies of a node, newest first.
class EmcyHistory {
 public:
  struct Entry {
    Emcy emcy;
    Time time;
  };
  void add(const Emcy& emcy, Time now);
  [[nodiscard]] std::span<const Entry> entries() const { return {entries_.data(), count_}; }
  [[nodiscard]] std::uint64_t total() const { return total_; }
  /// Errors were told and have not been cleared.
  [[nodiscard]] bool active() const { return count_ > 0 && entries_[0].emcy.code != 0; }

 private:
  std::array<Entry, 16> entries_{};
  std::size_t count_ = 0;
  std::uint64_t total_ = 0;
};

}  // namespace regista::canopen
