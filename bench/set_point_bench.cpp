// SPDX-License-Identifier: Apache-2.0
// How evenly set-points arrive at two drives, 100 times a second over socketcand, beside a thread that sleeps to the
// same grid and writes one byte. set_point_bench [--quick]
#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <regista/canopen/pump.hpp>
#include <regista/canopen/socketcand.hpp>
#include <stdexcept>
#include <thread>

#include "drive_group.hpp"
#include "socketcand_daemon.hpp"

namespace regista::bench {
namespace {

using namespace std::chrono_literals;
using canopen::CanFrame;

constexpr Duration cycle = 10ms;

/// When set-points for the first came.
class Both final : public TwoDrives {
 public:
  using TwoDrives::TwoDrives;
  void on_frame(const CanFrame& frame, Time now) override {
    if (frame.id == 0x205) arrivals.push_back(Clock::now());
    TwoDrives::on_frame(frame, now);
  }

  std::vector<Time> arrivals;
};

void print(const char* what, const std::vector<Time>& arrivals, std::size_t from) {
  std::vector<double> late_us;
  for (std::size_t i = from + 1; i < arrivals.size(); ++i) {
    late_us.push_back(1e6 * std::abs(seconds(arrivals[i] - arrivals[i - 1] - cycle)));
  }
  if (late_us.empty()) throw std::runtime_error{"nothing arrived"};
  std::ranges::sort(late_us);
  const auto quantile = [&](double q) {
    return late_us[static_cast<std::size_t>(q * static_cast<double>(late_us.size() - 1))];
  };
  std::printf("%-28s %6zu  %8.0f %8.0f %8.0f\n", what, late_us.size(), quantile(0.5), quantile(0.99), quantile(1));
}

int listen_anywhere(std::uint16_t& port) {
  const int listener = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  if (listener < 0 || ::bind(listener, reinterpret_cast<sockaddr*>(&address), size) != 0 ||
      ::listen(listener, 1) != 0 || ::getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
    throw std::runtime_error{"cannot listen"};
  }
  port = ntohs(address.sin_port);
  return listener;
}

std::vector<Time> sleep_and_write(Duration duration) {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) != 0) throw std::runtime_error{"socketpair"};
  std::vector<Time> arrivals;
  std::jthread reader{[&] {
    char byte = 0;
    while (::read(ends[1], &byte, 1) == 1) arrivals.push_back(Clock::now());
  }};
  for (Time at = Clock::now(), end = at + duration; at < end; at += cycle) {
    std::this_thread::sleep_until(at);
    if (::write(ends[0], "x", 1) != 1) break;
  }
  ::close(ends[0]);
  reader.join();
  ::close(ends[1]);
  return arrivals;
}

std::vector<Time> drive(Duration duration) {
  std::uint16_t port = 0;
  const int listener = listen_anywhere(port);
  std::vector<Time> arrivals;
  std::jthread drives{[&] {
    Daemon bus{::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC)};
    Both both{bus};
    canopen::Pump pump{bus, both};
    while (pump.wait(1s)) {
    }
    arrivals = both.arrivals;
  }};
  {
    auto bus = canopen::SocketCand::open("127.0.0.1", port, "can0", 3s);
    if (!bus) throw std::runtime_error{bus.error().message()};
    constexpr std::array<canopen::NodeId, 2> nodes{5, 6};
    const can_motor::DriveSettings settings{.max_speed = 3000};
    can_motor::DriveGroup group{**bus,
                                nodes,
                                settings,
                                {{}, {}},
                                {.cycle = cycle},
                                {.stopped = [](const auto&) {}, .tell = [](auto, auto&) {}}};
    canopen::Pump pump{**bus, group};
    bool enabling = false;
    const Time limit = Clock::now() + 20s;
    Time end = limit;
    while (Clock::now() < end) {
      if (Result<> served = pump.wait(end - Clock::now()); !served) throw std::runtime_error{served.error().message()};
      if (!enabling && std::ranges::all_of(group.drives(), &can_motor::DriveNode::ready)) {
        enabling = true;
        group.enable([&](const Result<>& done) { end = done ? Clock::now() + duration : limit; }, Clock::now());
      }
    }
    if (!group.enabled()) throw std::runtime_error{"the drives were not enabled"};
  }
  drives.join();
  ::close(listener);
  return arrivals;
}

}  // namespace
}  // namespace regista::bench

int main(int argc, char** argv) {
  using namespace regista;
  const bool quick = argc > 1 && std::strcmp(argv[1], "--quick") == 0;
  const Duration duration = quick ? std::chrono::seconds{1} : std::chrono::seconds{30};
  try {
    std::printf("Set-points every 10 ms: how far from 10 ms [us]\n%-28s %6s  %8s %8s %8s\n", "", "n", "p50", "p99",
                "max");
    bench::print("sleep and write", bench::sleep_and_write(duration), 0);
    const std::vector<Time> arrivals = bench::drive(duration);
    bench::print("can_motor over socketcand", arrivals, std::min<std::size_t>(arrivals.size() / 4, 50));
  } catch (const std::exception& exception) {
    std::fprintf(stderr, "%s: %s\n", argv[0], exception.what());
    return EXIT_FAILURE;
  }
}
