// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "simulated_gps.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "simulated_gps",
    .summary = "A satellite receiver that exists only here: noise, drift, jumps and losses on the pose of a base",
    .rate_hz = 20,
    .stops_by_itself = true,
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::SimulatedGps>(setup);
    },
};
