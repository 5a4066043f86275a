// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "ssl_robot.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "ssl_robot",
    .summary = "A soccer robot of the Small Size League: motor board, IMU, camera above the field",
    .rate_hz = 500,
    .stops_by_itself = true,  // the board's watchdog
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::SslRobot>(setup);
    },
};
