// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/canopen/can_frame.hpp>
#include <regista/core/result.hpp>
#include <string_view>

namespace regista::canopen {

/// One line of `candump -L`: "(1436509052.249713) can0 605#4041600000000000".
struct LogEntry {
  double time_s = 0;
  std::string interface;
  CanFrame frame;
};
std::string to_string(const LogEntry& entry);
/// Fails with `invalid_argument`, and says what is wrong with it.
Result<LogEntry> parse_log_line(std::string_view line);

/// What a frame is, in CANopen's words: "node 5 SDO read 6041:00", "NMT start all".
std::string describe(const CanFrame& frame);

}  // namespace regista::canopen
