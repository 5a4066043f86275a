// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "differential.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "differential",
    .summary = "A base on two wheels, or on four that skid, of any driver that turns wheels",
    .rate_hz = 50,
    .stops_by_itself = true,  // the wheels' own driver says whether they do
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::Differential>(setup);
    },
};
