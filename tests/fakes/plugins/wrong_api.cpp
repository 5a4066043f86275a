// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

// Built for the server after this one.
extern "C" const regista::Plugin regista_plugin{
    .api = regista::plugin_api + 1, .name = "wrong_api", .summary = "", .create = nullptr};
