// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "report.hpp"

namespace regista::reproduce {

struct Settings {
  std::uint64_t seed = 1;
  std::size_t runs = 30;
};

/// H: eight directions, the square, the gap, outliers, rest.
std::vector<Experiment> soccer_experiments(const Settings& settings);
/// O: figures 3 to 6.
std::vector<Experiment> posture_experiments(const Settings& settings);
/// L: two lists of waypoints.
std::vector<Experiment> waypoint_experiments(const Settings& settings);

}  // namespace regista::reproduce
