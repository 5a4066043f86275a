// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "localizer.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "localizer",
    .summary = "Where a base is: wheels, gyro, heading and GPS fused, and why",
    .rate_hz = 50,
    .stops_by_itself = true,
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::Localizer>(setup);
    },
};
