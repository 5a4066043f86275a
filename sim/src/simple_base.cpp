// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <regista/sim/simple_base.hpp>

#include "require.hpp"
#include "sub_steps.hpp"

namespace regista::sim {

SimpleBase::SimpleBase(const SimpleBaseParameters& parameters) : parameters_{parameters}, random_{parameters.seed} {
  require_not_negative("time_constant_s", parameters.time_constant_s);
  require_positive("max_speed_mps", parameters.max_speed_mps);
  require_positive("max_turn_radps", parameters.max_turn_radps);
  require_positive("max_accel_mps2", parameters.max_accel_mps2);
  require_positive("max_turn_accel_radps2", parameters.max_turn_accel_radps2);
  require_not_negative("noise_m_per_root_m", parameters.noise_m_per_root_m);
  require_not_negative("noise_rad_per_root_m", parameters.noise_rad_per_root_m);
  require_not_negative("noise_rad_per_root_rad", parameters.noise_rad_per_root_rad);
}

void SimpleBase::command(const BodyVelocity& velocity) {
  command_ = velocity;
  if (!std::isfinite(command_.x + command_.y + command_.w)) command_ = {};
  if (!parameters_.holonomic) command_.y = 0;
  const double speed = std::hypot(command_.x, command_.y);
  if (speed > parameters_.max_speed_mps) {
    command_.x *= parameters_.max_speed_mps / speed;
    command_.y *= parameters_.max_speed_mps / speed;
  }
  command_.w = std::clamp(command_.w, -parameters_.max_turn_radps, parameters_.max_turn_radps);
}

SimpleBase::State SimpleBase::step(Duration dt) {
  const SubSteps steps{dt, 0.001};
  for (int i = 0; i < steps.count; ++i) sub_step(steps.length_s);
  return state_;
}

void SimpleBase::sub_step(double h) {
  const double share = parameters_.time_constant_s > 0 ? -std::expm1(-h / parameters_.time_constant_s) : 1;
  const auto before = state_.velocity;
  double dx = share * (command_.x - before.x);
  double dy = share * (command_.y - before.y);
  const double change = std::hypot(dx, dy);
  if (change > parameters_.max_accel_mps2 * h) {
    dx *= parameters_.max_accel_mps2 * h / change;
    dy *= parameters_.max_accel_mps2 * h / change;
  }
  const double max_dw = parameters_.max_turn_accel_radps2 * h;
  auto& velocity = state_.velocity;
  velocity.x += dx;
  velocity.y += dy;
  velocity.w += std::clamp(share * (command_.w - before.w), -max_dw, max_dw);

  const double way = std::hypot(velocity.x, velocity.y) * h;
  const double way_sd = parameters_.noise_m_per_root_m * std::sqrt(way);
  const double turn_sd = std::hypot(parameters_.noise_rad_per_root_m * std::sqrt(way),
                                    parameters_.noise_rad_per_root_rad * std::sqrt(std::abs(velocity.w) * h));
  const double turn = (before.w + velocity.w) / 2 * h + random_.normal(turn_sd);
  const double side = parameters_.holonomic ? random_.normal(way_sd) : 0;
  const FieldVelocity way_in_field =
      to_field(BodyVelocity{.x = (before.x + velocity.x) / 2 * h + random_.normal(way_sd),
                            .y = (before.y + velocity.y) / 2 * h + side},
               state_.pose.heading + turn / 2);
  state_.pose.x += way_in_field.x;
  state_.pose.y += way_in_field.y;
  state_.pose.heading = wrap_angle(state_.pose.heading + turn);
}

}  // namespace regista::sim
