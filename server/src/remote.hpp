// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <regista/client/connection.hpp>
#include <regista/device/driver.hpp>
#include <span>

namespace regista {

/// The devices of another server that one driver of this server requires: a driver itself, made by the server. Each of
/// its ports stands for one device over there; what comes down is sent on, what comes from there goes up. Every
/// requiring driver has a connection of its own, because over there it drives under its own name and priority.
///
/// When the connection breaks, the other server stops its devices by its own rules. Here they are not connected, and
/// commands for them are refused, until the host's back-off has opened the connection again.
class Remote final : public Driver {
 public:
  /// `name` and `priority`: the requiring driver's, told to servers that speak the extension.
  Remote(Setup& setup, const std::string& host, std::uint16_t port, std::span<const client::Address> devices,
         const std::string& name, std::int32_t priority);

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override {}  // data go up when they come
  void halt() noexcept override;
  void close() noexcept override;
  [[nodiscard]] std::span<const int> descriptors() const override { return {&descriptor_, 1}; }

 private:
  struct Device {
    PortCore* port;
    client::Address address;
    bool commanded = false;  ///< since it was last halted
  };
  struct Question {
    PortCore* port;
    client::Address to;
    AnyRequest request;
    ReplyTo reply_to{};
  };

  void add(Setup& setup, client::Address address);
  Result<> send(Device& device, const AnyCommand& command);
  void ask(Question question);
  void ask_next();

  client::Connection connection_;
  std::string name_;  ///< of the other server
  std::deque<Device> devices_;
  std::deque<Question> questions_;  ///< wait for the one that is under way
  Time kept_alive_{};
  int descriptor_ = -1;
};

}  // namespace regista
