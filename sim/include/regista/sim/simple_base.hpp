// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/core/geometry.hpp>
#include <regista/core/time.hpp>
#include <regista/sim/random.hpp>

namespace regista::sim {

struct SimpleBaseParameters {
  bool holonomic = true;              ///< false: a differential base, which ignores a command along y
  double time_constant_s = 0.05;      ///< of the velocity's first-order answer; 0: at once, but for the limits
  double max_speed_mps = 1.5;         ///< of the vector (x, y)
  double max_turn_radps = 6;          ///< of w
  double max_accel_mps2 = 3;          ///< of the vector (x, y)
  double max_turn_accel_radps2 = 20;  ///< of w
  double noise_m_per_root_m = 0;      ///< sd of the way's random walk after one metre, along x and along y
  double noise_rad_per_root_m = 0;    ///< sd of the heading's random walk after one metre
  double noise_rad_per_root_rad = 0;  ///< sd of the heading's random walk after one radian turned
  std::uint64_t seed = 1;
};

/// A base without wheels: velocities follow their command with one lag and within limits. For drivers and
/// demonstrations that need something that moves; OmniRobot and SkidSteerRobot are the models with physics.
class SimpleBase {
 public:
  struct State {
    Pose2d pose;            ///< truth, in the field
    BodyVelocity velocity;  ///< truth, without the noise
  };

  /// Throws std::invalid_argument on a parameter that is negative or not finite, or a limit of 0.
  explicit SimpleBase(const SimpleBaseParameters& parameters);

  /// Holds until the next command. Beyond the limits it is shortened, the direction kept. Not finite: taken as a stop.
  void command(const BodyVelocity& velocity);
  State step(Duration dt);
  [[nodiscard]] const State& state() const { return state_; }
  /// Put the base somewhere, at rest.
  void place(const Pose2d& pose) { state_ = {.pose = pose, .velocity = {}}; }

 private:
  void sub_step(double h);

  SimpleBaseParameters parameters_;
  Random random_;
  BodyVelocity command_;
  State state_;
};

}  // namespace regista::sim
