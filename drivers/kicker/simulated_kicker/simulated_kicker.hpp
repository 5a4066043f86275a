// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/device/driver.hpp>

namespace regista {

/// A kicker that exists only here: a capacitor that takes its time to charge, a kick that empties it, a dribbler.
///
/// A kick costs energy in proportion to the square of the ball's speed, all of it at the largest speed; only a full
/// capacitor kicks. Opened, it is empty and not being charged. The property `ball` puts a ball before the plate; a kick
/// or chip takes it away.
///
/// | Key               | Value                              | Default |
/// |-------------------|------------------------------------|---------|
/// | `charge_time`     | [s] from empty to full             | 2       |
/// | `voltage`         | [V] of the full capacitor          | 200     |
/// | `kick_speed`      | [length/s] largest                 | 6.5 m/s |
/// | `chip_speed`      | [length/s] largest                 | 4 m/s   |
/// | `chip_angle_min`  | above the floor                    | 30°     |
/// | `chip_angle_max`  | above the floor                    | 60°     |
/// | `dribbler_speed`  | [angle/s] largest                  | 300 rad/s |
/// | `dribbler_time_constant` | [s] of its answer           | 0.1     |
/// | `offset`          | [length] of the plate ahead of the robot's middle | 0.08 m |
/// | `width`           | [length] of the plate              | 0.08 m  |
class SimulatedKicker final : public Driver {
 public:
  explicit SimulatedKicker(Setup& setup);

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override;

 private:
  /// Spend the energy for a ball of this speed, or say why not. `what`: "kick" or "chip".
  Result<> shoot(const char* what, double speed_mps, double largest_mps);
  [[nodiscard]] double capacitor_v() const;

  Port<Kicker> port_;
  Property<bool> ball_;
  Duration charge_time_;
  double full_v_;
  kicker::Limits limits_;
  double dribbler_time_constant_s_;
  kicker::Geometry geometry_;

  bool charging_ = false;
  double energy_ = 0;  ///< in the capacitor, 0 to 1
  double dribbler_target_radps_ = 0;
  double dribbler_radps_ = 0;
  std::uint32_t kick_count_ = 0;
};

}  // namespace regista
