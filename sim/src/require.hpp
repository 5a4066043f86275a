// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <string_view>

namespace regista::sim {

/// Refuse a parameter that makes no sense: throws std::invalid_argument "FIELD is VALUE: REMEDY" unless `ok`.
/// NaN and infinity are never ok.
void require(bool ok, std::string_view field, double value, std::string_view remedy);

inline void require_positive(std::string_view field, double value) {
  require(value > 0, field, value, "give a number above 0");
}
inline void require_not_negative(std::string_view field, double value) {
  require(value >= 0, field, value, "give 0 or more");
}
inline void require_probability(std::string_view field, double value) {
  require(value >= 0 && value <= 1, field, value, "give a probability, 0 to 1");
}

}  // namespace regista::sim
