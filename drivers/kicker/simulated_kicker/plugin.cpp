// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "simulated_kicker.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "simulated_kicker",
    .summary = "A kicker that exists only here: capacitor, kick, chip, dribbler",
    .rate_hz = 50,
    .stops_by_itself = true,
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::SimulatedKicker>(setup);
    },
};
