// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/core/time.hpp>

#include "local_frame.hpp"

namespace regista {

struct DatumRules {
  std::uint32_t satellites = 6;  ///< used, at least
  Duration rest = std::chrono::seconds{10};
  double within_m = 3;     ///< of the mean of the fixes before
  double speed_mps = 0.5;  ///< at most
};

/// Where a map begins when nobody says so: the mean of the fixes while the robot stood still. One bad fix, a step or
/// too few satellites begin it anew, so that no first, wild fix becomes the origin of everything.
class DatumFinder {
 public:
  explicit DatumFinder(const DatumRules& rules) : rules_{rules} {}

  /// The datum, once the rules are fulfilled.
  std::optional<Geodetic> step(const Fix& fix, Time now);

 private:
  DatumRules rules_;
  std::optional<LocalFrame> around_;  ///< the first fix
  Time since_;
  Point3d sum_;
  int count_ = 0;
};

}  // namespace regista
