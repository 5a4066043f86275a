// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <regista/sim/gps.hpp>

#include "require.hpp"

namespace regista::sim {

Gps::Gps(const GpsParameters& p) : parameters_{p}, random_{p.seed} {
  require_positive("period_s", p.period_s);
  require_not_negative("noise_m", p.noise_m);
  require_not_negative("drift_m", p.drift_m);
  require_positive("drift_s", p.drift_s);
  require_not_negative("jump_every_s", p.jump_every_s);
  require_not_negative("jump_m", p.jump_m);
  require_not_negative("loss_every_s", p.loss_every_s);
  require_positive("loss_s", p.loss_s);
  drift_x_m_ = random_.normal(p.drift_m);
  drift_y_m_ = random_.normal(p.drift_m);
}

std::optional<Gps::Fix> Gps::step(const Pose2d& truth, Duration dt) {
  until_fix_s_ -= seconds(dt);
  if (until_fix_s_ > 1e-9) return std::nullopt;
  const double period_s = parameters_.period_s;
  until_fix_s_ += period_s;

  const double kept = std::exp(-period_s / parameters_.drift_s);
  const double sd = parameters_.drift_m * std::sqrt(1 - kept * kept);
  drift_x_m_ = kept * drift_x_m_ + random_.normal(sd);
  drift_y_m_ = kept * drift_y_m_ + random_.normal(sd);
  if (parameters_.jump_every_s > 0 && random_.chance(-std::expm1(-period_s / parameters_.jump_every_s))) {
    drift_x_m_ += random_.normal(parameters_.jump_m);
    drift_y_m_ += random_.normal(parameters_.jump_m);
  }
  if (lost_for_s_ > 0) {
    lost_for_s_ -= period_s;
  } else if (parameters_.loss_every_s > 0 && random_.chance(-std::expm1(-period_s / parameters_.loss_every_s))) {
    lost_for_s_ = -parameters_.loss_s * std::log1p(-random_.uniform(0, 1));
  }
  if (lost_for_s_ > 0) return std::nullopt;
  return Fix{.x_m = truth.x + drift_x_m_ + random_.normal(parameters_.noise_m),
             .y_m = truth.y + drift_y_m_ + random_.normal(parameters_.noise_m)};
}

Magnetometer::Magnetometer(const MagnetometerParameters& p) : parameters_{p}, random_{p.seed} {
  require_not_negative("noise_rad", p.noise_rad);
  require(true, "hard_iron_rad", p.hard_iron_rad, "give a number");
  require(true, "hard_iron_at_rad", p.hard_iron_at_rad, "give a number");
  require(true, "soft_iron_rad", p.soft_iron_rad, "give a number");
  require(true, "soft_iron_at_rad", p.soft_iron_at_rad, "give a number");
}

double Magnetometer::error_rad(double heading_rad) const {
  return parameters_.hard_iron_rad * std::sin(heading_rad - parameters_.hard_iron_at_rad) +
         parameters_.soft_iron_rad * std::sin(2 * (heading_rad - parameters_.soft_iron_at_rad));
}

double Magnetometer::read(double heading_rad) {
  return wrap_angle(heading_rad + error_rad(heading_rad) + random_.normal(parameters_.noise_rad));
}

}  // namespace regista::sim
