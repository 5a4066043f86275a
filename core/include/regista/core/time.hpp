// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace regista {

/// Monotonic: a step of the wall clock changes no lease, no timeout and no filter.
using Clock = std::chrono::steady_clock;
using Time = Clock::time_point;
using Duration = Clock::duration;

/// One beat of a driver or a filter: the only clock that it sees.
struct Tick {
  Time now;
  Duration dt{};  ///< since the beat before; never negative
};

/// [s]
constexpr double seconds(Duration duration) { return std::chrono::duration<double>(duration).count(); }

/// From seconds, rounded to the nanosecond. `value` must be finite and within ±292 years.
constexpr Duration from_seconds(double value) {
  return std::chrono::round<Duration>(std::chrono::duration<double>(value));
}

}  // namespace regista
