// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/core/geometry.hpp>

namespace regista::control {

struct WaypointLawConfig {
  double k1 = 1;         ///< how far it swings out to arrive in the goal's direction; 0: drives straight at it
  double k2 = 3;         ///< how much faster it turns than it comes nearer
  double k3 = 0.5;       ///< [1/s], speed per distance close to the goal
  double beta = 0.4;     ///< [m^lambda], how much it slows down in curves
  double lambda = 2;     ///< how suddenly
  double speed_mps = 0;  ///< on the straight
  double turn_rate_limit_radps = 0;
};

/// Drives a base that cannot move sideways, forward only, along a smooth curve to a pose (Park and Kuipers 2011, "A
/// smooth control law for graceful motion of differential wheeled mobile robots in 2D environment"). With the distance
/// r, and the goal's direction θ and the robot's heading δ, both relative to the line of sight,
///
///     r' = -v cos δ,   θ' = v sin δ / r,   δ' = v sin δ / r + ω.
///
/// On the curve δ = atan(-k1 θ) both r and θ fall; z = δ - atan(-k1 θ) is the heading off it, and
///
///     ω = -(v / r) (k2 z + (1 + k1 / (1 + (k1 θ)²)) sin δ)   makes   z' = -k2 (v / r) z,
///
/// whatever the speed, which therefore may follow the curvature κ = ω / v: v = v_max / (1 + β |κ|^λ), and k3 r at most.
class WaypointLaw {
 public:
  struct Output {
    BodyVelocity command;
    double distance_m = 0;
    double curvature_radpm = 0;
    bool refused = false;  ///< a pose was no number: the command is zero
  };

  /// Throws std::invalid_argument that names the value which is not positive (or negative, for k1 and beta).
  explicit WaypointLaw(const WaypointLawConfig& config);

  /// At the goal itself the command is zero. When to stop there is up to the caller (`ParkingDetector`).
  [[nodiscard]] Output step(const Pose2d& pose, const Pose2d& goal) const;

 private:
  WaypointLawConfig config_;
};

}  // namespace regista::control
