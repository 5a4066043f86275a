// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <regista/canopen/can_bus.hpp>

namespace regista::canopen {

/// A CAN interface of Linux (CAN_RAW): can0, vcan0. Bit rate and restart after bus-off are set from outside:
/// `ip link set can0 up type can bitrate 500000 restart-ms 100`.
class SocketCan final : public CanBus {
 public:
  /// A frame passes if it equals `id` in the bits of `mask`.
  struct Filter {
    std::uint32_t id = 0;
    std::uint32_t mask = 0;
    bool extended = false;
  };
  /// The kernel drops what passes none of `filters`; without any, all frames come, as do error frames in either case.
  /// Fails as the system does, with the interface's name.
  static Result<std::unique_ptr<SocketCan>> open(const std::string& interface, std::span<const Filter> filters = {});
  ~SocketCan() override;
  SocketCan(const SocketCan&) = delete;
  SocketCan& operator=(const SocketCan&) = delete;

  Result<> send(const CanFrame& frame) override;
  Result<std::optional<ReceivedFrame>> receive() override;
  [[nodiscard]] int descriptor() const override { return socket_; }
  /// Frames that the kernel dropped because we did not read for too long.
  [[nodiscard]] std::uint64_t lost() const { return lost_; }

 private:
  struct Batch;
  SocketCan(int socket, std::string interface);
  int socket_;
  std::string interface_;
  std::uint64_t lost_ = 0;
  std::unique_ptr<Batch> batch_;  ///< what one system call took
};

}  // namespace regista::canopen
