// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <regista/core/time.hpp>
#include <regista/interfaces/messages.hpp>
#include <regista/xdr/framer.hpp>
#include <regista/xdr/registry.hpp>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

/// What the benchmarks over TCP share: the real server as a child process, a client that blocks, and their tables.
namespace regista::bench {

/// Owns a file descriptor.
class Descriptor {
 public:
  explicit Descriptor(int number = -1) : number_{number} {}
  Descriptor(Descriptor&& other) noexcept : number_{std::exchange(other.number_, -1)} {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~Descriptor();
  [[nodiscard]] int get() const { return number_; }

 private:
  int number_;
};

/// Listens on a free port of loopback.
Descriptor listen_anywhere(std::uint16_t& port);
Descriptor accept_from(const Descriptor& listener);
/// Connects to loopback. Receiving fails after five seconds of silence. `receive_buffer`: SO_RCVBUF, 0 is the system's.
Descriptor connect_to(std::uint16_t port, bool nodelay = true, int receive_buffer = 0);
void send_all(const Descriptor& socket, std::span<const std::byte> bytes);
void receive_all(const Descriptor& socket, std::span<std::byte> bytes);

/// A child process; killed at the end.
class Child {
 public:
  explicit Child(pid_t pid) : pid_{pid} {}
  Child(Child&& other) noexcept : pid_{std::exchange(other.pid_, 0)} {}
  Child& operator=(Child&&) = delete;
  ~Child();
  /// Of all its threads, user and system.
  [[nodiscard]] Duration cpu_time() const;
  [[nodiscard]] std::size_t resident_bytes() const;
  [[nodiscard]] pid_t pid() const { return pid_; }

 private:
  pid_t pid_;
};

struct ServerProcess {
  Child child;
  std::uint16_t port = 0;
};

/// regista-server on a free port, with the fakes of the tests, serving this configuration.
ServerProcess start_server(const std::string& config);

/// A client that waits for each answer.
class Client {
 public:
  explicit Client(std::uint16_t port, bool nodelay = true, int receive_buffer = 0);
  /// Of a peer that says no banner.
  explicit Client(Descriptor socket) : socket_{std::move(socket)} {}

  template <typename M>
  void send(player::DeviceAddress address, const M& message) {
    std::array<std::byte, 512> bytes;
    const xdr::Header header{.address = address, .kind = M::message.kind, .subtype = M::message.subtype};
    send_all(socket_, std::span{bytes}.first(xdr::encode_message(header, message, bytes)));
  }
  /// The next message of this kind and subtype; others are skipped.
  xdr::Frame receive(Kind kind, std::uint8_t subtype);
  template <typename M>
  typename M::Reply request(player::DeviceAddress address, const M& message) {
    send(address, message);
    typename M::Reply reply;
    if (!xdr::decode(receive(Kind::ack, M::message.subtype).body, reply)) throw std::runtime_error{"bad reply"};
    return reply;
  }
  void subscribe(player::DeviceAddress address);
  nlohmann::json status();

  [[nodiscard]] const Descriptor& socket() const { return socket_; }
  [[nodiscard]] xdr::Framer& framer() { return framer_; }

 private:
  Descriptor socket_;
  xdr::Framer framer_;
};

constexpr player::DeviceAddress server_address{.interface = player::code};
constexpr player::DeviceAddress position2d_address(std::uint16_t index) {
  return {.interface = position2d::code, .index = index};
}

/// Of a sorted list; `share` within [0, 1].
double quantile(const std::vector<double>& sorted, double share);

/// Options: --quick, briefly, to see that it still runs; --json FILE, the results for programs too.
struct Options {
  Options(int argc, char** argv);
  bool quick = false;
  std::string json;
};

/// What a benchmark does: each defines its own, and socket_main.cpp calls it.
void run(const Options& options);

/// Prints each row as it comes, and keeps all for the file.
class Report {
 public:
  explicit Report(Options options);
  ~Report();
  Report(const Report&) = delete;
  Report& operator=(const Report&) = delete;
  /// Rows of one table have the same columns, the first of which is "what".
  void add(const std::string& table, nlohmann::ordered_json row);

 private:
  Options options_;
  nlohmann::ordered_json tables_;
};

}  // namespace regista::bench
