// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <regista/core/time.hpp>
#include <thread>

namespace regista::testing {

/// A bad network between clients and a server on 127.0.0.1: clients connect to `port()`. What it does to each direction
/// can be changed at any time, from any thread.
class FaultProxy {
 public:
  /// One direction of all connections.
  struct Direction {
    std::atomic<Duration::rep> delay_ns{0};  ///< of what comes from now on; order is kept
    /// What comes disappears, and so do farewells. In both directions it is a pulled cable: half-open connections.
    std::atomic<bool> swallow{false};
  };

  explicit FaultProxy(std::uint16_t server_port);
  ~FaultProxy();
  FaultProxy(const FaultProxy&) = delete;
  FaultProxy& operator=(const FaultProxy&) = delete;

  [[nodiscard]] std::uint16_t port() const { return port_; }
  Direction to_server;
  Direction to_client;
  /// Both sides of every connection get an RST.
  void reset();

 private:
  void run();

  std::uint16_t server_port_;
  std::uint16_t port_ = 0;
  int listener_ = -1;
  int wakeup_ = -1;
  std::atomic<bool> stop_{false};
  std::atomic<bool> reset_{false};
  std::thread thread_;
};

}  // namespace regista::testing
