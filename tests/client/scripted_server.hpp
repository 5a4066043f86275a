// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <bit>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <vector>

/// A server on a real socket that does what a test's script says. It has a codec of its own, from the tables of the
/// protocol and not from ours, so that a wrong byte of ours is seen.
namespace regista::test {

using namespace std::chrono_literals;

/// Bytes as they travel.
class Bytes : public std::string {
 public:
  using std::string::string;
  Bytes() = default;
  explicit Bytes(std::string bytes) : std::string{std::move(bytes)} {}

  Bytes& u32(std::uint32_t value) {
    for (int shift = 24; shift >= 0; shift -= 8) push_back(static_cast<char>(value >> shift & 0xff));
    return *this;
  }
  Bytes& f64(double value) {
    const auto bits = std::bit_cast<std::uint64_t>(value);
    return u32(static_cast<std::uint32_t>(bits >> 32)).u32(static_cast<std::uint32_t>(bits));
  }
  Bytes& f32(float value) { return u32(std::bit_cast<std::uint32_t>(value)); }
  /// A string with its NUL.
  Bytes& text(const std::string& text) {
    u32(static_cast<std::uint32_t>(text.size() + 1)).u32(static_cast<std::uint32_t>(text.size() + 1));
    append(text).push_back('\0');
    append((4 - (text.size() + 1) % 4) % 4, '\0');
    return *this;
  }
  Bytes& address(std::uint32_t interface, std::uint32_t index) { return u32(0).u32(0).u32(interface).u32(index); }

  [[nodiscard]] std::uint32_t u32_at(std::size_t at) const {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<unsigned char>(std::string::at(at + i));
    return value;
  }
  [[nodiscard]] double f64_at(std::size_t at) const {
    return std::bit_cast<double>(std::uint64_t{u32_at(at)} << 32 | u32_at(at + 4));
  }
};

inline Bytes from_hex(const std::string& hex) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
    bytes.push_back(static_cast<char>(std::stoi(hex.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

constexpr std::uint32_t data_type = 1, command_type = 2, request_type = 3, ack_type = 4, synch_type = 5, nack_type = 6;

struct Message {
  Bytes header;
  Bytes body;

  [[nodiscard]] std::uint32_t host() const { return header.u32_at(0); }
  [[nodiscard]] std::uint32_t robot() const { return header.u32_at(4); }
  [[nodiscard]] std::uint32_t interface() const { return header.u32_at(8); }
  [[nodiscard]] std::uint32_t index() const { return header.u32_at(12); }
  [[nodiscard]] std::uint32_t type() const { return header.u32_at(16); }
  [[nodiscard]] std::uint32_t subtype() const { return header.u32_at(20); }
  [[nodiscard]] std::uint32_t sequence() const { return header.u32_at(32); }
  [[nodiscard]] bool is(std::uint32_t i, std::uint32_t t, std::uint32_t s) const {
    return interface() == i && type() == t && subtype() == s;
  }
};

inline Bytes message(std::uint32_t interface, std::uint32_t index, std::uint32_t type, std::uint32_t subtype,
                     const std::string& body = "", double stamp = 0, std::uint32_t sequence = 0) {
  Bytes bytes;
  bytes.u32(0x0100007f).u32(6665).u32(interface).u32(index).u32(type).u32(subtype).f64(stamp).u32(sequence);
  bytes.u32(static_cast<std::uint32_t>(body.size())).append(body);
  return bytes;
}

inline const Bytes banner = [] {
  Bytes bytes{"Player v.3.1.1-dev"};
  bytes.resize(32);
  return bytes;
}();

/// position2d STATE
inline Bytes state(double x, double y = 0, double heading = 0) {
  return Bytes{}.f64(x).f64(y).f64(heading).f64(0).f64(0).f64(0).u32(0);
}

/// The server's end of one connection.
class Peer {
 public:
  explicit Peer(int descriptor) : descriptor_{descriptor} {
    const int on = 1;
    ::setsockopt(descriptor_, IPPROTO_TCP, 1 /* TCP_NODELAY */, &on, sizeof on);
  }
  ~Peer() { close(); }
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;

  /// False when the client takes no bytes for a second, or is gone.
  bool send(const std::string& bytes) {
    std::size_t sent = 0;
    while (sent < bytes.size()) {
      pollfd poll{.fd = descriptor_, .events = POLLOUT, .revents = 0};
      if (::poll(&poll, 1, 1000) != 1) return false;
      const ssize_t n = ::send(descriptor_, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL | MSG_DONTWAIT);
      if (n <= 0) return false;
      sent += static_cast<std::size_t>(n);
    }
    return true;
  }

  /// Empty when the client is gone, or silent for two seconds.
  std::optional<Message> next() {
    Message message;
    if (!fill(message.header, 40) || !fill(message.body, message.header.u32_at(36))) return std::nullopt;
    return message;
  }

  void reply(const Message& request, std::uint32_t type, const std::string& body = "") {
    // As the stock server: `player` echoes the sequence, drivers answer 0.
    const std::uint32_t sequence = request.interface() == 1 ? request.sequence() : 0;
    send(test::message(request.interface(), request.index(), type, request.subtype(), body, 0, sequence));
  }
  void ack(const Message& request, const std::string& body = "") { reply(request, ack_type, body); }
  void nack(const Message& request, const std::string& body = "") { reply(request, nack_type, body); }

  /// Close with a reset instead of an end.
  void reset() {
    const linger hard{.l_onoff = 1, .l_linger = 0};
    ::setsockopt(descriptor_, SOL_SOCKET, SO_LINGER, &hard, sizeof hard);
    close();
  }
  void close() {
    if (descriptor_ >= 0) ::close(descriptor_);
    descriptor_ = -1;
  }
  /// Until the client has gone, at most two seconds.
  void wait_for_end() {
    while (next()) {
    }
  }

 private:
  bool fill(Bytes& bytes, std::size_t size) {
    bytes.resize(size);
    std::size_t got = 0;
    while (got < size) {
      if (descriptor_ < 0) return false;
      pollfd poll{.fd = descriptor_, .events = POLLIN, .revents = 0};
      if (::poll(&poll, 1, 2000) != 1) return false;
      const ssize_t n = ::recv(descriptor_, bytes.data() + got, size - got, MSG_DONTWAIT);
      if (n <= 0) return false;
      got += static_cast<std::size_t>(n);
    }
    return true;
  }

  int descriptor_;
};

/// Listens on a port of loopback; each connection runs the script once, one after the other.
class ScriptedServer {
 public:
  using Script = std::function<void(Peer&)>;

  explicit ScriptedServer(Script script, std::uint16_t port = 0) : script_{std::move(script)} {
    listener_ = ::socket(AF_INET, SOCK_STREAM, 0);
    const int on = 1;
    ::setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    if (::bind(listener_, reinterpret_cast<sockaddr*>(&address), size) != 0 || ::listen(listener_, 8) != 0) {
      ADD_FAILURE() << "cannot listen: " << std::strerror(errno);
    }
    ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
    if (script_) thread_ = std::thread{[this] { run(); }};
  }
  ~ScriptedServer() {
    ::shutdown(listener_, SHUT_RDWR);
    if (thread_.joinable()) thread_.join();
    ::close(listener_);
  }
  ScriptedServer(const ScriptedServer&) = delete;
  ScriptedServer& operator=(const ScriptedServer&) = delete;

  [[nodiscard]] std::uint16_t port() const { return port_; }

 private:
  void run() {
    for (;;) {
      const int descriptor = ::accept(listener_, nullptr, nullptr);
      if (descriptor < 0) return;
      Peer peer{descriptor};
      script_(peer);
    }
  }

  Script script_;
  int listener_ = -1;
  std::uint16_t port_ = 0;
  std::thread thread_;
};

/// What a server answers by itself: a stock Player, or one that speaks the extension.
/// `own(peer, message)` comes first; true: it has answered.
inline void serve(Peer& peer, bool extended, const std::function<bool(Peer&, const Message&)>& own = {}) {
  peer.send(banner);
  while (const std::optional<Message> message = peer.next()) {
    if (own && own(peer, *message)) continue;
    if (message->type() != request_type) continue;
    if (message->interface() != 1) {
      peer.nack(*message);
    } else if (message->subtype() == 3) {
      Bytes body{message->body.substr(0, 20)};
      peer.ack(*message, body.text("fakedriver"));
    } else if (message->subtype() == 1) {
      peer.ack(*message, Bytes{}.u32(0).u32(0));
    } else if (message->subtype() == 5 || message->subtype() == 4) {
      peer.ack(*message);
    } else if (message->subtype() == 100 && extended) {
      peer.ack(*message, Bytes{}.u32(1).text("regista 0.1.0"));
    } else if (message->subtype() > 100 && extended) {
      peer.ack(*message);
    } else {
      peer.nack(*message);
    }
  }
}

}  // namespace regista::test
