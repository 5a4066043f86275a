// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <filesystem>
#include <mutex>
#include <regista/ssl/log_file.hpp>
#include <thread>

namespace regista::vision {

/// Writes datagrams to a log file on a thread of its own, so that a slow or full disk delays no pose.
class Recorder {
 public:
  /// Throws std::runtime_error when the file cannot be written.
  explicit Recorder(const std::filesystem::path& file);
  ~Recorder();  ///< writes what waits
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Never blocks on the disk. What does not fit into 8 MiB is dropped and counted.
  void add(ssl::LogType type, std::span<const std::byte> datagram);

  [[nodiscard]] std::uint64_t written() const { return written_; }
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }

 private:
  void run(const std::stop_token& stop);

  ssl::LogWriter log_;
  std::mutex mutex_;
  std::condition_variable_any filled_;
  std::deque<ssl::LogRecord> queue_;  // guarded by mutex_
  std::size_t bytes_ = 0;             // likewise
  std::atomic<std::uint64_t> written_ = 0;
  std::atomic<std::uint64_t> dropped_ = 0;
  std::jthread thread_;  // the last: it uses all of the above
};

}  // namespace regista::vision
