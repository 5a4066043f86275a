// SPDX-License-Identifier: Apache-2.0
#include "listener.hpp"

#include <asio/ip/v6_only.hpp>

#include <filesystem>
#include <fstream>
#include <regista/server/server.hpp>
#include <sstream>

namespace regista {

namespace {

using namespace std::chrono_literals;

std::string endpoint_text(const std::string& address, std::uint16_t port) {
  const bool v6 = address.find(':') != std::string::npos;
  return (v6 ? '[' + address + ']' : address) + ':' + std::to_string(port);
}

/// Who listens on a TCP port, from /proc (proc(5)): "pid 1234"; empty when that cannot be known.
std::string holder_of(std::uint16_t port) {
  std::string inode;
  for (const char* table : {"/proc/net/tcp", "/proc/net/tcp6"}) {
    std::ifstream file{table};
    std::string line;
    std::getline(file, line);
    while (std::getline(file, line)) {
      std::istringstream words{line};
      std::string slot, local, remote, state, queues, timer, retransmits, user, timeout, found;
      words >> slot >> local >> remote >> state >> queues >> timer >> retransmits >> user >> timeout >> found;
      const auto colon = local.rfind(':');
      if (state == "0A" && colon != std::string::npos && std::stoul(local.substr(colon + 1), nullptr, 16) == port) {
        inode = "socket:[" + found + "]";
      }
    }
  }
  std::error_code ignored;
  for (const auto& process : std::filesystem::directory_iterator{"/proc", ignored}) {
    const std::string pid = process.path().filename();
    if (inode.empty() || pid.find_first_not_of("0123456789") != std::string::npos) continue;
    for (const auto& descriptor : std::filesystem::directory_iterator{process.path() / "fd", ignored}) {
      if (std::filesystem::read_symlink(descriptor.path(), ignored) == inode) return "pid " + pid;
    }
  }
  return {};
}

}  // namespace

Listener::Listener(asio::io_context& io, const std::string& address, std::uint16_t port, OnSocket on_socket)
    : acceptor_{io}, pause_{io}, on_socket_{std::move(on_socket)}, address_{address} {
  asio::error_code error;
  const auto fail = [&](const asio::error_code& why) {
    std::string text = "cannot listen on " + endpoint_text(address, port) + ": " + why.message();
    if (why == asio::error::address_in_use) {
      const std::string holder = holder_of(port);
      text += " (is another server running?" + (holder.empty() ? "" : ' ' + holder) + ')';
    }
    return ListenError{text};
  };
  const auto ip = asio::ip::make_address(address, error);
  if (error) throw ListenError{"cannot listen on \"" + address + "\": not an IP address, such as 127.0.0.1 or ::1"};
  const asio::ip::tcp::endpoint endpoint{ip, port};
  acceptor_.open(endpoint.protocol(), error);
  if (error) throw fail(error);
  acceptor_.set_option(asio::socket_base::reuse_address{true});
  if (ip.is_v6()) acceptor_.set_option(asio::ip::v6_only{true});
  acceptor_.bind(endpoint, error);
  if (error) throw fail(error);
  acceptor_.listen(asio::socket_base::max_listen_connections, error);
  if (error) throw fail(error);
  port_ = acceptor_.local_endpoint().port();
}

std::string Listener::endpoint() const { return endpoint_text(address_, port_); }

void Listener::start() { accept(); }

void Listener::stop() {
  asio::error_code ignored;
  pause_.cancel();
  acceptor_.close(ignored);
}

void Listener::accept() {
  acceptor_.async_accept([this](const asio::error_code& error, asio::ip::tcp::socket socket) {
    if (error == asio::error::operation_aborted) return;
    if (!error) {
      on_socket_(std::move(socket));
      return accept();
    }
    // Out of descriptors or memory: trying again at once would only burn the processor.
    pause_.expires_after(100ms);
    pause_.async_wait([this](const asio::error_code& cancelled) {
      if (!cancelled) accept();
    });
  });
}

}  // namespace regista
