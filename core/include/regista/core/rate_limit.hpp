// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <regista/core/time.hpp>
#include <utility>

namespace regista {

/// At most `burst` at once, and then one each `interval`: the leaky bucket as ITU-T I.371 computes it (GCRA), which
/// needs no timer.
class RateLimit {
 public:
  explicit RateLimit(Duration interval, int burst = 1) : interval_{interval}, longest_{interval * burst} {}

  /// False: too many. What is not admitted fills no bucket.
  bool admit(Time now) {
    const Time emptier = std::max(empty_, now) + interval_;
    if (emptier - now > longest_) return false;
    empty_ = emptier;
    return true;
  }
  /// As if it were new.
  [[nodiscard]] bool idle(Time now) const { return empty_ <= now; }

 private:
  Duration interval_;
  Duration longest_;  ///< until the bucket is empty
  Time empty_{};
};

/// Lets the same thing be said once in a while, with the count of what was kept quiet.
class Throttle {
 public:
  explicit Throttle(Duration interval) : limit_{interval} {}

  /// How many came before and were not said; nothing: this one is not to be said either.
  std::optional<std::uint64_t> admit(Time now) {
    if (limit_.admit(now)) return std::exchange(untold_, 0);
    ++untold_;
    return std::nullopt;
  }

 private:
  RateLimit limit_;
  std::uint64_t untold_ = 0;
};

}  // namespace regista
