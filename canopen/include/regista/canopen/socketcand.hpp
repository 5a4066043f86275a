// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <regista/canopen/can_bus.hpp>
#include <string_view>

namespace regista::canopen {

/// A bus of another machine, through its socketcand (TCP, raw mode; doc/protocol.md of linux-can/socketcand). It
/// carries neither remote frames nor the contents of error frames.
class SocketCand final : public CanBus {
 public:
  /// Blocks for up to `timeout`. Fails as the network does, or with what the daemon said.
  static Result<std::unique_ptr<SocketCand>> open(const std::string& host, std::uint16_t port, const std::string& bus,
                                                  Duration timeout);
  ~SocketCand() override;
  SocketCand(const SocketCand&) = delete;
  SocketCand& operator=(const SocketCand&) = delete;

  /// Remote frames fail with `operation_not_supported`.
  Result<> send(const CanFrame& frame) override;
  Result<std::optional<ReceivedFrame>> receive() override;
  [[nodiscard]] int descriptor() const override { return socket_; }

 private:
  SocketCand(int socket, std::string where) : socket_{socket}, where_{std::move(where)} {}
  Result<std::string> next_message(Time until);
  Result<bool> fill();

  int socket_;
  std::string where_;
  std::string in_;
  std::size_t read_ = 0;  ///< of in_
  std::string out_;       ///< what the network has not taken yet, at most 4 KiB
};

/// "< send 605 8 40 41 60 0 0 0 0 0 >", for tests and servers.
std::string socketcand_send(const CanFrame& frame);
/// A "< frame … >" or "< error … >" without its brackets; empty if it is neither.
std::optional<CanFrame> parse_socketcand(std::string_view message);

}  // namespace regista::canopen
