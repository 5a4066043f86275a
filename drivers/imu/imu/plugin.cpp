// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "imu.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "imu",
    .summary = "A MicroStrain IMU on a serial line: 3DM-GX3-25 and those that speak MIP",
    .rate_hz = 10,  // of the time-outs: a sample is published when it comes
    .stops_by_itself = true,
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::ImuDriver>(setup);
    },
};
