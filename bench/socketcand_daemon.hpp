// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <regista/canopen/can_bus.hpp>
#include <regista/sim/can_drives.hpp>
#include <string>

namespace regista::bench {

using canopen::CanFrame;

/// The daemon's end of a connection, as the bus of the drives behind it.
class Daemon final : public canopen::CanBus {
 public:
  explicit Daemon(int socket) : socket_{socket} {
    const int on = 1;
    ::setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    say("< hi >");
    for (int answer = 0; answer < 2; ++answer) {  // open, rawmode
      std::array<char, 64> asked{};
      if (::recv(socket_, asked.data(), asked.size(), 0) <= 0) return;
      say("< ok >");
    }
  }
  ~Daemon() override { ::close(socket_); }
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

  Result<> send(const CanFrame& frame) override {
    std::string text = "< frame " + canopen::hex(frame.id, 3) + " 0.000000 ";
    for (const std::uint8_t byte : frame.bytes()) text += canopen::hex(byte, 2);
    say(text + " >");
    return {};
  }
  Result<std::optional<canopen::ReceivedFrame>> receive() override {
    std::array<char, 4096> more{};
    const ssize_t size = ::recv(socket_, more.data(), more.size(), MSG_DONTWAIT);
    if (size == 0) return Error{std::errc::connection_reset, "socketcand"};
    if (size > 0) in_.append(more.data(), static_cast<std::size_t>(size));
    for (std::size_t end = in_.find('>'); end != std::string::npos; end = in_.find('>')) {
      const std::string message = in_.substr(0, end);
      in_.erase(0, end + 1);
      CanFrame frame;
      unsigned id = 0;
      unsigned dlc = 0;
      int at = 0;
      if (std::sscanf(message.c_str(), " < send %x %u%n", &id, &dlc, &at) != 2) continue;
      frame.id = id;
      frame.size = static_cast<std::uint8_t>(dlc);
      const char* rest = message.c_str() + at;
      for (unsigned i = 0; i < dlc && i < 8; ++i) {
        char* next = nullptr;
        frame.data[i] = static_cast<std::uint8_t>(std::strtoul(rest, &next, 16));
        rest = next;
      }
      return std::optional{canopen::ReceivedFrame{frame, Clock::now()}};
    }
    return std::optional<canopen::ReceivedFrame>{};
  }
  [[nodiscard]] int descriptor() const override { return socket_; }

 private:
  void say(const std::string& text) { (void)::send(socket_, text.data(), text.size(), MSG_NOSIGNAL); }

  int socket_;
  std::string in_;
};

/// Two drives on a bus, nodes 5 and 6.
class TwoDrives : public canopen::Station {
 public:
  explicit TwoDrives(canopen::CanBus& bus) : left_{bus, 5, {}}, right_{bus, 6, {}} {}
  void on_frame(const CanFrame& frame, Time now) override {
    left_.on_frame(frame, now);
    right_.on_frame(frame, now);
  }
  void on_time(Time now) override {
    left_.on_time(now);
    right_.on_time(now);
  }
  [[nodiscard]] Time next_wake() const override { return std::min(left_.next_wake(), right_.next_wake()); }
  [[nodiscard]] bool started() {
    return left_.slave().state() == canopen::NmtState::operational &&
           right_.slave().state() == canopen::NmtState::operational;
  }

 private:
  sim::CanDrive left_;
  sim::CanDrive right_;
};

}  // namespace regista::bench
