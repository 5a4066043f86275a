// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/device/driver.hpp>
#include <regista/sim/battery.hpp>

namespace regista {

/// A battery that exists only here. It drains by itself, and faster the faster the base drives that it `requires`, if
/// it does.
///
/// | Key              | Value                                                  | Default |
/// |------------------|--------------------------------------------------------|---------|
/// | `full_voltage`   | [V] open circuit, full                                 | 12.6    |
/// | `empty_voltage`  | [V] open circuit, empty                                | 9.9     |
/// | `capacity`       | [Ah]                                                   | 2.2     |
/// | `resistance`     | [Ω]                                                    | 0.05    |
/// | `charge`         | [%] at the start                                       | 100     |
/// | `idle_power`     | [W] drawn at rest                                      | 10      |
/// | `drive_power`    | [W] drawn in addition at 1 m/s, in proportion to speed | 40      |
/// | `charging_power` | [W] of the charger, on while SET_CHARGING_POLICY says so | 60    |
class SimulatedBattery final : public Driver {
 public:
  explicit SimulatedBattery(Setup& setup);

  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override {}

 private:
  Port<Power> port_;
  std::optional<Required<Position2d>> base_;
  sim::BatteryParameters parameters_;
  sim::Battery battery_;
  double idle_power_w_;
  double drive_power_w_per_mps_;
  double charging_power_w_;
  double speed_mps_ = 0;
  bool charging_ = false;
};

}  // namespace regista
