// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "fake_base.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "fake_base",
    .summary = "A base for tests: records what is done to it, and misbehaves when told to",
    .stops_by_itself = true,
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::FakeBase>(setup);
    },
};
