// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "simulated_imu.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "simulated_imu",
    .summary = "An IMU with a compass that exists only here: noise, biases and iron on the pose of a base",
    .rate_hz = 100,
    .stops_by_itself = true,
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::SimulatedImu>(setup);
    },
};
