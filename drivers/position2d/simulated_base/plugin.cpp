// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "simulated_base.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "simulated_base",
    .summary = "A base that exists only here: first-order motors, limits, noise",
    .rate_hz = 100,
    .stops_by_itself = true,
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::SimulatedBase>(setup);
    },
};
