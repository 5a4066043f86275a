// SPDX-License-Identifier: Apache-2.0
// A simulated robot at the far end of a serial cable: the reference firmware of the motor board behind a
// pseudo-terminal, in real time.
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>  // NOLINT(modernize-deprecated-headers): POSIX' pseudo-terminals
#include <termios.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <regista/sim/motor_board.hpp>
#include <string>
#include <system_error>

namespace {

using namespace regista;
using namespace std::chrono_literals;

/// Both ends of a pseudo-terminal. The near one stays open too, so that the far one outlives whoever uses it.
class Terminal {
 public:
  Terminal() : board_{::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)} {
    std::array<char, 128> name{};
    if (board_ < 0 || ::grantpt(board_) != 0 || ::unlockpt(board_) != 0 ||
        ::ptsname_r(board_, name.data(), name.size()) != 0) {
      throw std::system_error{errno, std::generic_category(), "open a pseudo-terminal"};
    }
    path_ = name.data();
    computer_ = ::open(path_.c_str(), O_RDWR | O_NOCTTY);
    termios settings{};
    if (computer_ < 0 || ::tcgetattr(computer_, &settings) != 0) {
      throw std::system_error{errno, std::generic_category(), "open " + path_};
    }
    ::cfmakeraw(&settings);
    (void)::tcsetattr(computer_, TCSANOW, &settings);
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;
  ~Terminal() {
    ::close(computer_);
    ::close(board_);
  }

  [[nodiscard]] const std::string& path() const { return path_; }

  /// Carry bytes both ways, waiting for the computer's up to a millisecond.
  void exchange(sim::MotorBoard& board) const {
    pollfd ready{.fd = board_, .events = POLLIN, .revents = 0};
    std::array<std::uint8_t, 4096> bytes{};
    if (::poll(&ready, 1, 1) > 0) {
      const ssize_t count = ::read(board_, bytes.data(), bytes.size());
      if (count > 0) board.receive(std::span{bytes}.first(static_cast<std::size_t>(count)));
    }
    const std::size_t count = board.transmit(bytes);
    // Nobody may be there to take it; then it is lost, as on a cable.
    if (count > 0 && ::write(board_, bytes.data(), count) < 0 && errno == EAGAIN) (void)::tcflush(computer_, TCIFLUSH);
  }

 private:
  int board_;
  int computer_ = -1;
  std::string path_;
};

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
  app.add_option("--seed", seed, "Chance starts here")->capture_default_str();
  app.add_flag("--used", used, "Wheels off their centre, gears of unequal friction");
  CLI11_PARSE(app, argc, argv);

  try {
    sim::MotorBoardParameters parameters;
    if (used) parameters.robot = sim::used_ssl_robot(2 * seed);
    parameters.robot.seed = 2 * seed;
    parameters.imu.seed = 2 * seed + 1;
    sim::MotorBoard board{parameters};
    const Terminal terminal;
    if (!link.empty()) {
      if (std::filesystem::is_symlink(link)) std::filesystem::remove(link);
      std::filesystem::create_symlink(terminal.path(), link);
    }
    std::printf("%s\n", terminal.path().c_str());
    (void)std::fflush(stdout);
    const Duration period = report_hz > 0 ? from_seconds(1 / report_hz) : Duration::max();
    Time now = Clock::now();
    Duration unreported{};
    for (;;) {
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
