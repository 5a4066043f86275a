// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/sim/battery.hpp>

#include "require.hpp"

namespace regista::sim {

Battery::Battery(const BatteryParameters& parameters) : parameters_{parameters} {
  require_positive("empty_v", parameters.empty_v);
  require(parameters.full_v >= parameters.empty_v, "full_v", parameters.full_v, "give at least empty_v");
  require_positive("capacity_ah", parameters.capacity_ah);
  require_not_negative("resistance_ohm", parameters.resistance_ohm);
}

void Battery::draw(double current_a, Duration dt) {
  current_a_ = current_a;
  charge_ratio_ = std::clamp(charge_ratio_ - current_a * seconds(dt) / (3600 * parameters_.capacity_ah), 0.0, 1.0);
}

double Battery::voltage_v() const {
  const double open_v = parameters_.empty_v + charge_ratio_ * (parameters_.full_v - parameters_.empty_v);
  return std::max(0.0, open_v - parameters_.resistance_ohm * current_a_);
}

}  // namespace regista::sim
