// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/core/geometry.hpp>
#include <regista/core/time.hpp>
#include <regista/sim/random.hpp>

namespace regista::sim {

/// A receiver of the metre class. Times are means of exponential waits; 0 for "never".
struct GpsParameters {
  double period_s = 0.2;
  double noise_m = 0.1;     ///< sd of a fix along each axis, new every time
  double drift_m = 1.0;     ///< sd along each axis of an error that wanders (first-order Gauss-Markov)
  double drift_s = 120;     ///< correlation time of it
  double jump_every_s = 0;  ///< between jumps of the solution, as when the set of satellites changes
  double jump_m = 3;        ///< sd of a jump along each axis; it decays as the drift does
  double loss_every_s = 0;  ///< between losses
  double loss_s = 5;        ///< length of a loss
  std::uint64_t seed = 1;
};

class Gps {
 public:
  struct Fix {
    double x_m = 0;
    double y_m = 0;
  };

  /// Throws std::invalid_argument on a parameter that is negative or not finite, or a period of 0.
  explicit Gps(const GpsParameters& parameters);

  /// Where the antenna is after `dt`. A fix, once a period, unless the signal is lost.
  std::optional<Fix> step(const Pose2d& truth, Duration dt);
  /// What fixes are off by now, noise apart.
  [[nodiscard]] Fix error() const { return {.x_m = drift_x_m_, .y_m = drift_y_m_}; }

 private:
  GpsParameters parameters_;
  Random random_;
  double drift_x_m_, drift_y_m_;
  double until_fix_s_ = 0;
  double lost_for_s_ = 0;
};

struct MagnetometerParameters {
  double noise_rad = 0.01;        ///< sd of a reading
  double hard_iron_rad = 0.08;    ///< amplitude of the error that repeats once a turn
  double hard_iron_at_rad = 0.6;  ///< heading at which it crosses 0, rising
  double soft_iron_rad = 0.035;   ///< likewise, twice a turn
  double soft_iron_at_rad = -0.4;
  std::uint64_t seed = 1;
};

/// A compass on a robot of steel and motors. With the defaults it errs by 6.5° at most, as Lien 2013 (6.4) measured.
class Magnetometer {
 public:
  /// Throws std::invalid_argument on a parameter that is not finite, or a noise below 0.
  explicit Magnetometer(const MagnetometerParameters& parameters);

  /// Heading as read, in (-π, π].
  double read(double heading_rad);
  /// What a reading at this heading is off by, noise apart.
  [[nodiscard]] double error_rad(double heading_rad) const;

 private:
  MagnetometerParameters parameters_;
  Random random_;
};

}  // namespace regista::sim
