// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <regista/core/geometry.hpp>
#include <regista/core/time.hpp>
#include <span>

namespace regista::control {

/// A robot or an obstacle, seen from above.
struct Disc {
  double x = 0;              ///< [m]
  double y = 0;              ///< [m]
  FieldVelocity velocity{};  ///< w is of no interest
  double radius_m = 0;
  /// Avoids others by this very method: then either does half. Opponents and things that stand do not.
  bool cooperates = false;
};

struct AvoidanceConfig {
  double speed_mps = 0;
  double acceleration_mps2 = 0;
  /// How far ahead collisions are looked for. At least speed / acceleration: then closing a gap g at no more than
  /// g / horizon never asks for more deceleration than there is.
  Duration horizon{};
  double margin_m = 0.02;  ///< kept between discs, for what is not known of them
};

/// Keeps a robot that can move in any direction clear of others: optimal reciprocal collision avoidance (van den Berg,
/// Guy, Lin and Manocha 2011). Each disc forbids a half-plane of velocities; of the rest, the velocity nearest to the
/// preferred one is taken. When everything is forbidden, the one that intrudes least. Of those, what the acceleration
/// allows within `dt`. It is local: it does not find the way out of a dead end. Fixed memory.
class Avoidance {
 public:
  static constexpr std::size_t capacity = 32;  ///< discs, beside the robot itself

  struct Output {
    FieldVelocity velocity;  ///< to command; w is the preferred one's
    bool clear = true;       ///< no half-plane had to be violated
    bool refused = false;    ///< too many discs, or no numbers: brakes to rest
  };

  /// Throws std::invalid_argument that names the value which cannot be.
  explicit Avoidance(const AvoidanceConfig& config);

  /// `self` with its present velocity, the velocity that it would like, and everybody else.
  [[nodiscard]] Output step(const Disc& self, const FieldVelocity& preferred, std::span<const Disc> others,
                            Duration dt);

  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  AvoidanceConfig config_;
  std::uint64_t refused_ = 0;
};

}  // namespace regista::control
