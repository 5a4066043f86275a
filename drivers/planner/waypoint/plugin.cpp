// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "waypoint.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "waypoint",
    .summary = "Drives a base through a list of way-points, and works at them",
    .rate_hz = 50,
    .stops_by_itself = true,
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::Waypoint>(setup);
    },
};
