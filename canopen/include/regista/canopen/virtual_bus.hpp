// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <regista/canopen/can_bus.hpp>

namespace regista::canopen {

/// A bus in memory that takes the time of a real one: a frame lasts as long as its bits, stuff bits included, and among
/// those that wait the lowest id goes first. Its time is handed in, as that of the stations on it.
class VirtualBus {
 public:
  /// `bit_rate` in bit/s; `queue` frames wait in a port before it refuses, as in Linux's txqueuelen.
  explicit VirtualBus(int bit_rate = 1'000'000, std::size_t queue = 10) : bit_rate_{bit_rate}, queue_{queue} {}

  class Port final : public CanBus {
   public:
    Port(VirtualBus& bus) : bus_{bus} {}  // NOLINT(google-explicit-constructor): made by attach()
    Result<> send(const CanFrame& frame) override;
    Result<std::optional<ReceivedFrame>> receive() override;
    [[nodiscard]] int descriptor() const override { return -1; }

    /// Pull the plug, or put it back. Frames that wait stay: without another node nobody acknowledges them.
    void connect(bool connected) { connected_ = connected; }
    /// The controller leaves the bus after too many errors: what waits is lost, its station is told.
    void bus_off();
    /// And takes part again.
    void restart();

   private:
    friend class VirtualBus;
    struct Waiting {
      CanFrame frame;
      Time since;
    };
    VirtualBus& bus_;
    std::deque<Waiting> transmit_;
    std::deque<ReceivedFrame> received_;
    bool connected_ = true;
    bool off_ = false;
  };

  /// One more controller on the bus. Lives as long as the bus.
  Port& attach();

  /// Brings the bus to `now`: frames that are through by then have arrived at all other ports.
  void on_time(Time now);
  /// When the frame that is under way is through; Time::max() on an idle bus.
  [[nodiscard]] Time next_wake() const;

  /// Decides of each frame whether it gets lost, unseen by its sender.
  std::function<bool(const CanFrame&)> lose = [](const CanFrame&) { return false; };

  [[nodiscard]] std::uint64_t bits() const { return bits_; }      ///< of all frames so far
  [[nodiscard]] std::uint64_t frames() const { return frames_; }  ///< that were transmitted
  [[nodiscard]] Time now() const { return now_; }

 private:
  struct OnTheWire {
    Port* from;
    CanFrame frame;
    Time end;
  };
  void arbitrate();
  void deliver(const OnTheWire& done);

  int bit_rate_;
  std::size_t queue_;
  std::vector<std::unique_ptr<Port>> ports_;
  std::optional<OnTheWire> on_the_wire_;
  Time now_;
  Time free_at_;
  std::uint64_t bits_ = 0;
  std::uint64_t frames_ = 0;
};

}  // namespace regista::canopen
