// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/canopen/can_frame.hpp>

namespace regista::canopen {

/// Produces SYNC on a grid without drift: a beat that was missed is left out, not made up for (CiA 301, 7.2.5).
class SyncProducer {
 public:
  struct Options {
    Duration period{};                  ///< object 1006; 0: no SYNC
    std::uint8_t counter_overflow = 0;  ///< object 1019: 2 to 240, or 0 for a SYNC without counter
    Duration window{};                  ///< object 1007: for so long after a SYNC synchronous PDOs may go; 0: always
  };
  /// Throws std::invalid_argument on an overflow value of 1 or above 240.
  explicit SyncProducer(const Options& options);

  /// The SYNC, when it is due.
  std::optional<CanFrame> on_time(Time now);
  [[nodiscard]] Time next_wake() const { return options_.period > Duration::zero() ? next_ : Time::max(); }
  [[nodiscard]] bool in_window(Time now) const {
    return options_.window == Duration::zero() || now - last_ <= options_.window;
  }
  [[nodiscard]] std::uint64_t missed() const { return missed_; }  ///< beats that were left out
  [[nodiscard]] const Options& options() const { return options_; }

 private:
  Options options_;
  Time next_ = Time::min();  ///< at once
  Time last_;
  std::uint8_t counter_ = 0;
  std::uint64_t missed_ = 0;
};

/// TIME: milliseconds after midnight and days since 1 January 1984 (CiA 301, 7.1.6.6), here as the wall clock's time.
CanFrame time_frame(std::chrono::sys_time<std::chrono::milliseconds> time);
/// Empty if the frame is no TIME.
std::optional<std::chrono::sys_time<std::chrono::milliseconds>> decode_time(const CanFrame& frame);

}  // namespace regista::canopen
