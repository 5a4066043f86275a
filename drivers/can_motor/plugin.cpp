// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "can_motor.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "can_motor",
    .summary = "Drives on a CAN bus: CiA 402 or Sevcon Gen4",
    .rate_hz = 100,
    .stops_by_itself = true,  // a drive that would not is never enabled
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::CanMotor>(setup);
    },
};
