// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/control/posture_regulator.hpp>

#include "parameter.hpp"

namespace regista::control {

PostureRegulator::PostureRegulator(const PostureRegulatorConfig& config) : config_{config} {
  require_positive("k1", config.k1);
  require_positive("k2", config.k2);
  require_positive("k3", config.k3);
  require_positive("speed_limit_mps", config.speed_limit_mps);
  require_positive("turn_rate_limit_radps", config.turn_rate_limit_radps);
  require_positive("tolerance_m", config.tolerance_m);
  require_positive("tolerance_rad", config.tolerance_rad);
}

PostureRegulator::Output PostureRegulator::step(const Pose2d& pose, const Pose2d& goal) {
  for (const double value : {pose.x, pose.y, pose.heading, goal.x, goal.y, goal.heading}) {
    if (sane(value)) continue;
    ++refused_;
    return {.command = {}, .refused = true};
  }
  const auto& [k1, k2, k3, speed_limit, turn_rate_limit, tolerance_m, tolerance_rad] = config_;
  const double rho = distance(pose, goal);
  const double line_of_sight = rho > 0 ? std::atan2(goal.y - pose.y, goal.x - pose.x) : goal.heading;
  const double gamma = angle_between(pose.heading, line_of_sight);
  const double delta = angle_between(goal.heading, line_of_sight);
  const double turn = angle_between(pose.heading, goal.heading);

  on_the_spot_ = rho <= (on_the_spot_ ? 2 : 1) * tolerance_m;
  double v = 0;
  double w = 0;
  if (on_the_spot_) {
    w = k2 * turn;
  } else {
    const double sinc = std::abs(gamma) < 1e-6 ? 1 : std::sin(gamma) / gamma;  // exact to 1e-13 below
    v = k1 * rho * std::cos(gamma);
    w = k2 * gamma + k1 * sinc * std::cos(gamma) * (gamma + k3 * delta);
  }
  const bool arrived = rho <= tolerance_m && std::abs(turn) <= tolerance_rad;
  const double scale = std::max({1.0, std::abs(v) / speed_limit, std::abs(w) / turn_rate_limit});
  return {.command = arrived ? BodyVelocity{} : BodyVelocity{.x = v / scale, .w = w / scale},
          .rho_m = rho,
          .gamma_rad = gamma,
          .delta_rad = delta,
          .arrived = arrived};
}

}  // namespace regista::control
