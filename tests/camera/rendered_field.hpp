// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <regista/camera/detector.hpp>
#include <regista/core/geometry.hpp>
#include <vector>

/// Draws what a camera sees of a field whose truth is known. Nothing here is ours but the dimensions: OpenCV projects,
/// bends and draws, four times as fine as the picture.
namespace regista::camera::rendered {

inline constexpr double pi = std::numbers::pi;

struct Camera {
  cv::Size size{780, 580};
  double focal_px = 560;
  cv::Point2d principal{395.3, 284.6};
  double distortion = 0.06;  ///< as the league counts
  cv::Vec3d rotation{};      ///< axis times angle
  cv::Vec3d translation{};   ///< [m]

  /// Over (x, y), looking down but for `tilt` about the picture's horizontal [rad], turned by `yaw` [rad].
  static Camera above(double x, double y, double height_m, double tilt = 0.06, double yaw = 0.03) {
    const auto turn = [](double ax, double ay, double az) {
      cv::Matx33d r;
      cv::Rodrigues(cv::Vec3d{ax, ay, az}, r);
      return r;
    };
    const cv::Matx33d r = turn(tilt, 0, 0) * turn(pi, 0, 0) * turn(0, 0, yaw);
    Camera camera;
    cv::Rodrigues(r, camera.rotation);
    camera.translation = -(r * cv::Vec3d{x, y, height_m});
    return camera;
  }

  [[nodiscard]] std::vector<cv::Point2d> see(const std::vector<cv::Point3d>& points) const {
    std::vector<cv::Point2d> straight;
    cv::projectPoints(points, rotation, translation, cv::Matx33d::eye(), cv::noArray(), straight);
    // What OpenCV calls distorting is what the league calls undistorting; and so the other way round.
    std::vector<cv::Point2d> bent;
    cv::undistortPoints(straight, bent, cv::Matx33d::eye(), cv::Vec4d{distortion, 0, 0, 0}, cv::noArray(),
                        cv::noArray(), cv::TermCriteria{cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 200, 1e-13});
    for (cv::Point2d& p : bent) p = p * focal_px + principal;
    return bent;
  }
  [[nodiscard]] cv::Point2d see(const cv::Point3d& point) const { return see(std::vector{point}).front(); }

  [[nodiscard]] ssl::CameraCalibration calibration() const {
    const double angle = cv::norm(rotation);
    const cv::Vec3d q = rotation * (std::sin(angle / 2) / angle);
    return {.camera = 0,
            .focal_px = focal_px,
            .principal_x_px = principal.x,
            .principal_y_px = principal.y,
            .distortion = distortion,
            .rotation = {q[0], q[1], q[2], std::cos(angle / 2)},
            .translation = {.x = translation[0], .y = translation[1], .z = translation[2]},
            .width_px = static_cast<std::uint32_t>(size.width),
            .height_px = static_cast<std::uint32_t>(size.height)};
  }
};

struct Robot {
  ssl::RobotId id;
  Pose2d pose;
  FieldVelocity velocity{};
};

struct Ball {
  double x = 0;
  double y = 0;
  FieldVelocity velocity{};
};

/// Light and camera.
struct Look {
  double gradient = 0;      ///< brightness falls by this share from the left to the right
  cv::Vec3d cast{1, 1, 1};  ///< of the light: blue, green, red
  double noise = 0;         ///< standard deviation of each channel, of 255
  double exposure_s = 0;
  double blur_px = 0.5;  ///< of the lens, standard deviation
  std::uint64_t seed = 1;
};

// Inks, carpets and balls differ; these are not those of usual_colours().
inline const cv::Scalar carpet{48, 98, 38};
inline const cv::Scalar line_white{215, 220, 218};
inline const cv::Scalar top_black{26, 24, 25};
inline const cv::Scalar hull_grey{50, 50, 50};
inline const cv::Scalar orange{35, 105, 230};
inline const cv::Scalar yellow{45, 205, 230};
inline const cv::Scalar blue{200, 95, 35};
inline const cv::Scalar green{80, 215, 90};
inline const cv::Scalar magenta{180, 70, 225};

class Canvas {
 public:
  explicit Canvas(const Camera& camera)
      : camera_{camera}, fine_{camera.size.height * fineness, camera.size.width * fineness, CV_8UC3, cv::Scalar{}} {}

  void fill(const cv::Scalar& colour) { fine_.setTo(colour); }

  void polygon(const std::vector<cv::Point3d>& corners, const cv::Scalar& colour) {
    constexpr int shift = 6;
    std::vector<cv::Point> points;
    for (const cv::Point2d& p : camera_.see(corners)) {
      const auto fixed = [](double v) {
        return static_cast<int>(std::lround(((v + 0.5) * fineness - 0.5) * (1 << shift)));
      };
      points.emplace_back(fixed(p.x), fixed(p.y));
    }
    cv::fillPoly(fine_, std::vector{points}, colour, cv::LINE_8, shift);
  }

  void disc(const cv::Point3d& centre, double radius, const cv::Scalar& colour) {
    std::vector<cv::Point3d> rim;
    for (int i = 0; i < 40; ++i) {
      const double a = 2 * pi * i / 40;
      rim.emplace_back(centre.x + radius * std::cos(a), centre.y + radius * std::sin(a), centre.z);
    }
    polygon(rim, colour);
  }

  /// A stripe on the floor, short pieces after another, as the lens bends it.
  void stripe(cv::Point2d from, cv::Point2d to, double width) {
    constexpr int pieces = 24;
    const cv::Point2d along = (to - from) / pieces;
    const cv::Point2d side = cv::Point2d{-along.y, along.x} * (width / 2 / cv::norm(along));
    for (int i = 0; i < pieces; ++i) {
      const cv::Point2d a = from + along * i;
      const cv::Point2d b = a + along;
      const auto on_floor = [](const cv::Point2d& p) { return cv::Point3d{p.x, p.y, 0}; };
      polygon({on_floor(a - side), on_floor(b - side), on_floor(b + side), on_floor(a + side)}, line_white);
    }
  }

  /// A robot's hull and top, and on it the pattern of figures 5 and 6 of the rules.
  void robot(ssl::RobotId id, const Pose2d& pose, double height) {
    const double c = std::cos(pose.heading);
    const double s = std::sin(pose.heading);
    const auto at = [&](double x, double y, double z) {
      return cv::Point3d{pose.x + c * x - s * y, pose.y + s * x + c * y, z};
    };
    std::vector<cv::Point3d> top;
    std::vector<cv::Point3d> bottom;
    const double half_front = std::acos(0.055 / 0.088);
    for (int i = 0; i <= 48; ++i) {
      const double a = half_front + (2 * pi - 2 * half_front) * i / 48;
      top.push_back(at(0.088 * std::cos(a), 0.088 * std::sin(a), height));
      bottom.push_back(at(0.088 * std::cos(a), 0.088 * std::sin(a), 0.02));
    }
    for (std::size_t i = 0; i < top.size(); ++i) {
      const std::size_t j = (i + 1) % top.size();
      polygon({top[i], top[j], bottom[j], bottom[i]}, hull_grey);
    }
    polygon(top, top_black);
    disc(at(0, 0, height), 0.025, id.team == ssl::Team::yellow ? yellow : blue);
    // Figure 6, read off by eye: front left, front right, rear left, rear right; g green, m magenta.
    constexpr std::array<const char*, 16> figure{"mmgm", "gmgm", "gggm", "mggm", "mmmg", "gmmg", "ggmg", "mgmg",
                                                 "gggg", "mmmm", "mmgg", "ggmm", "gmgg", "gmmm", "mggg", "mgmm"};
    const std::array<cv::Point2d, 4> places{
        {{0.035, 0.054772}, {0.035, -0.054772}, {-0.054772, 0.035}, {-0.054772, -0.035}}};
    for (std::size_t i = 0; i < 4; ++i)
      disc(at(places[i].x, places[i].y, height), 0.020, figure[id.number][i] == 'g' ? green : magenta);
  }

  void ball(double x, double y) {
    // A sphere's outline is nearly that of a disc across the line of sight.
    cv::Matx33d r;
    cv::Rodrigues(camera_.rotation, r);
    const cv::Vec3d eye = -(r.t() * camera_.translation);
    const cv::Vec3d centre{x, y, ball_radius_m};
    const cv::Vec3d sight = cv::normalize(centre - eye);
    const cv::Vec3d u = cv::normalize(sight.cross(cv::Vec3d{1, 0, 0}));
    const cv::Vec3d v = sight.cross(u);
    std::vector<cv::Point3d> rim;
    for (int i = 0; i < 40; ++i) {
      const cv::Vec3d p = centre + ball_radius_m * (u * std::cos(2 * pi * i / 40) + v * std::sin(2 * pi * i / 40));
      rim.emplace_back(p[0], p[1], p[2]);
    }
    polygon(rim, orange);
  }

  [[nodiscard]] cv::Mat coarse() const {
    cv::Mat picture;
    cv::resize(fine_, picture, camera_.size, 0, 0, cv::INTER_AREA);
    picture.convertTo(picture, CV_32FC3);
    return picture;
  }

 private:
  static constexpr int fineness = 4;
  Camera camera_;
  cv::Mat fine_;
};

/// Half a field of division B, about.
inline void draw_field(Canvas& canvas) {
  canvas.fill(carpet);
  constexpr double width = 0.02;
  const std::vector<cv::Point2d> outline{{-3, -2}, {3, -2}, {3, 2}, {-3, 2}};
  for (std::size_t i = 0; i < 4; ++i) canvas.stripe(outline[i], outline[(i + 1) % 4], width);
  canvas.stripe({0, -2}, {0, 2}, width);
  for (int i = 0; i < 48; ++i) {
    const auto on_circle = [](int step) {
      return cv::Point2d{0.5 * std::cos(2 * pi * step / 48), 0.5 * std::sin(2 * pi * step / 48)};
    };
    canvas.stripe(on_circle(i), on_circle(i + 1), width);
  }
  for (const double side : {-1.0, 1.0}) {
    canvas.stripe({side * 3, -1}, {side * 2, -1}, width);
    canvas.stripe({side * 2, -1}, {side * 2, 1}, width);
    canvas.stripe({side * 2, 1}, {side * 3, 1}, width);
  }
}

inline cv::Mat finish(const cv::Mat& sharp, const Look& look) {
  cv::Mat picture;
  cv::GaussianBlur(sharp, picture, {}, look.blur_px);
  for (int y = 0; y < picture.rows; ++y) {
    auto* row = picture.ptr<cv::Vec3f>(y);
    for (int x = 0; x < picture.cols; ++x) {
      const double gain = 1 - look.gradient * x / picture.cols;
      for (int i = 0; i < 3; ++i) row[x][i] = static_cast<float>(row[x][i] * gain * look.cast[i]);
    }
  }
  if (look.noise > 0) {
    cv::Mat noise{picture.size(), CV_32FC3};
    cv::RNG{look.seed}.fill(noise, cv::RNG::NORMAL, 0, look.noise);
    picture += noise;
  }
  picture.convertTo(picture, CV_8UC3);
  return picture;
}

inline cv::Mat render(const Camera& camera, const std::vector<Robot>& robots, const std::vector<Ball>& balls,
                      const Look& look = {}, double height = 0.15) {
  const int steps = look.exposure_s > 0 ? 5 : 1;
  cv::Mat sum{camera.size, CV_32FC3, cv::Scalar{}};
  for (int step = 0; step < steps; ++step) {
    // The truth is that of the middle of the exposure.
    const double t = steps == 1 ? 0 : look.exposure_s * (step / (steps - 1.0) - 0.5);
    Canvas canvas{camera};
    draw_field(canvas);
    for (const Ball& ball : balls) canvas.ball(ball.x + ball.velocity.x * t, ball.y + ball.velocity.y * t);
    for (const Robot& robot : robots) {
      const FieldVelocity& v = robot.velocity;
      canvas.robot(robot.id, {robot.pose.x + v.x * t, robot.pose.y + v.y * t, robot.pose.heading + v.w * t}, height);
    }
    sum += canvas.coarse() / steps;
  }
  return finish(sum, look);
}

inline constexpr int board_columns = 9;  ///< of inner corners
inline constexpr int board_rows = 6;
inline constexpr double square_m = 0.04;
inline constexpr int boards = 9;

/// A board before the camera, each time in another part of the picture and tilted differently.
inline cv::Mat render_board(Camera camera, int number) {
  const int i = number;
  camera.rotation = {0.5 * ((i % 3) - 1), 0.5 * ((i / 3) - 1) + 0.1, 0.1 * i};
  camera.translation = {-0.16 + 0.16 * ((i % 3) - 1), -0.1 + 0.12 * ((i / 3) - 1), 0.62 + 0.02 * i};
  Canvas canvas{camera};
  canvas.fill({120, 120, 120});
  const auto rectangle = [&](double x, double y, double width, double height, const cv::Scalar& colour) {
    std::vector<cv::Point3d> rim;  // each side in pieces, as the lens bends it
    for (int k = 0; k < 8; ++k) rim.emplace_back(x + width * k / 8, y, 0);
    for (int k = 0; k < 8; ++k) rim.emplace_back(x + width, y + height * k / 8, 0);
    for (int k = 0; k < 8; ++k) rim.emplace_back(x + width - width * k / 8, y + height, 0);
    for (int k = 0; k < 8; ++k) rim.emplace_back(x, y + height - height * k / 8, 0);
    canvas.polygon(rim, colour);
  };
  constexpr double rim_m = 2 * square_m;
  rectangle(-rim_m, -rim_m, (board_columns + 3) * square_m, (board_rows + 3) * square_m, {230, 230, 230});
  for (int row = -1; row < board_rows; ++row) {
    for (int column = -1; column < board_columns; ++column) {
      if ((row + column) % 2 == 0) rectangle(column * square_m, row * square_m, square_m, square_m, {25, 25, 25});
    }
  }
  return finish(canvas.coarse(), {.noise = 2, .seed = 7});
}

/// Where the drawn lines meet. [m]
inline const std::vector<cv::Point2d> landmarks{{0, 2},  {0, -2}, {0, 0},   {0, 0.5}, {0, -0.5}, {2, 1},
                                                {2, -1}, {-2, 1}, {-2, -1}, {0.5, 0}, {-0.5, 0}};

inline Image view(const cv::Mat& picture) {
  return {.pixels = picture.ptr(), .width = picture.cols, .height = picture.rows, .row_bytes = picture.step};
}

}  // namespace regista::camera::rendered
