// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <poll.h>

#include <functional>
#include <regista/ssl/multicast.hpp>
#include <string>
#include <vector>

namespace regista::vision {

/// Answers HTTP on loopback: /metrics in Prometheus' text format, anything else in JSON. Never blocks.
class StatusServer {
 public:
  using Status = std::function<std::string()>;  ///< the JSON

  /// Port 0: any free one. Throws std::system_error when the port cannot be had.
  StatusServer(std::uint16_t port, Status status);

  [[nodiscard]] std::uint16_t port() const { return port_; }
  void add_polls(std::vector<pollfd>& polls) const;
  /// Go on with whatever is ready.
  void service();

 private:
  struct Peer {
    ssl::Descriptor socket;
    std::string request;
    std::string answer;
    std::size_t sent = 0;
  };

  [[nodiscard]] std::string answer(const std::string& request) const;
  bool serve(Peer& peer) const;

  Status status_;
  ssl::Descriptor listener_;
  std::uint16_t port_ = 0;
  std::vector<Peer> peers_;
};

}  // namespace regista::vision
