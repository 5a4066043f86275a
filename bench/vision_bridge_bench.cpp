// SPDX-License-Identifier: Apache-2.0
// From a camera's packet on multicast to the pose on each robot's socket, through regista-vision-bridge, beside a bare
// loop that receives and sends as much: four cameras that all see 22 robots, 75 frames a second each.
#include <netinet/in.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <regista/ssl/multicast.hpp>
#include <regista/ssl/vision.hpp>
#include <regista/xdr/codec.hpp>
#include <thread>

#include "socket_bench.hpp"

namespace regista::bench {
namespace {

using namespace std::chrono_literals;

/// The kernel's stamps are of this clock.
using Stamp = std::chrono::time_point<std::chrono::system_clock, std::chrono::nanoseconds>;

constexpr std::size_t robot_count = 22;
constexpr std::uint32_t camera_count = 4;
constexpr double rate_hz = 75;
constexpr std::size_t message_size = xdr::header_size + 36;  // a velocity command with its age

ssl::RobotId robot_id(std::size_t number) {
  return {number < 11 ? ssl::Team::yellow : ssl::Team::blue, static_cast<std::uint8_t>(number % 11)};
}

/// What came, and when the kernel had it: so that the time does not contain how long this program takes to look.
ssize_t receive_stamped(const Descriptor& socket, std::span<std::byte> space, Stamp& stamp) {
  iovec io{.iov_base = space.data(), .iov_len = space.size()};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(timespec))> control{};
  msghdr message{};
  message.msg_iov = &io;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  const ssize_t size = ::recvmsg(socket.get(), &message, MSG_DONTWAIT);
  stamp = std::chrono::system_clock::now();
  const cmsghdr* header = CMSG_FIRSTHDR(&message);
  if (size > 0 && header != nullptr && header->cmsg_type == SCM_TIMESTAMPNS) {
    timespec time{};
    std::memcpy(&time, CMSG_DATA(header), sizeof time);
    stamp = Stamp{std::chrono::seconds{time.tv_sec} + std::chrono::nanoseconds{time.tv_nsec}};
  }
  return size;
}

/// The servers of all robots, in this thread.
class Robots {
 public:
  Robots() {
    for (Robot& robot : robots_) robot.listener = listen_anywhere(robot.port);
  }

  [[nodiscard]] std::uint16_t port(std::size_t number) const { return robots_[number].port; }

  /// Take in what comes, for `patience` at most, until each robot was told once. The time of each, if it was.
  std::vector<Stamp> told(Duration patience) {
    std::vector<Stamp> times;
    const Time until = Clock::now() + patience;
    std::array<pollfd, robot_count> polls;
    for (Robot& robot : robots_) robot.is_told = false;
    while (times.size() < robot_count && Clock::now() < until) {
      for (std::size_t i = 0; i < robot_count; ++i) {
        const Robot& robot = robots_[i];
        polls[i] = {.fd = robot.is_open() ? robot.peer.get() : robot.listener.get(), .events = POLLIN, .revents = 0};
      }
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(std::max(until - Clock::now(), Duration{}));
      if (::poll(polls.data(), polls.size(), static_cast<int>(left.count())) <= 0) continue;
      for (std::size_t i = 0; i < robot_count; ++i) {
        if (polls[i].revents == 0) continue;
        if (robots_[i].is_open()) {
          take(robots_[i], times);
        } else {
          robots_[i].peer = accept_from(robots_[i].listener);
          std::array<std::byte, xdr::banner_size> banner{};
          constexpr std::string_view text = "Player v.3.1.0";
          std::ranges::transform(text, banner.begin(), [](char c) { return static_cast<std::byte>(c); });
          send_all(robots_[i].peer, banner);
          const int one = 1;
          (void)::setsockopt(robots_[i].peer.get(), SOL_SOCKET, SO_TIMESTAMPNS, &one, sizeof one);
        }
      }
    }
    return times;
  }

 private:
  struct Robot {
    Descriptor listener{};
    Descriptor peer{};
    std::uint16_t port = 0;
    xdr::Framer framer;
    bool is_told = false;
    [[nodiscard]] bool is_open() const { return peer.get() >= 0; }
  };

  static void take(Robot& robot, std::vector<Stamp>& times) {
    const std::span<std::byte> space = robot.framer.space();
    Stamp now;
    const ssize_t size = receive_stamped(robot.peer, space, now);
    if (size <= 0) {
      robot.peer = Descriptor{};
      robot.framer = xdr::Framer{};
      return;
    }
    robot.framer.commit(static_cast<std::size_t>(size));
    for (auto frame = robot.framer.next(); frame && *frame; frame = robot.framer.next()) {
      if ((*frame)->header.kind == Kind::request) {
        answer(robot, **frame);
      } else if (!robot.is_told) {
        robot.is_told = true;
        times.push_back(now);
      }
    }
  }

  /// As a stock server would.
  static void answer(const Robot& robot, const xdr::Frame& request) {
    std::array<std::byte, 256> bytes;
    xdr::Header header = request.header;
    header.kind = Kind::ack;
    player::Subscribe opened;
    const auto send = [&](const auto& body) {
      send_all(robot.peer, std::span{bytes}.first(xdr::encode_message(header, body, bytes)));
    };
    if (header.subtype == player::Subscribe::message.subtype && xdr::decode(request.body, opened)) {
      send(opened);
    } else {
      if (header.subtype == player::Extend::message.subtype) header.kind = Kind::nack;
      send(Empty{});
    }
  }

  std::array<Robot, robot_count> robots_;
};

std::uint16_t free_port() {
  std::uint16_t port = 0;
  (void)listen_anywhere(port);
  return port;
}

Child start_bridge(const Robots& robots, const ssl::Group& group) {
  std::string path = "/tmp/regista-bench-XXXXXX";
  const Descriptor file{::mkstemp(path.data())};
  std::ofstream config{path};
  config << "vision(\n interfaces [\"lo\"]\n port " << group.port << "\n delay 0\n referee no\n)\n";
  for (std::size_t i = 0; i < robot_count; ++i) {
    const ssl::RobotId id = robot_id(i);
    config << "robot( team \"" << (id.team == ssl::Team::yellow ? "yellow" : "blue") << "\" id " << int{id.number}
           << " host \"127.0.0.1\" port " << robots.port(i) << " )\n";
  }
  config.close();
  Child child{::fork()};
  if (child.pid() == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    ::execl(REGISTA_BRIDGE, REGISTA_BRIDGE, "--log-level", "off", path.c_str(), nullptr);
    std::_Exit(127);
  }
  return child;
}

/// Receives and sends as much, and does nothing else.
Child start_bare_loop(const Robots& robots, const ssl::Group& group) {
  Child child{::fork()};
  if (child.pid() != 0) return child;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  std::vector<Descriptor> sockets;
  for (std::size_t i = 0; i < robot_count; ++i) sockets.push_back(connect_to(robots.port(i)));
  ssl::MulticastReceiver receiver{group, {"lo"}};
  std::array<std::byte, message_size> message{};
  const xdr::Header header{.address = position2d_address(1), .kind = Kind::command, .subtype = 1};
  (void)xdr::encode_message(header, position2d::VelocityCommand{.age_s = 0}, message);
  for (;;) {
    pollfd readable{.fd = receiver.fileno(), .events = POLLIN, .revents = 0};
    (void)::poll(&readable, 1, -1);
    while (receiver.receive()) {
      for (const Descriptor& socket : sockets) send_all(socket, message);
    }
  }
}

struct Outcome {
  std::vector<double> latencies_us;  ///< of each pose
  std::size_t lost = 0;
  double cpu = 0;  ///< share of one processor
};

Outcome measure(Robots& robots, const Child& child, const ssl::Group& group, double duration_s) {
  ssl::MulticastSender sender{group, "lo"};
  ssl::VisionPacket packet{.detection = ssl::Detection{}, .geometry = {}};
  ssl::Detection& frame = *packet.detection;
  for (std::size_t i = 0; i < robot_count; ++i)
    frame.robots.push_back({.id = robot_id(i), .x_m = 0.5 * static_cast<double>(i) - 5, .y_m = 1, .heading_rad = 1});
  const auto period = from_seconds(1 / rate_hz / camera_count);
  Outcome outcome;
  Time begin = Clock::now();
  Duration cpu{};
  bool warm = false;
  for (std::uint64_t beat = 0;; ++beat) {
    const Time due = begin + static_cast<Duration::rep>(beat) * period;
    // What else comes in the meantime is connections, and signs of life.
    if (const Duration left = due - Clock::now(); left > 1ms) std::this_thread::sleep_for(left);
    if (!warm && Clock::now() - begin > 2s) {
      warm = true;
      cpu = child.cpu_time();
      begin = Clock::now();
      beat = 0;
    }
    if (warm && seconds(Clock::now() - begin) > duration_s) break;
    frame.camera = static_cast<std::uint32_t>(beat % camera_count);
    ++frame.frame_number;
    frame.t_capture_s = frame.t_sent_s = seconds(Clock::now().time_since_epoch());
    const std::vector<std::byte> bytes = ssl::encode(packet);
    const Stamp sent = std::chrono::system_clock::now();
    (void)sender.send(bytes);
    if (warm)
      std::this_thread::sleep_for(1ms);  // robots are other computers: to wake this one costs the sender nothing
    const std::vector<Stamp> times = robots.told(warm ? 50ms : 3ms);
    if (!warm) continue;
    outcome.lost += robot_count - times.size();
    for (const Stamp time : times) outcome.latencies_us.push_back(1e6 * seconds(time - sent));
  }
  outcome.cpu = seconds(child.cpu_time() - cpu) / seconds(Clock::now() - begin);
  std::ranges::sort(outcome.latencies_us);
  return outcome;
}

}  // namespace

void run(const Options& options) {
  Report report{options};
  const double duration_s = options.quick ? 1 : 10;
  for (const bool is_bridge : {false, true}) {
    Robots robots;
    const ssl::Group group{"224.5.23.2", free_port()};
    const Child child = is_bridge ? start_bridge(robots, group) : start_bare_loop(robots, group);
    const Outcome outcome = measure(robots, child, group, duration_s);
    report.add("packet to pose, 4 cameras, 22 robots, 75 Hz",
               {{"what", is_bridge ? "regista-vision-bridge" : "bare receive and send"},
                {"p50_us", quantile(outcome.latencies_us, 0.5)},
                {"p99_us", quantile(outcome.latencies_us, 0.99)},
                {"max_us", quantile(outcome.latencies_us, 1)},
                {"cpu_percent", 100 * outcome.cpu},
                {"poses", outcome.latencies_us.size()},
                {"lost", outcome.lost}});
    if (outcome.latencies_us.empty() || outcome.lost > outcome.latencies_us.size() / 100)
      throw std::runtime_error{std::to_string(outcome.lost) + " poses lost"};
  }
}

}  // namespace regista::bench
