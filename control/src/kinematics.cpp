// SPDX-License-Identifier: Apache-2.0
#include "regista/control/kinematics.hpp"

#include <Eigen/QR>
#include <cmath>
#include <string>

#include "parameter.hpp"

namespace regista::control {

WheelSpeeds saturated(WheelSpeeds speeds, double limit_mps) {
  assert(limit_mps >= 0);
  double fastest = 0;
  for (const double speed : speeds) fastest = std::max(fastest, std::abs(speed));
  if (fastest > limit_mps) {
    for (double& speed : speeds) speed *= limit_mps / fastest;
  }
  return speeds;
}

Kinematics Kinematics::differential(double track_m) {
  require_positive("track_m", track_m);
  const std::array<Row, 2> rows{Row{1, 0, -track_m / 2}, Row{1, 0, track_m / 2}};
  return {rows, 2};
}

Kinematics Kinematics::skid_steer(double effective_track_m) {
  require_positive("effective_track_m", effective_track_m);
  const Row left{1, 0, -effective_track_m / 2};
  const Row right{1, 0, effective_track_m / 2};
  const std::array<Row, 4> rows{left, right, left, right};
  return {rows, 2};
}

Kinematics Kinematics::omni(std::span<const double> angles_rad, double radius_m) {
  require_positive("radius_m", radius_m);
  require(angles_rad.size() >= 3 && angles_rad.size() <= WheelSpeeds::capacity, "number of angles_rad",
          static_cast<double>(angles_rad.size()), "give three to eight");
  std::array<Row, WheelSpeeds::capacity> rows{};
  for (std::size_t i = 0; i < angles_rad.size(); ++i) {
    require(std::isfinite(angles_rad[i]), "angles_rad[" + std::to_string(i) + "]", angles_rad[i], "give it in radians");
    rows[i] = {-std::sin(angles_rad[i]), std::cos(angles_rad[i]), radius_m};
  }
  return {std::span{rows}.first(angles_rad.size()), 3};
}

Kinematics::Kinematics(std::span<const Row> wheel_from_body, int degrees_of_freedom) : count_{wheel_from_body.size()} {
  constexpr int capacity = WheelSpeeds::capacity;
  std::copy(wheel_from_body.begin(), wheel_from_body.end(), wheel_from_body_.begin());
  const Eigen::Map<const Eigen::Matrix<double, capacity, 3, Eigen::RowMajor>> rows{wheel_from_body_[0].data()};
  // The rows of absent wheels are 0 and change neither the least squares nor their minimum norm.
  Eigen::CompleteOrthogonalDecomposition<Eigen::Matrix<double, capacity, 3>> decomposition{rows};
  decomposition.setThreshold(1e-6);
  require(decomposition.rank() == degrees_of_freedom, "rank of angles_rad", static_cast<double>(decomposition.rank()),
          "turn at least one wheel so that every direction is driven (rank 3)");
  const Eigen::Matrix<double, 3, capacity> inverse = decomposition.pseudoInverse();
  for (int wheel = 0; wheel < capacity; ++wheel) {
    for (int axis = 0; axis < 3; ++axis) {
      body_from_wheel_[static_cast<std::size_t>(wheel)][static_cast<std::size_t>(axis)] = inverse(axis, wheel);
    }
  }
}

WheelSpeeds Kinematics::wheels(const BodyVelocity& velocity) const {
  WheelSpeeds speeds(count_);
  for (std::size_t i = 0; i < count_; ++i) {
    const auto& [x, y, w] = wheel_from_body_[i];
    speeds[i] = x * velocity.x + y * velocity.y + w * velocity.w;
  }
  return speeds;
}

BodyVelocity Kinematics::body(const WheelSpeeds& speeds) const {
  assert(speeds.size() == count_);
  BodyVelocity velocity;
  for (std::size_t i = 0; i < count_; ++i) {
    const auto& [x, y, w] = body_from_wheel_[i];
    velocity.x += x * speeds[i];
    velocity.y += y * speeds[i];
    velocity.w += w * speeds[i];
  }
  return velocity;
}

double Kinematics::slip(const WheelSpeeds& speeds) const {
  const WheelSpeeds explained = wheels(body(speeds));
  double sum = 0;
  for (std::size_t i = 0; i < count_; ++i) sum += (speeds[i] - explained[i]) * (speeds[i] - explained[i]);
  return std::sqrt(sum / static_cast<double>(count_));
}

}  // namespace regista::control
