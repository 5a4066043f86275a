// SPDX-License-Identifier: Apache-2.0
// A simulated field of the Small Size League: robots behind pseudo-terminals, each with the reference firmware of the
// motor board, a ball, and cameras that multicast what they see. In real time.
#include <CLI/CLI.hpp>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <list>
#include <map>
#include <numbers>
#include <regista/sim/field.hpp>
#include <regista/sim/vision.hpp>
#include <regista/ssl/multicast.hpp>
#include <regista/ssl/vision.hpp>
#include <string>

#include "command_line.hpp"
#include "terminal.hpp"

namespace {

using namespace regista;
using namespace std::chrono_literals;

struct Options {
  std::string links;
  int yellow = 6;
  int blue = 6;
  std::string interface = "lo";
  std::uint16_t port = ssl::simulated_vision_group.port;
  int cameras = 1;
  double rate_hz = 75;
  double delay_s = 0.03;
  double hidden_s = 0.02;
  double lose_robots = 0.02;
  double lose_balls = 0.05;
  double disagree_m = 0;
  double flip = 0;
  double mirror = 0;
  double report_hz = 0;
  std::uint64_t seed = 1;
  bool used = false;
};

/// The cameras are: SIGUSR1 covers them, SIGUSR2 uncovers them.
volatile std::sig_atomic_t covered = 0;

constexpr double overlap_m = 0.3;  // that both of two neighbours see
constexpr Duration geometry_period = 3s;

/// Cameras over the field, which see all robots and the ball at the same times and tell it as SSL-Vision does.
class Cameras {
 public:
  Cameras(const Options& options, const sim::FieldParameters& field)
      : options_{options},
        field_{field},
        random_{options.seed},
        sender_{{ssl::simulated_vision_group.address, options.port}, options.interface} {}

  void watch(ssl::RobotId id) { robots_.emplace_back(id, sim::Vision{parameters(options_.lose_robots)}); }

  void step(const sim::Field& field, Duration dt) {
    now_ += dt;
    std::map<std::pair<Duration, int>, ssl::Detection> frames;  // the oldest first
    const auto frame_of = [&](const sim::Detection& seen) -> ssl::Detection& {
      ssl::Detection& frame = frames[{-seen.age, seen.camera}];
      frame.t_sent_s = seconds(now_);
      frame.t_capture_s = seconds(now_ - seen.age) + options_.hidden_s;
      return frame;
    };
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      auto& [id, vision] = robots_[i];
      for (const sim::Detection& seen : vision.step(field.pose(i), dt)) {
        frame_of(seen).robots.push_back(
            {.id = id, .x_m = seen.pose.x, .y_m = seen.pose.y, .heading_rad = seen.pose.heading});
      }
    }
    for (const sim::Detection& seen : ball_.step({.x = field.ball().x_m(), .y = field.ball().y_m()}, dt)) {
      frame_of(seen).balls.push_back({.x_m = seen.pose.x, .y_m = seen.pose.y});
    }
    if (covered != 0) return;
    for (auto& [exposure, frame] : frames) send(exposure.second, frame);
    if (now_ >= geometry_due_) {
      geometry_due_ = now_ + geometry_period;
      ssl::Geometry geometry{.length_m = field_.length_m, .width_m = field_.width_m, .boundary_m = field_.boundary_m};
      for (int i = 0; i < options_.cameras; ++i) geometry.cameras.push_back(calibration(i));
      (void)sender_.send(ssl::encode({.detection = {}, .geometry = geometry}));
    }
  }

 private:
  [[nodiscard]] sim::VisionParameters parameters(double loss) {
    sim::VisionParameters vision{
        .period_s = 1 / options_.rate_hz, .loss = loss, .delay_s = options_.delay_s, .flip = options_.flip};
    vision.seed = random_.fork();
    if (options_.cameras == 1) return vision;
    vision.cameras.clear();
    for (int i = 0; i < 4; ++i) {
      const bool right = i % 2 == 1;
      const bool upper = i / 2 == 1;
      // Each is off its own way; next neighbours disagree by `disagree_m`.
      const double off = (right != upper ? 0.5 : -0.5) * options_.disagree_m;
      vision.cameras.push_back({.min_x_m = right ? -overlap_m / 2 : -10,
                                .max_x_m = right ? 10 : overlap_m / 2,
                                .min_y_m = upper ? -overlap_m / 2 : -10,
                                .max_y_m = upper ? 10 : overlap_m / 2,
                                .offset = {.x = off}});
    }
    return vision;
  }

  /// Looking straight down on the middle of its part of the field.
  [[nodiscard]] ssl::CameraCalibration calibration(int camera) const {
    const bool whole = options_.cameras == 1;
    const double x_m = whole ? 0 : (camera % 2 == 1 ? 0.25 : -0.25) * field_.length_m;
    const double y_m = whole ? 0 : (camera / 2 == 1 ? 0.25 : -0.25) * field_.width_m;
    return {.camera = static_cast<std::uint32_t>(camera),
            .focal_px = 390,
            .principal_x_px = 390,
            .principal_y_px = 290,
            .rotation = {1, 0, 0, 0},  // half a turn about x
            .translation = {.x = -x_m, .y = y_m, .z = 4},
            .width_px = 780,
            .height_px = 580};
  }

  void send(int camera, ssl::Detection& frame) {
    frame.camera = static_cast<std::uint32_t>(camera);
    frame.frame_number = ++numbers_[camera];
    if (random_.chance(options_.mirror)) {  // the whole field, turned by 180°
      for (ssl::DetectedRobot& robot : frame.robots) {
        robot.x_m = -robot.x_m;
        robot.y_m = -robot.y_m;
        robot.heading_rad = wrap_angle(*robot.heading_rad + std::numbers::pi);
      }
      for (ssl::DetectedBall& ball : frame.balls) {
        ball.x_m = -ball.x_m;
        ball.y_m = -ball.y_m;
      }
    }
    (void)sender_.send(ssl::encode({.detection = frame, .geometry = {}}));
  }

  const Options& options_;
  sim::FieldParameters field_;
  sim::Random random_;
  ssl::MulticastSender sender_;
  std::vector<std::pair<ssl::RobotId, sim::Vision>> robots_;
  sim::Vision ball_{parameters(options_.lose_balls)};
  std::map<int, std::uint32_t> numbers_;
  Duration now_{};
  Duration geometry_due_{};
};

/// One line of JSON: the truth.
void report(const sim::Field& field, const std::vector<std::string>& names) {
  std::printf("{\"t\": %.6f, \"ball\": [%.4f, %.4f], \"collisions\": %llu", seconds(Clock::now().time_since_epoch()),
              field.ball().x_m(), field.ball().y_m(), static_cast<unsigned long long>(field.collisions()));
  for (std::size_t i = 0; i < names.size(); ++i) {
    const Pose2d& pose = field.pose(i);
    std::printf(", \"%s\": [%.5f, %.5f, %.5f]", names[i].c_str(), pose.x, pose.y, pose.heading);
  }
  std::printf("}\n");
  (void)std::fflush(stdout);
}

int play(const Options& options) {
  const sim::FieldParameters parameters;
  sim::Field field{parameters};
  Cameras cameras{options, parameters};
  std::list<programs::Terminal> terminals;
  std::vector<std::string> names;
  std::filesystem::create_directories(options.links);
  const auto add = [&](ssl::Team team, int count) {
    const bool yellow = team == ssl::Team::yellow;
    for (int i = 0; i < count; ++i) {
      const std::uint64_t seed = options.seed + 2 * names.size();
      sim::MotorBoardParameters board;
      if (options.used) board.robot = sim::used_ssl_robot(seed);
      board.robot.seed = seed;
      board.imu.seed = seed + 1;
      (void)field.add(
          board,
          {.x = yellow ? -1.5 : 1.5, .y = 0.6 * (i - (count - 1) / 2.0), .heading = yellow ? 0 : std::numbers::pi});
      cameras.watch({team, static_cast<std::uint8_t>(i)});
      names.push_back((yellow ? "yellow" : "blue") + std::to_string(i));
      terminals.emplace_back().link(std::filesystem::path{options.links} / names.back());
    }
  };
  add(ssl::Team::yellow, options.yellow);
  add(ssl::Team::blue, options.blue);
  for (const int number : {SIGUSR1, SIGUSR2}) (void)std::signal(number, [](int n) { covered = n == SIGUSR1 ? 1 : 0; });
  std::cout << "regista-field-sim: ready\n" << std::flush;

  const Duration period = options.report_hz > 0 ? from_seconds(1 / options.report_hz) : Duration::max();
  Time now = Clock::now();
  Duration unreported{};
  for (;;) {
    programs::wait(terminals, 1);
    std::size_t number = 0;
    for (const programs::Terminal& terminal : terminals) terminal.exchange(field.board(number++));
    const Time before = std::exchange(now, Clock::now());
    // On a machine too busy for that, time passes slower here; the boards' watchdogs (50 ms) would bite else.
    const Duration dt = std::min<Duration>(now - before, 40ms);
    field.step(dt);
    cameras.step(field, dt);
    unreported += now - before;
    if (unreported < period) continue;
    unreported = {};
    report(field, names);
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "A simulated field of the Small Size League. Each robot is a motor board at a pseudo-terminal, FOLDER/yellow0 "
      "and "
      "so on: the `port` of an ssl_robot. The cameras multicast what they see as SSL-Vision does; "
      "SIGUSR1 covers them, SIGUSR2 uncovers them.",
      "regista-field-sim"};
  Options options;
  const CLI::Range probability{0.0, 1.0};
  app.set_version_flag("--version", REGISTA_VERSION);
  app.add_option("folder", options.links, "For symbolic links to the boards; those that are there are replaced")
      ->required();
  app.add_option("--yellow", options.yellow, "Robots of this team")->check(CLI::Range(0, 16))->capture_default_str();
  app.add_option("--blue", options.blue, "And of this")->check(CLI::Range(0, 16))->capture_default_str();
  app.add_option("--interface", options.interface, "Network interface to send out of")->capture_default_str();
  app.add_option("--port", options.port, "UDP port of vision, at 224.5.23.2")->capture_default_str();
  app.add_option("--cameras", options.cameras, "1, or 4 over the quarters")
      ->check(CLI::IsMember({1, 4}))
      ->capture_default_str();
  app.add_option("--rate", options.rate_hz, "Frames a second")->check(CLI::Range(1.0, 200.0))->capture_default_str();
  app.add_option("--delay", options.delay_s, "From the light to the packet [s] …")
      ->check(CLI::Range(0.0, 0.5))
      ->capture_default_str();
  app.add_option("--hidden", options.hidden_s, "… of which no timestamp shows so much [s]")
      ->check(CLI::Range(0.0, 0.5))
      ->capture_default_str();
  app.add_option("--lose-robots", options.lose_robots, "Share of frames that miss a robot")
      ->check(probability)
      ->capture_default_str();
  app.add_option("--lose-balls", options.lose_balls, "Share of frames that miss the ball")
      ->check(probability)
      ->capture_default_str();
  app.add_option("--disagree", options.disagree_m, "Of neighbouring cameras [m]")->check(CLI::Range(0.0, 0.2));
  app.add_option("--flip", options.flip, "Share of headings that are 90° or 180° off")->check(probability);
  app.add_option("--mirror", options.mirror, "Share of frames that show the field turned by 180°")->check(probability);
  app.add_option("--report", options.report_hz, "Print the truth so often, a line of JSON each [Hz]")
      ->check(CLI::Range(0.0, 1000.0));
  app.add_option("--seed", options.seed, "Chance starts here")->capture_default_str()->check(seeds);
  app.add_flag("--used", options.used, "Wheels off their centre, gears of unequal friction");
  if (const auto done = parse(app, argc, argv)) return *done;
  try {
    return play(options);
  } catch (const std::exception& error) {
    (void)std::fprintf(stderr, "regista-field-sim: %s\n", error.what());
    return 1;
  }
}
