// SPDX-License-Identifier: Apache-2.0
#include "regista/control/odometry.hpp"

#include <Eigen/Core>

#include "arc.hpp"
#include "parameter.hpp"

namespace regista::control {

Pose2d travelled(const Pose2d& start, const BodyVelocity& velocity, Duration dt) {
  const double t = seconds(dt);
  const std::complex<double> way = Arc(start.heading, velocity.w, t).way * std::complex<double>{velocity.x, velocity.y};
  return {.x = start.x + way.real(), .y = start.y + way.imag(), .heading = wrap_angle(start.heading + velocity.w * t)};
}

Odometry::Odometry(const OdometryNoise& noise) : noise_{noise} {
  require_not_negative("position_m2_per_m", noise.position_m2_per_m);
  require_not_negative("heading_rad2_per_m", noise.heading_rad2_per_m);
  require_not_negative("heading_rad2_per_rad", noise.heading_rad2_per_rad);
}

void Odometry::reset(const Pose2d& pose, const PoseCovariance& covariance) {
  if (!sane(pose.x) || !sane(pose.y) || !sane(pose.heading)) {
    ++refused_;
    return;
  }
  pose_ = {.x = pose.x, .y = pose.y, .heading = wrap_angle(pose.heading)};
  covariance_ = covariance;
}

const Pose2d& Odometry::step(const BodyVelocity& velocity, Duration dt) {
  if (!sane(velocity.x) || !sane(velocity.y) || !sane(velocity.w) || dt < Duration::zero()) {
    ++refused_;
    return pose_;
  }
  const double t = seconds(dt);
  const Arc arc(pose_.heading, velocity.w, t);
  const std::complex<double> v{velocity.x, velocity.y};
  const std::complex<double> way = v * arc.way;
  const std::complex<double> way_by_turn = v * arc.way_by_turn;

  // An error of the heading turns the way; an error of the turn bends it.
  const Eigen::Matrix3d by_start{{1, 0, -way.imag()}, {0, 1, way.real()}, {0, 0, 1}};
  const Eigen::Vector3d by_turn{way_by_turn.real(), way_by_turn.imag(), 1};
  const double length = std::abs(v) * t;
  const double turn_variance =
      noise_.heading_rad2_per_m * length + noise_.heading_rad2_per_rad * std::abs(velocity.w) * t;
  const double position_variance = noise_.position_m2_per_m * length;

  auto& c = covariance_;
  const Eigen::Matrix3d before{{c.xx, c.xy, c.xh}, {c.xy, c.yy, c.yh}, {c.xh, c.yh, c.hh}};
  const Eigen::Matrix3d after =
      by_start * before * by_start.transpose() + turn_variance * by_turn * by_turn.transpose();
  c = {.xx = after(0, 0) + position_variance,
       .xy = after(0, 1),
       .xh = after(0, 2),
       .yy = after(1, 1) + position_variance,
       .yh = after(1, 2),
       .hh = after(2, 2)};

  pose_ = {.x = pose_.x + way.real(), .y = pose_.y + way.imag(), .heading = wrap_angle(pose_.heading + velocity.w * t)};
  return pose_;
}

}  // namespace regista::control
