// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <regista/sim/ball.hpp>

#include "require.hpp"

namespace regista::sim {

Ball::Ball(const BallParameters& parameters) : parameters_{parameters} {
  require_positive("slide_decel_mps2", parameters.slide_decel_mps2);
  require_positive("roll_decel_mps2", parameters.roll_decel_mps2);
  require(parameters.roll_share >= 0 && parameters.roll_share <= 1, "roll_share", parameters.roll_share, "give 0 to 1");
}

void Ball::place(double x_m, double y_m) {
  x_m_ = x_m;
  y_m_ = y_m;
  speed_mps_ = 0;
}

void Ball::kick(const FieldVelocity& velocity) {
  speed_mps_ = std::hypot(velocity.x, velocity.y);
  if (speed_mps_ > 0) {
    direction_x_ = velocity.x / speed_mps_;
    direction_y_ = velocity.y / speed_mps_;
  }
  roll_below_mps_ = parameters_.roll_share * speed_mps_;
}

void Ball::step(Duration dt) {
  double left_s = seconds(dt);
  const auto slow_down = [&](double decel_mps2, double to_mps) {
    const double t = std::clamp((speed_mps_ - to_mps) / decel_mps2, 0.0, left_s);
    const double way = t * (speed_mps_ - decel_mps2 * t / 2);
    x_m_ += direction_x_ * way;
    y_m_ += direction_y_ * way;
    speed_mps_ = std::max(0.0, speed_mps_ - decel_mps2 * t);
    left_s -= t;
  };
  slow_down(parameters_.slide_decel_mps2, roll_below_mps_);
  slow_down(parameters_.roll_decel_mps2, 0);
}

Kicker::Kicker(const KickerParameters& parameters) : parameters_{parameters} {
  require_positive("max_speed_mps", parameters.max_speed_mps);
  require_positive("charge_s", parameters.charge_s);
  require_positive("reach_m", parameters.reach_m);
  require_positive("front_m", parameters.front_m);
  require_positive("half_width_m", parameters.half_width_m);
}

void Kicker::step(Duration dt) { energy_ = 1 - (1 - energy_) * std::exp(-seconds(dt) / parameters_.charge_s); }

bool Kicker::reaches(const Ball& ball, const Pose2d& robot) const {
  const Pose2d at = inverse(robot) * Pose2d{.x = ball.x_m(), .y = ball.y_m()};
  return at.x > 0 && at.x < parameters_.front_m + parameters_.reach_m && std::abs(at.y) < parameters_.half_width_m;
}

double Kicker::kick(Ball& ball, const Pose2d& robot, const BodyVelocity& velocity, double speed_mps) {
  const double speed = std::clamp(speed_mps, 0.0, parameters_.max_speed_mps * std::sqrt(energy_));
  const double share = speed / parameters_.max_speed_mps;
  energy_ -= share * share;
  if (!reaches(ball, robot)) return 0;
  ball.kick(to_field(BodyVelocity{.x = velocity.x + speed, .y = velocity.y}, robot.heading));
  return ball.speed_mps();
}

}  // namespace regista::sim
