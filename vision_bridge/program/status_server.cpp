// SPDX-License-Identifier: Apache-2.0
#include "status_server.hpp"

#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <regista/metrics/prometheus.hpp>
#include <system_error>

namespace regista::vision {

namespace {

constexpr std::size_t most_peers = 8;  ///< the oldest makes room
constexpr std::size_t longest_request = 4096;

}  // namespace

StatusServer::StatusServer(std::uint16_t port, Status status)
    : status_{std::move(status)}, listener_{::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)} {
  const int one = 1;
  (void)::setsockopt(listener_.get(), SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
  sockaddr_in address{
      .sin_family = AF_INET, .sin_port = htons(port), .sin_addr = {.s_addr = htonl(INADDR_LOOPBACK)}, .sin_zero = {}};
  socklen_t size = sizeof address;
  if (::bind(listener_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      ::listen(listener_.get(), 8) != 0 ||
      ::getsockname(listener_.get(), reinterpret_cast<sockaddr*>(&address), &size) != 0) {
    throw std::system_error{errno, std::generic_category(), "cannot listen on 127.0.0.1:" + std::to_string(port)};
  }
  port_ = ntohs(address.sin_port);
}

void StatusServer::add_polls(std::vector<pollfd>& polls) const {
  polls.push_back({.fd = listener_.get(), .events = POLLIN, .revents = 0});
  for (const Peer& peer : peers_)
    polls.push_back(
        {.fd = peer.socket.get(), .events = static_cast<short>(peer.answer.empty() ? POLLIN : POLLOUT), .revents = 0});
}

void StatusServer::service() {
  for (;;) {
    ssl::Descriptor socket{::accept4(listener_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC)};
    if (socket.get() < 0) break;
    if (peers_.size() == most_peers) peers_.erase(peers_.begin());
    peers_.push_back({.socket = std::move(socket), .request = {}, .answer = {}});
  }
  std::erase_if(peers_, [this](Peer& peer) { return !serve(peer); });
}

/// False: done with it.
bool StatusServer::serve(Peer& peer) const {
  if (peer.answer.empty()) {
    std::array<char, longest_request> space{};
    const ssize_t size = ::recv(peer.socket.get(), space.data(), space.size(), 0);
    if (size < 0) return errno == EAGAIN || errno == EINTR;
    peer.request.append(space.data(), static_cast<std::size_t>(size));
    if (peer.request.size() > longest_request || size == 0) return false;
    if (peer.request.find("\r\n\r\n") == std::string::npos) return true;
    peer.answer = answer(peer.request);
  }
  const ssize_t size = ::send(peer.socket.get(), peer.answer.data() + peer.sent, peer.answer.size() - peer.sent,
                              MSG_NOSIGNAL | MSG_DONTWAIT);
  if (size < 0) return errno == EAGAIN || errno == EINTR;
  peer.sent += static_cast<std::size_t>(size);
  return peer.sent < peer.answer.size();
}

/// HTTP/1.0 (RFC 1945) is enough for browsers, curl and scrapers.
std::string StatusServer::answer(const std::string& request) const {
  const bool is_metrics = request.starts_with("GET /metrics");
  const std::string json = status_();
  const std::string body = is_metrics ? prometheus_text("regista_vision", json) : json + '\n';
  return std::string{"HTTP/1.0 200 OK\r\nContent-Type: "} +
         (is_metrics ? "text/plain; version=0.0.4" : "application/json") +
         "\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body;
}

}  // namespace regista::vision
