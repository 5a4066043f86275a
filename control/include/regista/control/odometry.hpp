// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <regista/core/geometry.hpp>
#include <regista/core/time.hpp>

namespace regista::control {

/// Of a Pose2d; symmetric, so six numbers.
struct PoseCovariance {
  double xx = 0;  ///< [m²]
  double xy = 0;  ///< [m²]
  double xh = 0;  ///< [m rad]
  double yy = 0;  ///< [m²]
  double yh = 0;  ///< [m rad]
  double hh = 0;  ///< [rad²]
  friend bool operator==(const PoseCovariance&, const PoseCovariance&) = default;
};

/// How fast odometry becomes uncertain: variances that grow with the way travelled, so that they do not depend on the
/// length of a step.
struct OdometryNoise {
  double position_m2_per_m = 1e-4;     ///< in each direction: 10 mm after a metre
  double heading_rad2_per_m = 1e-4;    ///< 0.6° after a metre
  double heading_rad2_per_rad = 1e-3;  ///< 4.5° after a turn
};

/// Where a base is after `dt` at a constant velocity: the exact arc, smooth through w = 0.
[[nodiscard]] Pose2d travelled(const Pose2d& start, const BodyVelocity& velocity, Duration dt);

/// Dead reckoning from the velocity that the wheels measured.
class Odometry {
 public:
  /// Throws std::invalid_argument for a negative or infinite noise.
  explicit Odometry(const OdometryNoise& noise = {});

  /// Go on from here. A pose that is not finite or absurd changes nothing and is counted.
  void reset(const Pose2d& pose, const PoseCovariance& covariance = {});

  /// Advance by `dt` at `velocity` and return the new pose. A velocity that is not finite or absurd, or a negative
  /// `dt`, moves nothing and is counted.
  const Pose2d& step(const BodyVelocity& velocity, Duration dt);

  [[nodiscard]] const Pose2d& pose() const { return pose_; }
  [[nodiscard]] const PoseCovariance& covariance() const { return covariance_; }
  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  OdometryNoise noise_;
  Pose2d pose_;
  PoseCovariance covariance_;
  std::uint64_t refused_ = 0;
};

}  // namespace regista::control
