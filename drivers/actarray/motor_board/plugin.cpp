// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "motor_board.hpp"

extern "C" const regista::Plugin regista_plugin{
    .name = "motor_board",
    .summary = "A motor board with up to four wheels, each by itself",
    .rate_hz = 100,
    .stops_by_itself = true,  // the board's watchdog
    .create = [](regista::Setup& setup) -> std::unique_ptr<regista::Driver> {
      return std::make_unique<regista::MotorBoardDriver>(setup);
    },
};
