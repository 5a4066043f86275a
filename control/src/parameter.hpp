// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string_view>

namespace regista::control {

/// For constructors: throws std::invalid_argument with name, value and remedy: "track_m is -0.3: give ...".
/// Write `good` so that NaN makes it false.
inline void require(bool good, std::string_view name, double value, std::string_view remedy) {
  if (good) return;
  std::ostringstream text;
  text << name << " is " << value << ": " << remedy;
  throw std::invalid_argument{text.str()};
}

inline void require_positive(std::string_view name, double value) {
  require(value > 0 && std::isfinite(value), name, value, "give a finite number above 0");
}

inline void require_not_negative(std::string_view name, double value) {
  require(value >= 0 && std::isfinite(value), name, value, "give a finite number, 0 or more");
}

/// For steps: finite, and nothing that a robot on this planet could have measured in SI units is above it.
inline bool sane(double value) { return std::abs(value) < 1e8; }

}  // namespace regista::control
