// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <regista/core/geometry.hpp>

namespace regista::control {

struct PostureRegulatorConfig {
  double k1 = 2;                     ///< [1/s], on the distance
  double k2 = 4;                     ///< [1/s], on the bearing
  double k3 = 1.3;                   ///< on the direction of approach
  double speed_limit_mps = 1;        ///< either way; above it the whole command is scaled, which keeps its path
  double turn_rate_limit_radps = 2;  ///< likewise
  double tolerance_m = 0.05;
  double tolerance_rad = 0.05;

  /// Kvalheim, Isaksen and Næss 2017, the quicker of their two; 1, 6, 7 is the other.
  static PostureRegulatorConfig quick() { return {}; }
  static PostureRegulatorConfig sharp() { return {.k1 = 1, .k2 = 6, .k3 = 7}; }
};

/// Drives a base that cannot move sideways to a pose (Aicardi, Casalino, Bicchi and Balestrino 1995). With the distance
/// ρ, the bearing γ of the goal off the nose and the angle δ from the goal's heading to the line of sight,
///
///     ρ' = -v cos γ,   γ' = v sin γ / ρ - ω,   δ' = v sin γ / ρ,
///     v = k1 ρ cos γ,  ω = k2 γ + k1 (sin γ cos γ / γ) (γ + k3 δ)
///
/// make V = (ρ² + γ² + k3 δ²) / 2 fall: V' = -k1 ρ² cos² γ - k2 γ². It backs up when the goal is behind. Within the
/// tolerance of the position, where γ means nothing, it turns on the spot.
class PostureRegulator {
 public:
  struct Output {
    BodyVelocity command;
    double rho_m = 0;
    double gamma_rad = 0;
    double delta_rad = 0;
    bool arrived = false;  ///< within both tolerances; the command is zero
    bool refused = false;  ///< a pose was no number: the command is zero
  };

  /// Throws std::invalid_argument that names the value which is not positive.
  explicit PostureRegulator(const PostureRegulatorConfig& config);

  [[nodiscard]] Output step(const Pose2d& pose, const Pose2d& goal);

  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  PostureRegulatorConfig config_;
  bool on_the_spot_ = false;  ///< until twice the tolerance away
  std::uint64_t refused_ = 0;
};

}  // namespace regista::control
