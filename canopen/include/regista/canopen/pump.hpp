// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/canopen/can_bus.hpp>

namespace regista::canopen {

/// Joins a bus and what a station waits for in one file descriptor, for a driver's thread or any event loop: when it is
/// readable, run().
class Pump {
 public:
  /// Both outlive the pump. Throws std::system_error.
  Pump(CanBus& bus, Station& station);
  ~Pump();
  Pump(const Pump&) = delete;
  Pump& operator=(const Pump&) = delete;

  [[nodiscard]] int descriptor() const { return epoll_; }
  /// Takes some of the frames that wait, does what is due. Also after calls that start something outside of run().
  Result<> run(Time now);
  /// Blocks until something is to be done, at most so long, then does it.
  Result<> wait(Duration longest);

 private:
  CanBus& bus_;
  Station& station_;
  int timer_ = -1;
  Time armed_ = Time::min();  ///< when the timer fires; it may be due before what is
  int epoll_ = -1;
};

}  // namespace regista::canopen
