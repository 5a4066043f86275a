// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <regista/sim/imu.hpp>

#include "require.hpp"

namespace regista::sim {
namespace {

double quantise(double value, double step) { return step > 0 ? step * std::round(value / step) : value; }

}  // namespace

Imu::Imu(const ImuParameters& p) : parameters_{p}, random_{p.seed} {
  require_not_negative("accel_noise_mps2", p.accel_noise_mps2);
  require_not_negative("accel_bias_mps2", p.accel_bias_mps2);
  require_not_negative("accel_bias_walk_mps2_per_root_s", p.accel_bias_walk_mps2_per_root_s);
  require_not_negative("accel_step_mps2", p.accel_step_mps2);
  require_not_negative("gyro_noise_radps", p.gyro_noise_radps);
  require_not_negative("gyro_bias_radps", p.gyro_bias_radps);
  require_not_negative("gyro_bias_walk_radps_per_root_s", p.gyro_bias_walk_radps_per_root_s);
  require_not_negative("gyro_step_radps", p.gyro_step_radps);
  require_not_negative("misalignment_rad", p.misalignment_rad);
  roll_rad_ = random_.normal(p.misalignment_rad);
  pitch_rad_ = random_.normal(p.misalignment_rad);
  yaw_rad_ = random_.normal(p.misalignment_rad);
  bias_x_mps2_ = random_.normal(p.accel_bias_mps2);
  bias_y_mps2_ = random_.normal(p.accel_bias_mps2);
  bias_radps_ = random_.normal(p.gyro_bias_radps);
}

Imu::Reading Imu::read(double accel_x_mps2, double accel_y_mps2, double rate_radps, double dt_s) {
  constexpr double gravity_mps2 = 9.80665;
  const double accel_walk_mps2 = parameters_.accel_bias_walk_mps2_per_root_s * std::sqrt(dt_s);
  bias_x_mps2_ += random_.normal(accel_walk_mps2);
  bias_y_mps2_ += random_.normal(accel_walk_mps2);
  bias_radps_ += random_.normal(parameters_.gyro_bias_walk_radps_per_root_s * std::sqrt(dt_s));
  // The specific force (ax, ay, g) in axes turned by the mounting's roll, pitch and yaw, to first order.
  const double x = accel_x_mps2 + yaw_rad_ * accel_y_mps2 - pitch_rad_ * gravity_mps2;
  const double y = accel_y_mps2 - yaw_rad_ * accel_x_mps2 + roll_rad_ * gravity_mps2;
  const double rate = rate_radps * std::cos(roll_rad_) * std::cos(pitch_rad_);
  return {.accel_x_mps2 =
              quantise(x + bias_x_mps2_ + random_.normal(parameters_.accel_noise_mps2), parameters_.accel_step_mps2),
          .accel_y_mps2 =
              quantise(y + bias_y_mps2_ + random_.normal(parameters_.accel_noise_mps2), parameters_.accel_step_mps2),
          .rate_radps =
              quantise(rate + bias_radps_ + random_.normal(parameters_.gyro_noise_radps), parameters_.gyro_step_radps)};
}

}  // namespace regista::sim
