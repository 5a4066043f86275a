// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <sysexits.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <iostream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <regista/device/config.hpp>
#include <thread>

#include "calibrate.hpp"
#include "camera_file.hpp"
#include "overlay.hpp"
#include "publisher.hpp"
#include "source.hpp"

namespace regista::camera {
namespace {

constexpr const char* examples = R"(Examples:
  Once for each lens, then for each place of the camera, then for each hall:
    regista-camera calibrate lens camera.cfg board/*.png --board 9x6 --square 0.03
    regista-camera calibrate field camera.cfg empty_field.png
    regista-camera calibrate colours camera.cfg robots.png
  From then on, in place of SSL-Vision:
    regista-camera run /dev/video0 camera.cfg --interface eth0
  What is seen, as JSON, a picture a line:
    regista-camera detect pictures/ camera.cfg
  A run in one picture:
    regista-camera overlay run.mp4 camera.cfg --every 0.5 --output run.png

docs/camera.md explains each step.)";

volatile std::sig_atomic_t interrupted = 0;

struct RunArguments {
  std::string source;
  std::filesystem::path file;
  SourceOptions options;
  ssl::Group group = ssl::vision_group;
  std::vector<std::string> interfaces;
  bool json = false;
};

struct OverlayArguments {
  std::string source;
  std::filesystem::path file;
  std::filesystem::path output;
  double every_s = 0.5;
  double rate_hz = 0;
};

CameraFile read_calibrated(const std::filesystem::path& file) {
  CameraFile camera = read_camera_file(file);
  if (camera.camera.focal_px <= 0 || !camera.has_pose) {
    throw ConfigError{{.file = file.string()},
                      std::string{"the camera is not calibrated: run 'regista-camera calibrate "} +
                          (camera.camera.focal_px <= 0 ? "lens'" : "field'")};
  }
  return camera;
}

double unix_seconds() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

nlohmann::json to_json(const ssl::Detection& detection) {
  nlohmann::json robots = nlohmann::json::array();
  for (const ssl::DetectedRobot& robot : detection.robots) {
    robots.push_back({{"team", robot.id.team == ssl::Team::yellow ? "yellow" : "blue"},
                      {"id", robot.id.number},
                      {"x", robot.x_m},
                      {"y", robot.y_m},
                      {"heading", *robot.heading_rad},
                      {"confidence", robot.confidence},
                      {"pixel", {robot.pixel_x, robot.pixel_y}}});
  }
  nlohmann::json balls = nlohmann::json::array();
  for (const ssl::DetectedBall& ball : detection.balls)
    balls.push_back(
        {{"x", ball.x_m}, {"y", ball.y_m}, {"pixel", {ball.pixel_x, ball.pixel_y}}, {"area", ball.area_px}});
  return {{"camera", detection.camera},
          {"frame", detection.frame_number},
          {"t_capture", detection.t_capture_s},
          {"robots", robots},
          {"balls", balls}};
}

void detect_in(Detector& detector, const cv::Mat& picture, ssl::Detection& out) {
  if (const Result<> result = detector.detect(view(picture), out); !result)
    throw std::runtime_error{result.error().what};
}

/// Sends what is seen, in the source's own time; or only prints it, as fast as it can.
void run(const RunArguments& arguments, bool publish) {
  const CameraFile camera = read_calibrated(arguments.file);
  Source source{arguments.source, arguments.options};
  Detector detector{camera.camera, camera.detector};
  std::optional<Publisher> publisher;
  if (publish) {
    const auto interfaces = arguments.interfaces.empty() ? ssl::multicast_interfaces() : arguments.interfaces;
    if (interfaces.empty())
      throw std::runtime_error{"no network interface is up and can multicast: name one, such as --interface lo"};
    ssl::Geometry geometry = camera.field;
    geometry.cameras = {camera.camera};
    publisher.emplace(arguments.group, interfaces, geometry);
  }
  ssl::Detection seen{.camera = camera.camera.camera};
  const Time start = Clock::now();
  const Duration period = source.is_device() ? Duration{} : from_seconds(1 / source.rate_hz());
  while (interrupted == 0) {
    const auto picture = source.next();
    if (!picture) break;
    if (publish && !source.is_device()) std::this_thread::sleep_until(start + seen.frame_number * period);
    seen.t_capture_s = unix_seconds();
    detect_in(detector, *picture, seen);
    seen.t_sent_s = unix_seconds();
    if (publisher) publisher->send(seen, Clock::now());
    if (!publish || arguments.json) std::cout << to_json(seen).dump() << '\n' << std::flush;
    ++seen.frame_number;
  }
  std::cerr << fmt::format("{} pictures, {:.1f} a second\n", seen.frame_number,
                           seen.frame_number / std::max(seconds(Clock::now() - start), 1e-9));
  if (publisher && publisher->lost() > 0) std::cerr << publisher->lost() << " packets were not sent\n";
}

void run(const OverlayArguments& arguments) {
  const CameraFile camera = read_calibrated(arguments.file);
  Source source{arguments.source, {.rate_hz = arguments.rate_hz}};
  if (source.is_device()) throw std::runtime_error{"an overlay is made of a film or a folder, not of a running camera"};
  Detector detector{camera.camera, camera.detector};
  Overlay overlay;
  ssl::Detection seen;
  double next_s = 0;
  for (std::uint32_t frame = 0; interrupted == 0; ++frame) {
    const auto picture = source.next();
    if (!picture) break;
    detect_in(detector, *picture, seen);
    overlay.add_robots(seen.robots);
    if (frame / source.rate_hz() < next_s - 1e-9) continue;
    next_s += arguments.every_s;
    overlay.add_picture(*picture);
  }
  if (!cv::imwrite(arguments.output.string(), overlay.compose()))
    throw std::runtime_error{"cannot write '" + arguments.output.string() + "'"};
}

/// "9x6"
void parse_board(const std::string& text, CalibrateLens& arguments) {
  char rest = 0;
  if (std::sscanf(text.c_str(), "%dx%d%c", &arguments.columns, &arguments.rows, &rest) != 2 ||  // NOLINT(cert-err34-c)
      arguments.columns < 3 || arguments.rows < 3 || arguments.columns > 100 || arguments.rows > 100)
    throw CLI::ValidationError{"--board", "must be inner corners across and down, such as 9x6, each at least 3"};
}

int main_of(int argc, char** argv) {
  CLI::App app{
      "Find the robots and the ball of RoboCup's Small Size League in a camera's pictures, and tell as SSL-Vision "
      "does.",
      "regista-camera"};
  app.footer(examples);
  app.set_version_flag("--version", "regista-camera " REGISTA_VERSION);
  app.require_subcommand(1);

  RunArguments running;
  const auto add_source = [](CLI::App* command, std::string& source, std::filesystem::path& file) {
    command->add_option("source", source, "A camera (/dev/video0), a film, a folder of pictures, or one picture")
        ->required();
    command->add_option("camera", file, "The camera's calibration")->required();
  };
  CLI::App* run_command = app.add_subcommand("run", "Send what is seen by multicast");
  CLI::App* detect_command = app.add_subcommand("detect", "Print what is seen, as JSON, a picture a line");
  for (CLI::App* command : {run_command, detect_command}) {
    add_source(command, running.source, running.file);
    command->add_option("--rate", running.options.rate_hz, "Pictures a second; of a camera: what to ask it for")
        ->check(CLI::Range(0.1, 1000.0));
    command->add_option("--width", running.options.width_px, "What to ask a camera for [px]")
        ->check(CLI::Range(16, 16384));
    command->add_option("--height", running.options.height_px, "What to ask a camera for [px]")
        ->check(CLI::Range(16, 16384));
  }
  run_command
      ->add_option("--interface", running.interfaces,
                   "Network interfaces to send out of, such as eth0 or lo (all but lo)")
      ->allow_extra_args(false);
  run_command->add_option("--group", running.group.address, "Multicast group")->capture_default_str();
  run_command->add_option("--port", running.group.port, "UDP port")->capture_default_str();
  run_command->add_flag("--json", running.json, "Print it, too");

  CLI::App* calibrate = app.add_subcommand("calibrate", "Learn the lens, the place and the colours of a camera");
  calibrate->require_subcommand(1);
  CalibrateLens lens;
  std::string board = "9x6";
  CLI::App* lens_command = calibrate->add_subcommand("lens", "From pictures of a checkerboard, tilted differently");
  lens_command->add_option("camera", lens.file, "The calibration, to be written")->required();
  lens_command->add_option("pictures", lens.pictures, "Pictures, or folders of them")->required();
  lens_command->add_option("--board", board, "Inner corners across and down")->capture_default_str();
  lens_command->add_option("--square", lens.square_m, "Side of a square [m]")
      ->required()
      ->check(CLI::Range(0.001, 1.0));
  CalibrateField field;
  CLI::App* field_command =
      calibrate->add_subcommand("field", "Where the camera is, from a picture of the field's lines");
  field_command->add_option("camera", field.file, "The calibration, with the lens")
      ->required()
      ->check(CLI::ExistingFile);
  field_command->add_option("picture", field.picture, "A picture, or a camera")->required();
  field_command->add_option("--division", field.division, "Size of the field: A or B, instead of the calibration's")
      ->check(CLI::IsMember({"A", "B"}));
  field_command->add_option("--points", field.points,
                            "Lines of x y [m] and pixel x y, instead of a window to point at them");
  CalibrateColours colours;
  CLI::App* colours_command =
      calibrate->add_subcommand("colours", "What the colours look like, from a picture of robots and ball");
  colours_command->add_option("camera", colours.file, "The calibration")->required();
  colours_command->add_option("picture", colours.picture, "A picture, or a camera")->required();
  colours_command->add_option("--samples", colours.samples,
                              "Lines of colour, pixel x y, and radius [px], instead of a window to point at them");

  OverlayArguments overlay;
  CLI::App* overlay_command = app.add_subcommand("overlay", "Draw a whole run in one picture");
  add_source(overlay_command, overlay.source, overlay.file);
  overlay_command->add_option("--output", overlay.output, "The picture, to be written")->required();
  overlay_command->add_option("--every", overlay.every_s, "Show the robots each so many seconds")
      ->capture_default_str()
      ->check(CLI::Range(0.01, 1000.0));
  overlay_command->add_option("--rate", overlay.rate_hz, "Pictures a second of a folder")
      ->check(CLI::Range(0.1, 1000.0));

  try {
    app.parse(argc, argv);
    if (*lens_command) parse_board(board, lens);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? EX_OK : EX_USAGE;
  }
  for (const int number : {SIGINT, SIGTERM}) std::signal(number, [](int) { interrupted = 1; });
  if (*run_command || *detect_command) run(running, run_command->parsed());
  if (*lens_command) run(lens, std::cout);
  if (*field_command) run(field, std::cout);
  if (*colours_command) run(colours, std::cout);
  if (*overlay_command) run(overlay);
  return EX_OK;
}

}  // namespace
}  // namespace regista::camera

int main(int argc, char** argv) {
  try {
    return regista::camera::main_of(argc, argv);
  } catch (const regista::ConfigError& error) {
    std::cerr << error.what() << '\n';
    return EX_CONFIG;
  } catch (const std::system_error& error) {
    std::cerr << "regista-camera: " << error.what() << '\n';
    return EX_OSERR;
  } catch (const std::exception& error) {
    std::cerr << "regista-camera: " << error.what() << '\n';
    return EX_DATAERR;
  }
}
