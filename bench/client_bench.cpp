// SPDX-License-Identifier: Apache-2.0
#include <benchmark/benchmark.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <regista/client/robot.hpp>
#include <thread>

namespace regista {
namespace {

constexpr std::size_t state_size = xdr::header_size + 52;

/// A server on loopback that subscribes whoever connects; then the benchmark itself sends through `descriptor`, in one
/// thread with the reader, so that each read finds its message there.
class Server {
 public:
  Server() : listener_{::socket(AF_INET, SOCK_STREAM, 0)} {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    (void)::bind(listener_, reinterpret_cast<sockaddr*>(&address), size);
    (void)::listen(listener_, 1);
    (void)::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
    port = ntohs(address.sin_port);
    thread_ = std::thread{[this] { shake_hands(); }};
  }
  ~Server() {
    if (thread_.joinable()) thread_.join();
    ::close(descriptor);
    ::close(listener_);
  }
  /// Until the client has subscribed.
  void ready() { thread_.join(); }

  std::uint16_t port = 0;
  int descriptor = -1;

 private:
  void shake_hands() {
    descriptor = ::accept(listener_, nullptr, nullptr);
    const int on = 1;
    (void)::setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    std::array<char, xdr::banner_size> banner{"Player v.3.1.1-dev"};
    (void)::send(descriptor, banner.data(), banner.size(), MSG_NOSIGNAL);
    xdr::Framer framer;
    for (;;) {
      const auto space = framer.space();
      const ssize_t size = ::recv(descriptor, space.data(), space.size(), 0);
      if (size <= 0) return;
      framer.commit(static_cast<std::size_t>(size));
      while (const auto frame = *framer.next()) {
        xdr::Header header = frame->header;
        const bool subscribe = header.subtype == player::Subscribe::message.subtype;
        header.kind = header.subtype == player::Extend::message.subtype ? Kind::nack : Kind::ack;
        std::array<std::byte, 256> out{};
        const std::size_t n = subscribe ? xdr::encode_message(header, player::Subscribe{.driver = "bench"}, out)
                                        : xdr::encode_message(header, Empty{}, out);
        (void)::send(descriptor, out.data(), n, MSG_NOSIGNAL);
        if (subscribe) return;
      }
    }
  }

  int listener_;
  std::thread thread_;
};

/// `count` states of position2d:0.
std::vector<std::byte> states(std::size_t count) {
  std::vector<std::byte> bytes(count * state_size);
  for (std::size_t i = 0; i < count; ++i) {
    (void)xdr::encode_message({.address = {.interface = position2d::code}, .kind = Kind::data, .subtype = 1},
                              position2d::State{.pose = {.x = static_cast<double>(i)}},
                              std::span{bytes}.subspan(i * state_size, state_size));
  }
  return bytes;
}

/// Sends a batch and lets `read` take it in. Both take the same send(), so what one costs more is the reader's.
template <typename Read>
void measure(benchmark::State& state, int descriptor, Read&& read) {
  const auto count = static_cast<std::size_t>(state.range(0));
  const std::vector<std::byte> bytes = states(count);
  for ([[maybe_unused]] const auto _ : state) {
    if (::send(descriptor, bytes.data(), bytes.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(bytes.size())) {
      state.SkipWithError("cannot send");
    }
    read(count);
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}

void raw_socket(benchmark::State& state) {
  Server server;
  // The same loopback TCP with the same options and handshake; then nothing but recv().
  client::Robot robot{"127.0.0.1", server.port};
  (void)robot.position2d();
  server.ready();
  std::vector<std::byte> buffer(std::size_t{1} << 16);
  measure(state, server.descriptor, [&](std::size_t count) {
    for (std::size_t left = count * state_size; left > 0;) {
      const ssize_t size = ::recv(robot.fileno(), buffer.data(), buffer.size(), 0);
      if (size > 0) left -= static_cast<std::size_t>(size);
    }
    benchmark::DoNotOptimize(buffer.data());
  });
  ::shutdown(server.descriptor, SHUT_RDWR);
}

void robot_read(benchmark::State& state) {
  Server server;
  client::Robot robot{"127.0.0.1", server.port};
  client::Position2dProxy& base = robot.position2d();
  server.ready();
  measure(state, server.descriptor, [&](std::size_t count) {
    for (const std::uint64_t until = base.count() + count; base.count() < until;)
      (void)robot.read(std::chrono::seconds{1});
    benchmark::DoNotOptimize(base.state().pose.x);
  });
  ::shutdown(server.descriptor, SHUT_RDWR);
}

// One message waits, or a hundred: a 10 kHz device read at 100 Hz.
BENCHMARK(raw_socket)->Name("read_1/raw_socket")->Arg(1);
BENCHMARK(robot_read)->Name("read_1/robot")->Arg(1);
BENCHMARK(raw_socket)->Name("read_100/raw_socket")->Arg(100);
BENCHMARK(robot_read)->Name("read_100/robot")->Arg(100);

}  // namespace
}  // namespace regista
