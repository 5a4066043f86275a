// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <mutex>
#include <regista/server/server.hpp>
#include <thread>

namespace regista::testing {

/// A server in this process, on a free port of 127.0.0.1 and on a thread of its own: ready when constructed, at rest
/// when destroyed.
class TestServer {
 public:
  /// `config`: the text of a .cfg; `plugins`: the drivers that it names. Throws what Server throws.
  explicit TestServer(const std::string& config, std::vector<const Plugin*> plugins = {});
  ~TestServer();
  TestServer(const TestServer&) = delete;
  TestServer& operator=(const TestServer&) = delete;

  [[nodiscard]] std::uint16_t port() const { return port_; }
  /// Come to rest. True: all drivers did in time.
  bool stop();

  /// Everything logged so far, a line each. Safe from any thread.
  [[nodiscard]] std::vector<std::string> log() const;
  /// The first line that contains `text`, now or within `timeout`; throws std::runtime_error with the log when there is
  /// none. Safe from any thread.
  [[nodiscard]] std::string logged(std::string_view text, Duration timeout = std::chrono::seconds{10}) const;

 private:
  [[nodiscard]] ServerOptions options(std::vector<const Plugin*> plugins);

  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  std::vector<std::string> log_;
  bool ready_ = false;
  Server server_;
  std::uint16_t port_;
  bool at_rest_ = false;
  std::thread thread_;
};

}  // namespace regista::testing
