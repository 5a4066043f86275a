// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "posture.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "posture",
    .summary = "Drives a base that cannot move sideways to a pose",
    .rate_hz = 50,
    .stops_by_itself = true,
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::Posture>(setup);
    },
};
