// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <regista/core/result.hpp>
#include <span>
#include <vector>

namespace regista::ssl {

/// What a record of a log file holds; the numbers are the league's, and others exist.
enum class LogType : std::int32_t { vision_2010 = 2, referee = 3, vision = 4, tracker = 5, index = 6 };

struct LogRecord {
  std::int64_t received_ns = 0;  ///< Unix time
  LogType type = LogType::vision;
  std::vector<std::byte> datagram;
};

/// Reads the league's log files: "SSL_LOG_FILE", a version, and then record after record, big-endian.
class LogReader {
 public:
  /// Throws std::runtime_error, naming the file, when it cannot be read or is none.
  explicit LogReader(const std::filesystem::path& file);

  /// The next record; none at the end. Fails with `bad_message` where the file is damaged or was cut short: there it
  /// ends.
  Result<std::optional<LogRecord>> next();

 private:
  std::ifstream file_;
};

/// Writes one that the league's tools play. Blocks as disks do.
class LogWriter {
 public:
  /// Throws std::runtime_error, naming the file, when it cannot be written.
  explicit LogWriter(const std::filesystem::path& file);

  /// Fails with `io_error` when the disk is full.
  Result<> write(std::int64_t received_ns, LogType type, std::span<const std::byte> datagram);

 private:
  std::ofstream file_;
};

}  // namespace regista::ssl
