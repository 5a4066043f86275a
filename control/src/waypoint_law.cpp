// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/control/waypoint_law.hpp>

#include "parameter.hpp"

namespace regista::control {

WaypointLaw::WaypointLaw(const WaypointLawConfig& config) : config_{config} {
  require_not_negative("k1", config.k1);
  require_positive("k2", config.k2);
  require_positive("k3", config.k3);
  require_not_negative("beta", config.beta);
  require_positive("lambda", config.lambda);
  require_positive("speed_mps", config.speed_mps);
  require_positive("turn_rate_limit_radps", config.turn_rate_limit_radps);
}

WaypointLaw::Output WaypointLaw::step(const Pose2d& pose, const Pose2d& goal) const {
  for (const double value : {pose.x, pose.y, pose.heading, goal.x, goal.y, goal.heading}) {
    if (!sane(value)) return {.command = {}, .refused = true};
  }
  const double r = distance(pose, goal);
  if (r < 1e-9) return {.command = {}, .distance_m = r};
  const double line_of_sight = std::atan2(goal.y - pose.y, goal.x - pose.x);
  const double theta = angle_between(line_of_sight, goal.heading);
  const double delta = angle_between(line_of_sight, pose.heading);
  const auto& [k1, k2, k3, beta, lambda, speed, turn_rate_limit] = config_;
  const double z = delta - std::atan(-k1 * theta);
  const double curvature = -(k2 * z + (1 + k1 / (1 + k1 * k1 * theta * theta)) * std::sin(delta)) / r;
  const double v = std::min({speed / (1 + beta * std::pow(std::abs(curvature), lambda)), k3 * r,
                             turn_rate_limit / std::max(std::abs(curvature), 1e-9)});
  return {.command = {.x = v, .w = curvature * v}, .distance_m = r, .curvature_radpm = curvature};
}

}  // namespace regista::control
