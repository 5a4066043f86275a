// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <initializer_list>
#include <regista/core/geometry.hpp>
#include <span>

namespace regista::control {

/// One value for each wheel of a base, at most eight. Speeds are of the rim [m/s].
class WheelSpeeds {
 public:
  static constexpr std::size_t capacity = 8;

  WheelSpeeds() = default;
  WheelSpeeds(std::initializer_list<double> speeds) : count_{speeds.size()} {
    assert(count_ <= capacity);
    std::copy(speeds.begin(), speeds.end(), speeds_.begin());
  }
  /// All at rest.
  explicit WheelSpeeds(std::size_t count) : count_{count} { assert(count_ <= capacity); }

  [[nodiscard]] std::size_t size() const { return count_; }
  double& operator[](std::size_t wheel) { return (assert(wheel < count_), speeds_[wheel]); }
  double operator[](std::size_t wheel) const { return (assert(wheel < count_), speeds_[wheel]); }
  [[nodiscard]] auto begin() { return speeds_.begin(); }
  [[nodiscard]] auto end() { return speeds_.begin() + static_cast<std::ptrdiff_t>(count_); }
  [[nodiscard]] auto begin() const { return speeds_.begin(); }
  [[nodiscard]] auto end() const { return speeds_.begin() + static_cast<std::ptrdiff_t>(count_); }

 private:
  std::array<double, capacity> speeds_{};
  std::size_t count_ = 0;
};

/// Scaled down until no wheel is faster than `limit_mps`, 0 or more: all by one factor, so that the direction of travel
/// and the radius of the curve stay.
[[nodiscard]] WheelSpeeds saturated(WheelSpeeds speeds, double limit_mps);

/// How wheel speeds and the velocity of the body hang together, for bases whose wheels are linear in it.
class Kinematics {
 public:
  /// Wheels: left, right; positive is forward. Throws std::invalid_argument unless `track_m`, the distance between
  /// the wheels' contact points, is positive.
  static Kinematics differential(double track_m);

  /// Wheels: front left, front right, rear left, rear right; positive is forward. A skid-steered base turns as if its
  /// wheels stood wider apart: `effective_track_m` is that width, found by `calibrate_wheels()`, and larger than the
  /// geometric one. Throws std::invalid_argument unless it is positive.
  static Kinematics skid_steer(double effective_track_m);

  /// Omnidirectional wheels on a circle, wheel i at `angles_rad[i]` counter-clockwise from ahead; positive drives the
  /// body counter-clockwise: v_i = -sin(angle_i) vx + cos(angle_i) vy + radius w. Throws std::invalid_argument for
  /// fewer than three or more than eight wheels, a radius that is not positive, or angles that leave a direction
  /// without drive.
  static Kinematics omni(std::span<const double> angles_rad, double radius_m);
  static Kinematics omni(std::initializer_list<double> angles_rad, double radius_m) {
    return omni(std::span{angles_rad.begin(), angles_rad.size()}, radius_m);
  }

  [[nodiscard]] std::size_t wheel_count() const { return count_; }

  /// What the wheels must do. A base that cannot move sideways ignores `velocity.y`.
  [[nodiscard]] WheelSpeeds wheels(const BodyVelocity& velocity) const;

  /// What the body does: least squares over the wheels.
  [[nodiscard]] BodyVelocity body(const WheelSpeeds& speeds) const;

  /// Root mean square over the wheels of what no rigid motion explains [m/s]: above the encoders' noise, something
  /// slips. Always 0 with as many wheels as degrees of freedom (differential; omni with three).
  [[nodiscard]] double slip(const WheelSpeeds& speeds) const;

 private:
  using Row = std::array<double, 3>;  // of vx, vy, w
  Kinematics(std::span<const Row> wheel_from_body, int degrees_of_freedom);

  std::size_t count_;
  std::array<Row, WheelSpeeds::capacity> wheel_from_body_{};
  std::array<Row, WheelSpeeds::capacity> body_from_wheel_{};  // the transpose of the pseudo-inverse
};

}  // namespace regista::control
