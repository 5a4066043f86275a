// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <asio/io_context.hpp>
#include <asio/ip/tcp.hpp>
#include <asio/steady_timer.hpp>
#include <functional>
#include <string>

namespace regista {

/// Accepts connections on one address and port. When the process has no descriptor left it pauses instead of spinning;
/// those who knock meanwhile wait in the kernel.
class Listener {
 public:
  using OnSocket = std::function<void(asio::ip::tcp::socket)>;

  /// Throws ListenError: "cannot listen on 127.0.0.1:6665: Address already in use (is another server running? pid 7)".
  Listener(asio::io_context& io, const std::string& address, std::uint16_t port, OnSocket on_socket);

  void start();
  void stop();
  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] std::string endpoint() const;

 private:
  void accept();

  asio::ip::tcp::acceptor acceptor_;
  asio::steady_timer pause_;
  OnSocket on_socket_;
  std::string address_;
  std::uint16_t port_ = 0;
};

}  // namespace regista
