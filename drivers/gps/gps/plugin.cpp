// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "gps.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "gps",
    .summary = "A satellite receiver, through gpsd",
    .rate_hz = 2,  // of the time-outs: what gpsd says is published when it comes
    .stops_by_itself = true,
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::GpsDriver>(setup);
    },
};
