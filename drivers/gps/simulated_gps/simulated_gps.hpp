// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/device/driver.hpp>
#include <regista/sim/gps.hpp>

#include "local_frame.hpp"

namespace regista {

/// A receiver that exists only here, on the base that it `requires`: a position2d whose pose is the truth, such as
/// simulated_base's "truth:::position2d:1".
///
/// `gps:0` has what a receiver says, `localize:0` the same fix in the field: x east and y north of the datum, with
/// covariance. A lost fix is told by `gps:0` with quality 0, once a period; `localize:0` is silent then.
///
/// | Key           | Value                                                                | Default         |
/// |---------------|----------------------------------------------------------------------|-----------------|
/// | `datum`       | [latitude longitude altitude], degrees and [m]: the field's origin   | 63.4 10.4 40    |
/// | `period`      | [s] between fixes, as far as the rate allows                         | 0.2             |
/// | `noise`       | [length] sd of a fix along each axis, new every time                 | 0.1 m           |
/// | `drift`       | [length] sd along each axis of an error that wanders                 | 1 m             |
/// | `drift_time`  | [s] correlation time of it                                           | 120             |
/// | `jump_every`  | [s] mean time between jumps of the solution; 0: never                | 0               |
/// | `jump`        | [length] sd of a jump along each axis; it decays as the drift does   | 3 m             |
/// | `loss_every`  | [s] mean time between losses of the fix; 0: never                    | 0               |
/// | `loss`        | [s] mean length of a loss                                            | 5               |
/// | `seed`        | whole number                                                         | 1               |
class SimulatedGps final : public Driver {
 public:
  explicit SimulatedGps(Setup& setup);

  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override {}

 private:
  Port<Gps> receiver_;
  Port<Localize> local_;
  Required<Position2d> truth_;
  sim::GpsParameters parameters_;
  sim::Gps gps_;
  LocalFrame frame_;
  std::optional<position2d::State> base_;
  std::optional<sim::Gps::Fix> seen_;  ///< in this beat
  Duration without_{};                 ///< since the last fix, or since its loss was told
  double time_s_;
};

}  // namespace regista
