// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <numbers>

namespace regista {

// Frames: *field* (or odometry) is fixed to the floor, *body* to the robot. In both, +x forward (east), +y left
// (north), +w counter-clockwise. docs/conventions.md draws them.

/// Where a robot or a target is on the field.
struct Pose2d {
  double x = 0;        ///< [m]
  double y = 0;        ///< [m]
  double heading = 0;  ///< [rad], counter-clockwise from +x
  friend bool operator==(const Pose2d&, const Pose2d&) = default;
};

/// Velocity seen by the robot: x ahead, y to its left.
struct BodyVelocity {
  double x = 0;  ///< [m/s]
  double y = 0;  ///< [m/s]
  double w = 0;  ///< [rad/s], counter-clockwise
  friend bool operator==(const BodyVelocity&, const BodyVelocity&) = default;
};

/// Velocity seen from the field.
struct FieldVelocity {
  double x = 0;  ///< [m/s]
  double y = 0;  ///< [m/s]
  double w = 0;  ///< [rad/s], counter-clockwise
  friend bool operator==(const FieldVelocity&, const FieldVelocity&) = default;
};

struct Point3d {
  double x = 0;  ///< [m]
  double y = 0;  ///< [m]
  double z = 0;  ///< [m]
  friend bool operator==(const Point3d&, const Point3d&) = default;
};

/// Rotation about the fixed axes x, y, z, applied in this order.
struct Orientation3d {
  double roll = 0;   ///< [rad]
  double pitch = 0;  ///< [rad]
  double yaw = 0;    ///< [rad]
  friend bool operator==(const Orientation3d&, const Orientation3d&) = default;
};

struct Pose3d {
  double x = 0;      ///< [m]
  double y = 0;      ///< [m]
  double z = 0;      ///< [m]
  double roll = 0;   ///< [rad]
  double pitch = 0;  ///< [rad]
  double yaw = 0;    ///< [rad]
  friend bool operator==(const Pose3d&, const Pose3d&) = default;
};

/// Rates of the six coordinates of a Pose3d: velocities [m/s, rad/s] or accelerations [m/s², rad/s²].
struct Rates3d {
  double x = 0;
  double y = 0;
  double z = 0;
  double roll = 0;
  double pitch = 0;
  double yaw = 0;
  friend bool operator==(const Rates3d&, const Rates3d&) = default;
};

/// Extent of a body.
struct Size3d {
  double width = 0;   ///< [m], along y
  double length = 0;  ///< [m], along x
  double height = 0;  ///< [m], along z
  friend bool operator==(const Size3d&, const Size3d&) = default;
};

/// The same direction in (-π, π]; NaN for an angle that is not finite.
inline double wrap_angle(double angle_rad) {
  if (angle_rad > -std::numbers::pi && angle_rad <= std::numbers::pi) return angle_rad;  // most are: 20 ns saved
  const double wrapped = std::remainder(angle_rad, 2 * std::numbers::pi);
  return wrapped <= -std::numbers::pi ? std::numbers::pi : wrapped;
}

/// The shortest turn from `from` to `to`, in (-π, π].
inline double angle_between(double from_rad, double to_rad) { return wrap_angle(to_rad - from_rad); }

inline BodyVelocity to_body(const FieldVelocity& velocity, double heading) {
  const double c = std::cos(heading);
  const double s = std::sin(heading);
  return {.x = c * velocity.x + s * velocity.y, .y = -s * velocity.x + c * velocity.y, .w = velocity.w};
}

inline FieldVelocity to_field(const BodyVelocity& velocity, double heading) {
  const double c = std::cos(heading);
  const double s = std::sin(heading);
  return {.x = c * velocity.x - s * velocity.y, .y = s * velocity.x + c * velocity.y, .w = velocity.w};
}

/// Chain two frames: `field_from_ball = field_from_robot * robot_from_ball`.
inline Pose2d operator*(const Pose2d& a_from_b, const Pose2d& b_from_c) {
  const double c = std::cos(a_from_b.heading);
  const double s = std::sin(a_from_b.heading);
  return {.x = a_from_b.x + c * b_from_c.x - s * b_from_c.y,
          .y = a_from_b.y + s * b_from_c.x + c * b_from_c.y,
          .heading = wrap_angle(a_from_b.heading + b_from_c.heading)};
}

/// The same transform the other way round: `inverse(a_from_b)` is `b_from_a`.
inline Pose2d inverse(const Pose2d& pose) {
  const double c = std::cos(pose.heading);
  const double s = std::sin(pose.heading);
  return {.x = -c * pose.x - s * pose.y, .y = s * pose.x - c * pose.y, .heading = wrap_angle(-pose.heading)};
}

/// [m], headings disregarded
inline double distance(const Pose2d& a, const Pose2d& b) { return std::hypot(b.x - a.x, b.y - a.y); }

}  // namespace regista
