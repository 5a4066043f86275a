// SPDX-License-Identifier: Apache-2.0
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <deque>
#include <list>
#include <regista/testing/fault_proxy.hpp>
#include <stdexcept>
#include <system_error>
#include <vector>

namespace regista::testing {

namespace {

sockaddr_in loopback(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

void without_delay(int socket) {
  const int on = 1;
  ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

struct Chunk {
  Time due;
  std::vector<std::byte> bytes;  ///< none: the sender's farewell
};

/// One direction of one connection.
struct Pipe {
  int from;
  int to;
  FaultProxy::Direction* direction;
  std::deque<Chunk> waiting;
  bool ended = false;

  void read() {
    std::vector<std::byte> bytes(65536);
    const ssize_t size = ::recv(from, bytes.data(), bytes.size(), MSG_DONTWAIT);
    if (size < 0 && errno == EAGAIN) return;
    ended = size <= 0;
    bytes.resize(static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
    if (direction->swallow.load()) return;
    waiting.push_back({Clock::now() + Duration{direction->delay_ns.load()}, std::move(bytes)});
  }

  void write(Time now) {
    while (!waiting.empty() && waiting.front().due <= now) {
      std::vector<std::byte>& bytes = waiting.front().bytes;
      if (bytes.empty()) {
        ::shutdown(to, SHUT_WR);
      } else {
        const ssize_t sent = ::send(to, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent < 0 && errno == EAGAIN) return;
        if (sent >= 0 && static_cast<std::size_t>(sent) < bytes.size()) {
          bytes.erase(bytes.begin(), bytes.begin() + sent);
          return;
        }
      }
      waiting.pop_front();
    }
  }

  /// Bounded: whoever is not read from is not read either.
  [[nodiscard]] bool reads() const { return !ended && waiting.size() < 64; }
  [[nodiscard]] bool done() const { return ended && waiting.empty(); }
};

struct Connection {
  std::array<Pipe, 2> pipes;

  Connection(int client, int server, FaultProxy& proxy)
      : pipes{Pipe{client, server, &proxy.to_server, {}, false}, Pipe{server, client, &proxy.to_client, {}, false}} {}
  ~Connection() {
    ::close(pipes[0].from);
    ::close(pipes[0].to);
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void reset() {
    const linger at_once{.l_onoff = 1, .l_linger = 0};
    for (const Pipe& pipe : pipes) ::setsockopt(pipe.from, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
  }
};

}  // namespace

FaultProxy::FaultProxy(std::uint16_t server_port)
    : server_port_{server_port},
      listener_{::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)},
      wakeup_{::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)} {
  sockaddr_in address = loopback(0);
  socklen_t size = sizeof address;
  auto* generic = reinterpret_cast<sockaddr*>(&address);
  if (::bind(listener_, generic, size) != 0 || ::listen(listener_, SOMAXCONN) != 0 ||
      ::getsockname(listener_, generic, &size) != 0) {
    const std::system_error error{errno, std::generic_category(), "FaultProxy"};
    ::close(listener_);
    ::close(wakeup_);
    throw error;
  }
  port_ = ntohs(address.sin_port);
  thread_ = std::thread{[this] { run(); }};
}

FaultProxy::~FaultProxy() {
  stop_ = true;
  ::eventfd_write(wakeup_, 1);
  thread_.join();
  ::close(listener_);
  ::close(wakeup_);
}

void FaultProxy::reset() {
  reset_ = true;
  ::eventfd_write(wakeup_, 1);
}

void FaultProxy::run() {
  std::list<Connection> connections;
  std::vector<pollfd> polled;
  while (!stop_) {
    // Every millisecond while something waits for its time or for room.
    bool waits = false;
    polled.assign({{.fd = listener_, .events = POLLIN, .revents = 0}, {.fd = wakeup_, .events = POLLIN, .revents = 0}});
    for (const Connection& connection : connections) {
      for (const Pipe& pipe : connection.pipes) {
        waits = waits || !pipe.waiting.empty();
        if (pipe.reads()) polled.push_back({.fd = pipe.from, .events = POLLIN, .revents = 0});
      }
    }
    ::poll(polled.data(), polled.size(), waits ? 1 : -1);
    eventfd_t ignored = 0;
    ::eventfd_read(wakeup_, &ignored);
    if (reset_.exchange(false)) {
      for (Connection& connection : connections) connection.reset();
      connections.clear();
    }
    const Time now = Clock::now();
    for (Connection& connection : connections) {
      for (Pipe& pipe : connection.pipes) {
        if (pipe.reads()) pipe.read();
        pipe.write(now);
      }
    }
    connections.remove_if([](const Connection& c) { return c.pipes[0].done() && c.pipes[1].done(); });
    if (const int client = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC); client >= 0) {
      const int server = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
      const sockaddr_in address = loopback(server_port_);
      if (::connect(server, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
        without_delay(client);
        without_delay(server);
        connections.emplace_back(client, server, *this);
      } else {
        ::close(client);
        ::close(server);
      }
    }
  }
}

}  // namespace regista::testing
