// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <regista/core/time.hpp>

namespace regista::sim {

/// A step cut into equal parts no longer than `longest_s`, so that a plant ends exactly where its caller's clock is.
struct SubSteps {
  int count = 0;
  double length_s = 0;

  SubSteps(Duration dt, double longest_s) {
    if (dt <= Duration::zero()) return;
    count = std::max(1, static_cast<int>(std::ceil(seconds(dt) / longest_s - 1e-9)));
    length_s = seconds(dt) / count;
  }
};

}  // namespace regista::sim
