// SPDX-License-Identifier: Apache-2.0
#include <regista/device/plugin.hpp>

#include "simulator_link.hpp"

namespace {

using namespace regista;

/// A robot of the league's simulators, driven by everything that ssl_robot is.
///
/// Beside the keys of ssl_robot, but for `port`, `baud`, `seed` and `imu`, which a simulator has not (`vision_sd` is
/// 0.008 m without being told, `wheels_sd` 0.4 m/s):
///
/// | Key        | Value                                                     | Default                            |
/// |------------|-----------------------------------------------------------|------------------------------------|
/// | `host`     | where the simulator runs                                  | "127.0.0.1"                        |
/// | `protocol` | "league" (ssl-simulation-protocol) or "grsim"             | "league"                           |
/// | `udp_port` | of the simulator                                          | 10301 blue, 10302 yellow; grsim: 20011 |
/// | `team`     | "blue" or "yellow"                                        | must be there                      |
/// | `robot`    | its pattern, 0 to 15                                      | must be there                      |
std::unique_ptr<Driver> create(Setup& setup) {
  const Section& config = setup.config;
  const std::string team = config.text("team");
  if (team != "blue" && team != "yellow") throw config.error("team", R"(must be "blue" or "yellow")");
  const std::string protocol = config.text("protocol", "league");
  if (protocol != "league" && protocol != "grsim") throw config.error("protocol", R"(must be "league" or "grsim")");
  const bool grsim = protocol == "grsim";
  const bool yellow = team == "yellow";
  const std::int64_t usual_port = grsim ? 20011 : yellow ? 10302 : 10301;
  return simulated_robot(
      setup, {.host = config.text("host", "127.0.0.1"),
              .port = static_cast<std::uint16_t>(config.integer("udp_port", usual_port, {.min = 1, .max = 65535})),
              .grsim = grsim,
              .robot = static_cast<std::uint32_t>(config.integer("robot", {.min = 0, .max = 15})),
              .yellow = yellow});
}

}  // namespace

extern "C" const regista::Plugin regista_plugin{.name = "ssl_simulator",
                                                .summary = "A robot of the league's simulators, or of grSim",
                                                .rate_hz = 100,
                                                .create = create};
