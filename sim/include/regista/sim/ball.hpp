// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/core/geometry.hpp>
#include <regista/core/time.hpp>

namespace regista::sim {

/// SSL-Vision's "straight two-phase" model: a kicked ball slides until it has lost so much speed that it rolls.
struct BallParameters {
  double slide_decel_mps2 = 3.4;
  double roll_decel_mps2 = 0.26;
  double roll_share = 5.0 / 7;  ///< of the kick's speed left when it begins to roll; 5/7 for a solid sphere
};

/// The golf ball on the carpet.
class Ball {
 public:
  /// Throws std::invalid_argument on a deceleration that is not above 0 or a share outside 0 to 1.
  explicit Ball(const BallParameters& parameters);

  void place(double x_m, double y_m);
  /// From now on at this velocity, sliding.
  void kick(const FieldVelocity& velocity);
  void step(Duration dt);

  [[nodiscard]] double x_m() const { return x_m_; }
  [[nodiscard]] double y_m() const { return y_m_; }
  [[nodiscard]] double speed_mps() const { return speed_mps_; }
  [[nodiscard]] FieldVelocity velocity() const {
    return {.x = direction_x_ * speed_mps_, .y = direction_y_ * speed_mps_};
  }

 private:
  BallParameters parameters_;
  double x_m_ = 0, y_m_ = 0;
  double direction_x_ = 1, direction_y_ = 0;
  double speed_mps_ = 0;
  double roll_below_mps_ = 0;
};

struct KickerParameters {
  double max_speed_mps = 8;    ///< of the ball from a full capacitor
  double charge_s = 1.5;       ///< time constant of charging
  double reach_m = 0.03;       ///< the ball may be this far ahead of the front
  double front_m = 0.08;       ///< of the robot, before its centre
  double half_width_m = 0.04;  ///< of the plunger
};

/// A capacitor and a solenoid: the energy of the ball is taken from the capacitor.
class Kicker {
 public:
  /// Throws std::invalid_argument on a parameter that is not above 0.
  explicit Kicker(const KickerParameters& parameters);

  void step(Duration dt);
  /// True when the ball lies before the plunger.
  [[nodiscard]] bool reaches(const Ball& ball, const Pose2d& robot) const;
  /// Kick straight ahead at `speed_mps` relative to the robot, as far as the charge allows. An empty kick when the
  /// ball is not there. The speed given to the ball.
  double kick(Ball& ball, const Pose2d& robot, const BodyVelocity& velocity, double speed_mps);
  /// Of the energy, 0 to 1.
  [[nodiscard]] double charge_ratio() const { return energy_; }

 private:
  KickerParameters parameters_;
  double energy_ = 0;
};

}  // namespace regista::sim
