// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>
#include <regista/camera/detector.hpp>
#include <regista/camera/projection.hpp>
#include <utility>

#include "blobs.hpp"

namespace regista::camera {

namespace {

/// How much of what a disc should cover a blob may cover: some of a disc is lost in shade, and motion blurs.
constexpr double least_share = 0.3;
constexpr double most_share = 2.5;
constexpr int least_px = 4;
/// How far a dot may be from where the pattern has it. [m]
constexpr double dot_tolerance_m = 0.012;
/// Root of the mean square of these distances, over the five discs. [m]
constexpr double fit_tolerance_m = 0.008;
/// Within this distance of a robot's middle there is neither another nor a ball. [m]
constexpr double robot_m = 0.07;

/// A blob, and where it is on the field if it is a disc of its colour.
struct Disc {
  Colour colour = Colour::none;
  Pixel pixel{};
  double x_m = 0;
  double y_m = 0;
  int area_px = 0;
};

struct Fit {
  double x_m = 0;
  double y_m = 0;
  double heading_rad = 0;
  double error_m = 0;  ///< root mean square
};

/// A centroid finer than pixels: each weighs by the part of it that the disc covers, which its likeness to the disc's
/// core tells. Greys weigh nothing, so the light on the black top does not matter; the carpet beside a green dot does.
Pixel centroid(const Image& image, const Blob& blob, const LightMap& light, const ColourTable& table) {
  const auto chroma = [](const std::uint8_t* p) {
    const int grey = std::min({p[0], p[1], p[2]});
    return std::array<int, 3>{p[0] - grey, p[1] - grey, p[2] - grey};
  };
  std::array<double, 3> core{};
  for (int y = blob.top; y <= blob.bottom; ++y) {
    for (int x = blob.left; x <= blob.right; ++x) {
      const std::uint8_t* pixel = image.at(x, y);
      if (table(pixel, light.table(x, y)) != blob.colour) continue;
      const auto c = chroma(pixel);
      for (std::size_t i = 0; i < 3; ++i) core[i] += c[i];
    }
  }
  const double square = core[0] * core[0] + core[1] * core[1] + core[2] * core[2];
  const double nothing = blob.colour == Colour::green ? 0.5 : 0.2;
  // An ellipse around the blob, wider by so much. [px]
  constexpr double margin = 1.2;
  const Pixel middle{.x = (blob.left + blob.right) / 2.0, .y = (blob.top + blob.bottom) / 2.0};
  const double half_width = (blob.right - blob.left + 1) / 2.0 + margin;
  const double half_height = (blob.bottom - blob.top + 1) / 2.0 + margin;
  double sum = 0;
  double sum_x = 0;
  double sum_y = 0;
  for (int y = std::max(blob.top - 2, 0); y <= std::min(blob.bottom + 2, image.height - 1); ++y) {
    for (int x = std::max(blob.left - 2, 0); x <= std::min(blob.right + 2, image.width - 1); ++x) {
      if (std::hypot((x - middle.x) / half_width, (y - middle.y) / half_height) > 1) continue;
      const auto c = chroma(image.at(x, y));
      const double likeness = (core[0] * c[0] + core[1] * c[1] + core[2] * c[2]) * blob.area_px / square;
      const double weight = std::max(likeness - nothing, 0.0);
      sum += weight;
      sum_x += weight * x;
      sum_y += weight * y;
    }
  }
  return sum > 0 ? Pixel{.x = sum_x / sum, .y = sum_y / sum} : middle;
}

/// [m²] of a level plane that one pixel there covers; none where the plane is not seen.
std::optional<double> pixel_area(const ssl::CameraCalibration& camera, const Pixel& at, double height_m) {
  const auto here = to_field(camera, at, height_m);
  const auto right = to_field(camera, {.x = at.x + 1, .y = at.y}, height_m);
  const auto below = to_field(camera, {.x = at.x, .y = at.y + 1}, height_m);
  if (!here || !right || !below) return {};
  return std::abs((right->x - here->x) * (below->y - here->y) - (right->y - here->y) * (below->x - here->x));
}

/// The pose of the pattern that is nearest to five discs, by least squares. Each disc counts by its area, to which the
/// variance of its centroid is reciprocal. `around` as in `dots`.
Fit fit_pattern(const Disc& centre, const std::array<const Disc*, 4>& around) {
  constexpr double centre_weight = centre_radius_m * centre_radius_m / (dot_radius_m * dot_radius_m);
  constexpr double all = centre_weight + dots.size();
  double seen_x = centre_weight * centre.x_m / all;
  double seen_y = centre_weight * centre.y_m / all;
  double drawn_x = 0;
  double drawn_y = 0;
  for (std::size_t i = 0; i < dots.size(); ++i) {
    seen_x += around[i]->x_m / all;
    seen_y += around[i]->y_m / all;
    drawn_x += dots[i].x / all;
    drawn_y += dots[i].y / all;
  }
  double sine = 0;
  double cosine = 0;
  const auto add = [&](double weight, const Dot& drawn, const Disc& seen) {
    const double px = drawn.x - drawn_x;
    const double py = drawn.y - drawn_y;
    const double qx = seen.x_m - seen_x;
    const double qy = seen.y_m - seen_y;
    sine += weight * (px * qy - py * qx);
    cosine += weight * (px * qx + py * qy);
  };
  add(centre_weight, {}, centre);
  for (std::size_t i = 0; i < dots.size(); ++i) add(1, dots[i], *around[i]);
  Fit fit{.heading_rad = std::atan2(sine, cosine)};
  const double c = std::cos(fit.heading_rad);
  const double s = std::sin(fit.heading_rad);
  fit.x_m = seen_x - (c * drawn_x - s * drawn_y);
  fit.y_m = seen_y - (s * drawn_x + c * drawn_y);
  const auto square = [&](const Dot& drawn, const Disc& seen) {
    const double x = fit.x_m + c * drawn.x - s * drawn.y - seen.x_m;
    const double y = fit.y_m + s * drawn.x + c * drawn.y - seen.y_m;
    return x * x + y * y;
  };
  double squares = centre_weight * square({}, centre);
  for (std::size_t i = 0; i < dots.size(); ++i) squares += square(dots[i], *around[i]);
  fit.error_m = std::sqrt(squares / all);
  return fit;
}

}  // namespace

struct Detector::Impl {
  Impl(const ssl::CameraCalibration& calibration, const DetectorOptions& options)
      : camera{calibration},
        table{options.colours},
        height_m{options.yellow_height_m, options.blue_height_m},
        same_height{options.yellow_height_m == options.blue_height_m} {}

  ssl::CameraCalibration camera;
  ColourTable table;
  LightMap light;
  std::array<double, 2> height_m;  ///< by team
  bool same_height;
  BlobFinder finder;
  // By the colour in the middle; dots are placed once for each team if their patterns are at different heights.
  std::vector<Disc> centres;
  std::vector<Disc> seen_dots;
  std::vector<Disc> balls;

  /// None when the blob is too small or too large to be such a disc.
  std::optional<Disc> place(const Image& image, const Blob& blob, double radius, double height) const {
    const Pixel middle{.x = (blob.left + blob.right) / 2.0, .y = (blob.top + blob.bottom) / 2.0};
    const auto area = pixel_area(camera, middle, height);
    if (!area) return {};
    const double share = blob.area_px * *area / (std::numbers::pi * radius * radius);
    if (share < least_share || share > most_share) return {};
    Disc disc{.colour = blob.colour, .pixel = centroid(image, blob, light, table), .area_px = blob.area_px};
    return put_on_field(disc, height) ? std::optional{disc} : std::nullopt;
  }

  bool put_on_field(Disc& disc, double height) const {
    const auto point = to_field(camera, disc.pixel, height);
    if (!point) return false;
    disc.x_m = point->x;
    disc.y_m = point->y;
    return true;
  }

  void find_robot(Disc centre, ssl::Detection& out) {
    const ssl::Team team = centre.colour == Colour::yellow ? ssl::Team::yellow : ssl::Team::blue;
    const double height = height_m[static_cast<std::size_t>(team)];
    // The dots whose distance is nearest to that of the pattern, by their direction.
    struct Near {
      Disc disc;
      double miss_m = 0;
      double direction = 0;
    };
    std::array<Near, 8> near;
    std::size_t count = 0;
    for (Disc dot : seen_dots) {
      if (!same_height && !put_on_field(dot, height)) continue;
      const double x = dot.x_m - centre.x_m;
      const double y = dot.y_m - centre.y_m;
      const double miss = std::abs(std::hypot(x, y) - dot_distance_m);
      if (miss > dot_tolerance_m || count == near.size()) continue;
      near[count++] = {dot, miss, std::atan2(y, x)};
    }
    if (count < dots.size()) return;
    std::sort(near.begin(), near.begin() + count, [](const Near& a, const Near& b) { return a.miss_m < b.miss_m; });
    std::sort(near.begin(), near.begin() + dots.size(),
              [](const Near& a, const Near& b) { return a.direction < b.direction; });
    Fit best{.error_m = fit_tolerance_m};
    std::optional<std::uint8_t> green;
    for (std::size_t turn = 0; turn < dots.size(); ++turn) {
      std::array<const Disc*, 4> around{};
      std::uint8_t pattern = 0;
      for (std::size_t i = 0; i < dots.size(); ++i) {
        around[i] = &near[(i + turn) % dots.size()].disc;
        if (around[i]->colour == Colour::green) pattern = static_cast<std::uint8_t>(pattern | 1U << i);
      }
      const Fit fit = fit_pattern(centre, around);
      if (fit.error_m >= best.error_m) continue;
      best = fit;
      green = pattern;
    }
    if (!green) return;
    const auto number = std::ranges::find(green_dots, *green) - green_dots.begin();
    const ssl::DetectedRobot robot{.id = {team, static_cast<std::uint8_t>(number)},
                                   .x_m = best.x_m,
                                   .y_m = best.y_m,
                                   .heading_rad = best.heading_rad,
                                   .confidence = 1 - best.error_m / (2 * fit_tolerance_m),
                                   .pixel_x = centre.pixel.x,
                                   .pixel_y = centre.pixel.y,
                                   .height_m = height};
    // Glare can break the disc in the middle, and then there are two for the same dots.
    const auto same = std::ranges::find_if(out.robots, [&](const ssl::DetectedRobot& other) {
      return std::hypot(other.x_m - robot.x_m, other.y_m - robot.y_m) < robot_m;
    });
    if (same == out.robots.end()) {
      out.robots.push_back(robot);
    } else if (same->confidence < robot.confidence) {
      *same = robot;
    }
  }
};

Detector::Detector(const ssl::CameraCalibration& camera, const DetectorOptions& options)
    : impl_{std::make_unique<Impl>(camera, options)} {}
Detector::~Detector() = default;

Result<> Detector::detect(const Image& image, ssl::Detection& out) {
  Impl& self = *impl_;
  out.robots.clear();
  out.balls.clear();
  if (std::cmp_not_equal(image.width, self.camera.width_px) ||
      std::cmp_not_equal(image.height, self.camera.height_px)) {
    return Error{std::errc::invalid_argument,
                 "a picture of " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                     " pixels from a camera calibrated for " + std::to_string(self.camera.width_px) + " x " +
                     std::to_string(self.camera.height_px)};
  }
  self.centres.clear();
  self.seen_dots.clear();
  self.balls.clear();
  self.light.measure(image);
  for (const Blob& blob : self.finder.find(image, self.light, self.table, least_px)) {
    switch (blob.colour) {
      case Colour::orange:
        // The middle of its outline is the middle of the ball, whatever the direction.
        if (const auto ball = self.place(image, blob, ball_radius_m, ball_radius_m)) self.balls.push_back(*ball);
        break;
      case Colour::yellow:
      case Colour::blue:
        if (const auto disc = self.place(image, blob, centre_radius_m, self.height_m[blob.colour == Colour::blue]))
          self.centres.push_back(*disc);
        break;
      default:
        if (const auto disc = self.place(image, blob, dot_radius_m, self.height_m[0])) self.seen_dots.push_back(*disc);
    }
  }
  for (const Disc& centre : self.centres) self.find_robot(centre, out);
  for (const Disc& ball : self.balls) {
    const bool is_of_robot = std::ranges::any_of(out.robots, [&](const ssl::DetectedRobot& robot) {
      const auto there = to_field(self.camera, ball.pixel, robot.height_m);
      return there && std::hypot(robot.x_m - there->x, robot.y_m - there->y) < robot_m;
    });
    if (is_of_robot) continue;
    out.balls.push_back({.x_m = ball.x_m,
                         .y_m = ball.y_m,
                         .pixel_x = ball.pixel.x,
                         .pixel_y = ball.pixel.y,
                         .area_px = static_cast<std::uint32_t>(ball.area_px)});
  }
  return {};
}

}  // namespace regista::camera
