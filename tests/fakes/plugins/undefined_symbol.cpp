// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

extern "C" void foo();  // which nobody defines

extern "C" const regista::Plugin regista_plugin{
    .name = "undefined_symbol",
    .summary = "",
    .create = [](regista::Setup&) -> std::unique_ptr<regista::Driver> {
      foo();
      return nullptr;
    },
};
