// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>
#include <regista/sim/motor.hpp>

namespace regista::sim {

void SpeedLoop::see(double angle_rad, double h) {
  constexpr double turn = 2 * std::numbers::pi;
  const double before = edges_;
  edges_ = angle_rad / turn * parameters_.triggers_per_revolution;
  const auto now = static_cast<std::int64_t>(std::floor(edges_));
  since_edge_s_ += h;
  if (now != count_) {
    // The last edge passed is at `now` when turning up and at `now + 1` when turning down.
    const int direction = now > count_ ? 1 : -1;
    const auto last = static_cast<double>(direction > 0 ? now : now + 1);
    const double after_edge_s = h * (edges_ - last) / (edges_ - before);
    const double period_s = (since_edge_s_ - after_edge_s) / static_cast<double>(std::abs(now - count_));
    // An edge after standstill or a reversal ends no period yet.
    speed_radps_ = direction == direction_ ? direction * turn / parameters_.triggers_per_revolution / period_s : 0;
    direction_ = direction;
    since_edge_s_ = after_edge_s;
    count_ = now;
  } else if (since_edge_s_ > parameters_.stall_s) {
    speed_radps_ = 0;
    direction_ = 0;
  }
}

double SpeedLoop::duty(double target_radps) {
  if (std::abs(target_radps - target_radps_) > parameters_.reset_at_jump * std::abs(target_radps_)) integral_ = 0;
  target_radps_ = target_radps;
  const double error = (target_radps - speed_radps_) / full_speed_radps_;
  integral_ = std::clamp(integral_ + parameters_.i_per_s * parameters_.period_s * error, -1.0, 1.0);
  return std::clamp(parameters_.p * error + integral_, -1.0, 1.0);
}

}  // namespace regista::sim
