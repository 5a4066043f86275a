// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/core/time.hpp>

namespace regista::sim {

struct BatteryParameters {
  double full_v = 12.6;  ///< open circuit; the defaults are three lithium-polymer cells
  double empty_v = 9.9;  ///< open circuit
  double capacity_ah = 2.2;
  double resistance_ohm = 0.05;
};

/// A source with inner resistance, whose open-circuit voltage falls in a line with its charge.
class Battery {
 public:
  /// Full. Throws std::invalid_argument on a parameter that is not above 0, or empty_v above full_v.
  explicit Battery(const BatteryParameters& parameters);

  /// Take `current_a` (charging: negative) for `dt`.
  void draw(double current_a, Duration dt);

  [[nodiscard]] double charge_ratio() const { return charge_ratio_; }  ///< 0 to 1
  [[nodiscard]] double current_a() const { return current_a_; }
  [[nodiscard]] double voltage_v() const;  ///< at the terminals, under the load drawn last

 private:
  BatteryParameters parameters_;
  double charge_ratio_ = 1;
  double current_a_ = 0;
};

}  // namespace regista::sim
