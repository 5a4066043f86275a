// SPDX-License-Identifier: Apache-2.0
// A simulated robot at the far end of a serial cable: the reference firmware of the motor board behind a
// pseudo-terminal, in real time.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <regista/sim/motor_board.hpp>
#include <string>

#include "command_line.hpp"
#include "terminal.hpp"

namespace {

using namespace regista;
using namespace std::chrono_literals;

/// One line of JSON: the truth.
void report(const sim::MotorBoard& board) {
  const auto& robot = board.robot().state();
  const auto& set = board.firmware().command.wheel_mradps;
  std::printf(
      "{\"t\": %.6f, \"x\": %.6f, \"y\": %.6f, \"heading\": %.6f, \"set\": [%.3f, %.3f, %.3f, %.3f], "
      "\"turns\": [%.3f, %.3f, %.3f, %.3f], \"timed_out\": %s}\n",
      seconds(Clock::now().time_since_epoch()), robot.pose.x, robot.pose.y, robot.pose.heading, 1e-3 * set[0],
      1e-3 * set[1], 1e-3 * set[2], 1e-3 * set[3], robot.wheels[0].speed_radps, robot.wheels[1].speed_radps,
      robot.wheels[2].speed_radps, robot.wheels[3].speed_radps,
      (board.firmware().telemetry.status & motor_board_timed_out) != 0 ? "true" : "false");
  (void)std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "A simulated soccer robot on a serial cable: speaks the protocol of docs/motor-board.md at a "
      "pseudo-terminal, whose path is the first line that it prints"};
  app.set_version_flag("--version", REGISTA_VERSION);
  std::string link;
  double report_hz = 0;
  std::uint64_t seed = 1;
  bool used = false;
  app.add_option("--link", link, "Make this a symbolic link to the pseudo-terminal; one that is there is replaced");
  app.add_option("--report", report_hz, "Print the truth so often, a line of JSON each [Hz]")
      ->check(CLI::Range(0.0, 1000.0));
  app.add_option("--seed", seed, "Chance starts here")->capture_default_str()->check(seeds);
  app.add_flag("--used", used, "Wheels off their centre, gears of unequal friction");
  if (const auto done = parse(app, argc, argv)) return *done;

  try {
    sim::MotorBoardParameters parameters;
    if (used) parameters.robot = sim::used_ssl_robot(2 * seed);
    parameters.robot.seed = 2 * seed;
    parameters.imu.seed = 2 * seed + 1;
    sim::MotorBoard board{parameters};
    const programs::Terminal terminal;
    if (!link.empty()) terminal.link(link);
    std::printf("%s\n", terminal.path().c_str());
    (void)std::fflush(stdout);
    const Duration period = report_hz > 0 ? from_seconds(1 / report_hz) : Duration::max();
    Time now = Clock::now();
    Duration unreported{};
    for (;;) {
      programs::wait(std::span{&terminal, 1}, 1);
      terminal.exchange(board);
      const Time before = std::exchange(now, Clock::now());
      board.step(std::min<Duration>(now - before, 1s));  // after a sleep of the machine it does not catch up
      unreported += now - before;
      if (unreported < period) continue;
      unreported = {};
      report(board);
    }
  } catch (const std::exception& error) {
    (void)std::fprintf(stderr, "regista-motor-board-sim: %s\n", error.what());
    return 1;
  }
}
