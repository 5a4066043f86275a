// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

// Built for this server's API by a compiler that lays the shared types out otherwise.
extern "C" const regista::Plugin regista_plugin{
    .layout = regista::plugin_layout + 1, .name = "wrong_layout", .summary = "", .create = nullptr};
