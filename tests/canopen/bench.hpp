// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <random>
#include <regista/canopen/virtual_bus.hpp>

namespace regista::canopen {

using namespace std::chrono_literals;

/// A bus in memory and the stations on it; time passes only in run().
struct Bench {
  explicit Bench(int bit_rate = 1'000'000, std::size_t queue = 10) : bus{bit_rate, queue} { bus.on_time(now); }

  void join(VirtualBus::Port& port, Station& station) { members.emplace_back(&port, &station); }

  /// Until `done`, or for `limit`. From event to event: frames, and what the stations want to be woken for.
  bool run_until(const std::function<bool()>& done, Duration limit = 10s) {
    const Time end = now + limit;
    settle();
    while (!done()) {
      Time next = bus.next_wake();
      for (const auto& [port, station] : members) next = std::min(next, station->next_wake());
      if (next > end) {
        now = end;
        settle();
        return done();
      }
      now = std::max(now, next);
      settle();
    }
    return true;
  }
  void run(Duration duration) {
    (void)run_until([] { return false; }, duration);
  }

  VirtualBus bus;
  std::vector<std::pair<VirtualBus::Port*, Station*>> members;
  Time now = Time{} + 1h;

 private:
  void settle() {
    bus.on_time(now);
    for (const auto& [port, station] : members) ASSERT_TRUE(serve(*port, *station, now));
    bus.on_time(now);
  }
};

/// Hears everything on a bus.
class Listener final : public Station {
 public:
  explicit Listener(Bench& bench) { bench.join(bench.bus.attach(), *this); }
  void on_frame(const CanFrame& frame, Time now) override { heard.emplace_back(frame, now); }
  void on_time(Time /*now*/) override {}
  [[nodiscard]] Time next_wake() const override { return Time::max(); }

  [[nodiscard]] std::vector<CanFrame> frames(std::uint32_t id) const {
    std::vector<CanFrame> found;
    for (const auto& [frame, time] : heard) {
      if (frame.id == id && !frame.error) found.push_back(frame);
    }
    return found;
  }

  std::vector<std::pair<CanFrame, Time>> heard;
};

inline Bytes random_bytes(std::size_t size, unsigned seed = 1) {
  std::mt19937 random{seed};
  Bytes bytes(size);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
  return bytes;
}

inline Bytes ascii(std::string_view text) { return {text.begin(), text.end()}; }

}  // namespace regista::canopen
