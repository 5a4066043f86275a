// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "simulated_battery.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "simulated_battery",
    .summary = "A battery that exists only here: drains with the speed of its base, can be charged",
    .rate_hz = 1,
    .stops_by_itself = true,
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::SimulatedBattery>(setup);
    },
};
