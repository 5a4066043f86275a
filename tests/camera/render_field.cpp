// SPDX-License-Identifier: Apache-2.0
// render_field FOLDER: what somebody who sets up a camera has, rendered, for test_camera.py. Boards, a picture of the
// empty field with its points, one of robots with samples of their colours, and a run of two robots and the ball,
// with the truth.
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "rendered_field.hpp"

namespace {

namespace fs = std::filesystem;
using namespace regista;
using namespace regista::camera;

constexpr int run_pictures = 60;
constexpr double rate_hz = 30;

void write(const fs::path& file, const cv::Mat& picture) {
  if (!cv::imwrite(file.string(), picture)) throw std::runtime_error{"cannot write " + file.string()};
}

void write_samples(const fs::path& file, const rendered::Camera& camera, const std::vector<rendered::Robot>& robots,
                   const rendered::Ball& ball) {
  std::ofstream out{file};
  const auto sample = [&](const char* colour, double x, double y, double z, double radius_px) {
    const cv::Point2d pixel = camera.see({x, y, z});
    out << colour << ' ' << pixel.x << ' ' << pixel.y << ' ' << radius_px << '\n';
  };
  for (const rendered::Robot& robot : robots) {
    sample(robot.id.team == ssl::Team::yellow ? "yellow" : "blue", robot.pose.x, robot.pose.y, 0.15, 2);
    for (std::size_t i = 0; i < dots.size(); ++i) {
      const double c = std::cos(robot.pose.heading);
      const double s = std::sin(robot.pose.heading);
      const bool is_green = (green_dots[robot.id.number] >> i & 1) != 0;
      sample(is_green ? "green" : "magenta", robot.pose.x + c * dots[i].x - s * dots[i].y,
             robot.pose.y + s * dots[i].x + c * dots[i].y, 0.15, 1.5);
    }
    sample("field", robot.pose.x + 0.3, robot.pose.y + 0.2, 0, 3);
  }
  sample("orange", ball.x, ball.y, ball_radius_m, 1.5);
  sample("white", 0, 1.2, 0, 1);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const fs::path folder = argv[1];
  fs::create_directories(folder / "boards");
  fs::create_directories(folder / "run");
  const auto camera = rendered::Camera::above(0.1, 0.05, 4);
  const rendered::Look look{.gradient = 0.35, .cast = {0.85, 1, 1.05}, .noise = 4};
  for (int i = 0; i < rendered::boards; ++i)
    write(folder / "boards" / (std::to_string(i) + ".png"), rendered::render_board(camera, i));
  write(folder / "field.png", render(camera, {}, {}, look));
  std::ofstream points{folder / "points.txt"};
  for (const cv::Point2d& p : rendered::landmarks) {
    const cv::Point2d pixel = camera.see({p.x, p.y, 0});
    if (!cv::Rect2d{{}, cv::Size2d{camera.size}}.contains(pixel)) continue;
    // As somebody points at it, to a quarter of a pixel.
    points << p.x << ' ' << p.y << ' ' << std::round(4 * pixel.x) / 4 << ' ' << std::round(4 * pixel.y) / 4 << '\n';
  }
  std::vector<rendered::Robot> robots;
  for (int i = 0; i < 8; ++i) {
    robots.push_back({.id = {i % 2 == 0 ? ssl::Team::yellow : ssl::Team::blue, static_cast<std::uint8_t>(i)},
                      .pose = {-2 + 0.5 * i, i % 3 - 1.0, 0.7 * i}});
  }
  const rendered::Ball ball{0.25, 0.25};
  write(folder / "robots.png", render(camera, robots, {ball}, look));
  write_samples(folder / "samples.txt", camera, robots, ball);
  std::ofstream truth{folder / "truth.txt"};
  for (int i = 0; i < run_pictures; ++i) {
    const double t = i / rate_hz;
    const double a = 1.5 * t;
    const std::vector<rendered::Robot> two{
        {.id = {ssl::Team::yellow, 3}, .pose = {std::cos(a), std::sin(a), a + rendered::pi / 2}},
        {.id = {ssl::Team::blue, 12}, .pose = {-1.5, -1.2, 0.5}}};
    write(
        folder / "run" / (std::to_string(1000 + i) + ".png"),
        render(camera, two, {{1.5 - 0.8 * t, -0.3 + 0.5 * t}},
               {.gradient = look.gradient, .cast = look.cast, .noise = look.noise, .seed = static_cast<unsigned>(i)}));
    for (const rendered::Robot& robot : two) {
      truth << i << ' ' << to_string(robot.id) << ' ' << robot.pose.x << ' ' << robot.pose.y << ' '
            << wrap_angle(robot.pose.heading) << '\n';
    }
  }
}
