// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/sim/random.hpp>

namespace regista::sim {

/// Of the class of ADXL345 (accelerometer) and ITG-3200 (gyro); the defaults are their data sheets' typical values.
struct ImuParameters {
  double accel_noise_mps2 = 0.029;             ///< sd of a reading: ADXL345, 0.75 LSB of 3.9 mg at 100 Hz
  double accel_bias_mps2 = 0.2;                ///< sd of the bias, one draw an axis; ADXL345: 20 mg after trimming
  double accel_bias_walk_mps2_per_root_s = 0;  ///< a floor that is not level, a board that warms up
  double accel_step_mps2 = 0.038;              ///< of the last bit: 3.9 mg; 0: none
  double gyro_noise_radps = 0.0066;            ///< sd of a reading: ITG-3200, 0.38 °/s rms
  double gyro_bias_radps = 0.02;               ///< sd of the bias at power-on, one draw; ITG-3200, once zeroed
  double gyro_bias_walk_radps_per_root_s = 1e-4;
  double gyro_step_radps = 0.00121;  ///< of the last bit: 1 / 14.375 °/s; 0: none
  double misalignment_rad = 0.01;    ///< sd of each of the mounting's three small angles, one draw
  std::uint64_t seed = 1;
};

/// Accelerations along the body's x and y, and the turn rate, as a chip on the robot reads them.
class Imu {
 public:
  struct Reading {
    double accel_x_mps2 = 0;
    double accel_y_mps2 = 0;
    double rate_radps = 0;  ///< counter-clockwise
  };

  /// Throws std::invalid_argument on a parameter that is negative or not finite.
  explicit Imu(const ImuParameters& parameters);

  /// The truth in the body frame on level ground, as WheeledRobot::State has it; `dt_s` since the reading before.
  Reading read(double accel_x_mps2, double accel_y_mps2, double rate_radps, double dt_s);

 private:
  ImuParameters parameters_;
  Random random_;
  double roll_rad_, pitch_rad_, yaw_rad_;  // of the chip in the body
  double bias_x_mps2_, bias_y_mps2_, bias_radps_;
};

}  // namespace regista::sim
