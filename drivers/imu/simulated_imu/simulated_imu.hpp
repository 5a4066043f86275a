// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/device/driver.hpp>
#include <regista/sim/gps.hpp>
#include <regista/sim/imu.hpp>

namespace regista {

/// An IMU with a compass that exists only here, on the base that it `requires`: a position2d whose state is the truth,
/// such as simulated_base's "truth:::position2d:1". The base stays level.
///
/// `imu:0` publishes CALIB (specific forces, turn rates, the earth's field) and STATE (roll, pitch and the compass'
/// heading, counter-clockwise from east) in each beat.
///
/// | Key             | Value                                                   | Default        |
/// |-----------------|---------------------------------------------------------|----------------|
/// | `gyro_noise`    | [angle/s] sd of a reading                               | 0.38 degrees/s |
/// | `gyro_bias`     | [angle/s] sd of the bias, drawn once                    | 1.15 degrees/s |
/// | `accel_noise`   | [m/s²] sd of a reading                                  | 0.029          |
/// | `accel_bias`    | [m/s²] sd of the biases, drawn once                     | 0.2            |
/// | `misalignment`  | [angle] sd of the mounting's three angles, drawn once   | 0.57 degrees   |
/// | `heading_noise` | [angle] sd of a reading of the compass                  | 0.57 degrees   |
/// | `hard_iron`     | [angle] amplitude of its error that repeats once a turn | 4.6 degrees    |
/// | `soft_iron`     | [angle] likewise, twice a turn                          | 2.0 degrees    |
/// | `seed`          | whole number                                            | 1              |
class SimulatedImu final : public Driver {
 public:
  explicit SimulatedImu(Setup& setup);

  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override {}

 private:
  Port<Imu> port_;
  Required<Position2d> truth_;
  sim::Imu imu_;
  sim::Magnetometer compass_;
  std::optional<position2d::State> base_;
  BodyVelocity before_;  ///< of the base, a beat ago
  std::optional<imu::Calibrated> samples_;
  double heading_rad_ = 0;
};

}  // namespace regista
