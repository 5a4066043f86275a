// SPDX-License-Identifier: Apache-2.0
#include "simulated_imu.hpp"

#include <cmath>
#include <numbers>

namespace regista {

namespace {

constexpr double gravity_mps2 = 9.80665;
// Middle Europe's and Scandinavia's.
constexpr double horizontal_field_gauss = 0.17;
constexpr double downward_field_gauss = 0.47;
constexpr Range not_negative{.min = 0};

std::uint64_t read_seed(const Section& config) {
  return static_cast<std::uint64_t>(config.integer("seed", 1, not_negative));
}

sim::ImuParameters read_imu(const Section& config) {
  sim::ImuParameters imu;
  imu.gyro_noise_radps = config.angle("gyro_noise", imu.gyro_noise_radps, not_negative);
  imu.gyro_bias_radps = config.angle("gyro_bias", imu.gyro_bias_radps, not_negative);
  imu.accel_noise_mps2 = config.number("accel_noise", imu.accel_noise_mps2, not_negative);
  imu.accel_bias_mps2 = config.number("accel_bias", imu.accel_bias_mps2, not_negative);
  imu.misalignment_rad = config.angle("misalignment", imu.misalignment_rad, not_negative);
  imu.seed = 2 * read_seed(config);
  return imu;
}

sim::MagnetometerParameters read_compass(const Section& config) {
  sim::MagnetometerParameters compass;
  compass.noise_rad = config.angle("heading_noise", compass.noise_rad, not_negative);
  compass.hard_iron_rad = config.angle("hard_iron", compass.hard_iron_rad, not_negative);
  compass.soft_iron_rad = config.angle("soft_iron", compass.soft_iron_rad, not_negative);
  compass.seed = 2 * read_seed(config) + 1;
  return compass;
}

}  // namespace

SimulatedImu::SimulatedImu(Setup& setup)
    : port_{setup.provide<Imu>()},
      truth_{setup.require<Position2d>()},
      imu_{read_imu(setup.config)},
      compass_{read_compass(setup.config)} {
  truth_.on_data<position2d::State>([this](const position2d::State& state, Time) {
    if (!base_) before_ = state.velocity;
    base_ = state;
  });
}

Result<> SimulatedImu::read(const Tick& tick) {
  const double dt = seconds(tick.dt);
  if (!base_ || dt <= 0) return {};
  // The body's axes turn while it accelerates: a = dv/dt + ω × v.
  const BodyVelocity& now = base_->velocity;
  const double ax = (now.x - before_.x) / dt - now.w * now.y;
  const double ay = (now.y - before_.y) / dt + now.w * now.x;
  before_ = now;
  const sim::Imu::Reading reading = imu_.read(ax, ay, now.w, dt);
  heading_rad_ = compass_.read(base_->pose.heading);
  const double north_rad = std::numbers::pi / 2 - heading_rad_;  // seen from the body
  samples_ = imu::Calibrated{.acceleration_x = static_cast<float>(reading.accel_x_mps2),
                             .acceleration_y = static_cast<float>(reading.accel_y_mps2),
                             .acceleration_z = static_cast<float>(gravity_mps2),
                             .rate_z = static_cast<float>(reading.rate_radps),
                             .field_x = static_cast<float>(horizontal_field_gauss * std::cos(north_rad)),
                             .field_y = static_cast<float>(horizontal_field_gauss * std::sin(north_rad)),
                             .field_z = static_cast<float>(-downward_field_gauss)};
  return {};
}

void SimulatedImu::publish() {
  if (!samples_) return;
  port_.send(*samples_);
  port_.send(imu::State{.pose = {.yaw = heading_rad_}});
}

}  // namespace regista
