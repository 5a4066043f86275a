// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <charconv>
#include <cstdio>
#include <regista/canopen/candump.hpp>
#include <regista/canopen/emcy.hpp>
#include <regista/canopen/lss.hpp>
#include <regista/canopen/nmt.hpp>
#include <regista/canopen/sdo.hpp>
#include <regista/canopen/sync.hpp>

#include "sdo_frames.hpp"

namespace regista::canopen {
namespace {

Error invalid(std::string_view line, const char* what) {
  return {std::errc::invalid_argument, "'" + std::string{line} + "': " + what};
}

std::string hex_bytes(ByteView bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) text += hex(byte, 2);
  return text;
}

std::string describe_sdo(const CanFrame& frame, bool request) {
  const std::string object = " " + to_string(object_of(frame));
  const unsigned command = frame.data[0];
  if (command == abort_command) return make_error_code(static_cast<SdoAbort>(word_of(frame))).message() + object;
  if (request) {
    switch (command >> 5) {
      case 0:
        return "write segment (or of a block)";
      case 1:
        return "write" + object +
               ((command & 2U) != 0 ? " = " + hex_bytes(ByteView{frame.data}.subspan(
                                                  4, 4U - ((command & 1U) != 0 ? command >> 2 & 3U : 0U)))
                                    : " segmented");
      case 2:
        return "read" + object;
      case 3:
        return "read segment";
      case 5:
        return (command & 3U) == 0 ? "block read" + object : "block read: answer or end";
      case 6:
        return (command & 1U) == 0 ? "block write" + object : "block write: end";
      default:
        return "segment of a block";
    }
  }
  switch (command >> 5) {
    case 0:
      return "segment";
    case 1:
      return "segment written";
    case 2:
      return "read" + object +
             ((command & 2U) != 0 ? " = " + hex_bytes(ByteView{frame.data}.subspan(
                                                4, 4U - ((command & 1U) != 0 ? command >> 2 & 3U : 0U)))
                                  : " segmented");
    case 3:
      return "written" + object;
    case 5:
      return "block write: " + std::string{(command & 3U) == 0 ? "begin" + object : "answer"};
    case 6:
      return "block read: " + std::string{(command & 1U) == 0 ? "begin" + object : "end"};
    default:
      return "segment of a block";
  }
}

}  // namespace

std::string to_string(const LogEntry& entry) {
  std::array<char, 32> time{};
  (void)std::snprintf(time.data(), time.size(), "(%.6f) ", entry.time_s);
  const CanFrame& frame = entry.frame;
  // candump writes error frames as 29-bit ids with their flag.
  const std::uint32_t id = frame.error ? frame.id | 0x20000000U : frame.id;
  std::string text = time.data() + entry.interface + " " + hex(id, frame.extended || frame.error ? 8 : 3) + "#";
  if (frame.remote) return text + "R" + (frame.size != 0 ? std::to_string(frame.size) : "");
  return text + hex_bytes(frame.bytes());
}

Result<LogEntry> parse_log_line(std::string_view line) {
  LogEntry entry;
  std::string_view rest = line;
  const std::size_t close = rest.find(") ");
  if (!rest.starts_with('(') || close == std::string_view::npos) return invalid(line, "begins with no (time)");
  const auto [end, error] = std::from_chars(rest.data() + 1, rest.data() + close, entry.time_s);
  if (error != std::errc{} || end != rest.data() + close) return invalid(line, "begins with no (time)");
  rest.remove_prefix(close + 2);
  const std::size_t blank = rest.find(' ');
  const std::size_t hash = rest.find('#');
  if (blank == std::string_view::npos || hash == std::string_view::npos || hash < blank)
    return invalid(line, "no ID#DATA");
  entry.interface = rest.substr(0, blank);
  const std::string_view id = rest.substr(blank + 1, hash - blank - 1);
  std::string_view data = rest.substr(hash + 1);
  if (const std::size_t flags = data.find(' '); flags != std::string_view::npos)
    data = data.substr(0, flags);  // R or T
  CanFrame& frame = entry.frame;
  const auto [id_end, id_error] = std::from_chars(id.data(), id.data() + id.size(), frame.id, 16);
  if (id_error != std::errc{} || id_end != id.data() + id.size() || (id.size() != 3 && id.size() != 8)) {
    return invalid(line, "the id has neither 3 nor 8 hex digits");
  }
  frame.error = id.size() == 8 && (frame.id & 0x20000000U) != 0;
  frame.extended = id.size() == 8 && !frame.error;
  frame.id &= frame.extended || frame.error ? 0x1FFFFFFFU : 0x7FFU;
  if (data.starts_with('R')) {
    frame.remote = true;
    if (data.size() > 2 || (data.size() == 2 && (data[1] < '0' || data[1] > '8')))
      return invalid(line, "no length after R");
    frame.size = data.size() == 2 ? static_cast<std::uint8_t>(data[1] - '0') : std::uint8_t{0};
    return entry;
  }
  if (data.starts_with('#')) return invalid(line, "CAN FD");
  if (data.size() % 2 != 0 || data.size() > 16) return invalid(line, "the data are no 0 to 8 bytes");
  frame.size = static_cast<std::uint8_t>(data.size() / 2);
  for (std::size_t i = 0; i < frame.size; ++i) {
    const char* at = data.data() + 2 * i;
    const auto [byte_end, byte_error] = std::from_chars(at, at + 2, frame.data[i], 16);
    if (byte_error != std::errc{} || byte_end != at + 2) return invalid(line, "the data are no hex digits");
  }
  return entry;
}

std::string describe(const CanFrame& frame) {
  if (frame.error) {
    const BusReport report = bus_report(frame);
    std::string text = "controller:";
    if (report.state) text += " " + to_string(*report.state);
    if (report.no_acknowledge) text += " not acknowledged";
    if (!report.state && !report.no_acknowledge) text += " error 0x" + hex(frame.id, 8);
    return text;
  }
  if (frame.extended) return "29-bit id, not CANopen";
  const auto node = static_cast<NodeId>(frame.id & 0x7FU);
  const std::string of_node = "node " + std::to_string(node) + " ";
  if (frame.remote) {
    return (frame.id & 0x780U) == heartbeat_id ? of_node + "asked for its state"
                                               : "PDO " + hex(frame.id, 3) + " asked for";
  }
  if (frame.id == nmt_id && frame.size == 2) {
    return "NMT " + to_string(static_cast<NmtCommand>(frame.data[0])) +
           (frame.data[1] == 0 ? " all" : " node " + std::to_string(frame.data[1]));
  }
  if (frame.id == sync_id) return frame.size == 1 ? "SYNC " + std::to_string(frame.data[0]) : "SYNC";
  if (const auto emcy = Emcy::decode(frame)) return of_node + to_string(*emcy);
  if (decode_time(frame)) return "TIME";
  if (frame.id == lss_master_id) return "LSS request 0x" + hex(frame.data[0], 2);
  if (frame.id == lss_slave_id) return "LSS answer 0x" + hex(frame.data[0], 2);
  if (node == 0) return "not CANopen";
  switch (frame.id & 0x780U) {
    case 0x180:
    case 0x280:
    case 0x380:
    case 0x480:
      return of_node + "TPDO" + std::to_string((frame.id >> 8)) + " " + hex_bytes(frame.bytes());
    case 0x200:
    case 0x300:
    case 0x400:
    case 0x500:
      return of_node + "RPDO" + std::to_string((frame.id >> 8) - 1) + " " + hex_bytes(frame.bytes());
    case 0x580:
      return of_node + "SDO " + (frame.size == 8 ? describe_sdo(frame, false) : "broken answer");
    case 0x600:
      return of_node + "SDO " + (frame.size == 8 ? describe_sdo(frame, true) : "broken request");
    case heartbeat_id:
      return frame.size == 1 ? of_node + to_string(static_cast<NmtState>(frame.data[0] & 0x7FU))
                             : of_node + "broken heartbeat";
    default:
      return "PDO " + hex(frame.id, 3) + " " + hex_bytes(frame.bytes());
  }
}

}  // namespace regista::canopen
