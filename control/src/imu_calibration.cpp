// SPDX-License-Identifier: Apache-2.0
#include <regista/control/imu_calibration.hpp>

#include "parameter.hpp"

namespace regista::control {

ImuCalibration::ImuCalibration(const ImuCalibrationConfig& config) : config_{config} {
  require(config.rest > Duration::zero(), "rest", seconds(config.rest), "give a positive time");
  require_positive("still_mps2", config.still_mps2);
  require_positive("still_radps", config.still_radps);
  require(std::isfinite(config.mount.roll + config.mount.pitch + config.mount.yaw), "mount", config.mount.yaw,
          "give finite angles");
  body_from_chip_ = Eigen::AngleAxisd{config.mount.yaw, Eigen::Vector3d::UnitZ()} *
                    Eigen::AngleAxisd{config.mount.pitch, Eigen::Vector3d::UnitY()} *
                    Eigen::AngleAxisd{config.mount.roll, Eigen::Vector3d::UnitX()};
}

void ImuCalibration::step(const ImuSample& chip, bool may_rest, Duration dt) {
  if (!chip.accel_mps2.allFinite() || !chip.rate_radps.allFinite()) {
    ++refused_;
    return;
  }
  const ImuSample body{.accel_mps2 = body_from_chip_ * chip.accel_mps2,
                       .rate_radps = body_from_chip_ * chip.rate_radps};
  const double n = std::max(count_, 1U);
  const bool moved = count_ > 0 && ((body.accel_mps2 - sum_.accel_mps2 / n).norm() > config_.still_mps2 ||
                                    (body.rate_radps - sum_.rate_radps / n).norm() > config_.still_radps);
  if (!may_rest || moved) begin();
  sum_.accel_mps2 += body.accel_mps2;
  sum_.rate_radps += body.rate_radps;
  ++count_;
  rested_ += dt;
  if (rested_ >= config_.rest) {
    level_ = Eigen::Quaterniond::FromTwoVectors(sum_.accel_mps2, Eigen::Vector3d::UnitZ());
    bias_radps_ = sum_.rate_radps / count_;
    ready_ = true;
    begin();
  }
  calibrated_ = {.accel_mps2 = level_ * body.accel_mps2, .rate_radps = level_ * (body.rate_radps - bias_radps_)};
}

void ImuCalibration::begin() {
  sum_ = {};
  count_ = 0;
  rested_ = {};
}

}  // namespace regista::control
