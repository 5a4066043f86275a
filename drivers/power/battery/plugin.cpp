// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "battery.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "battery",
    .summary = "The battery that Linux knows, or a voltage sensor on it",
    .rate_hz = 1,
    .stops_by_itself = true,
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::BatteryDriver>(setup);
    },
};
