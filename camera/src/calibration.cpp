// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <regista/camera/calibration.hpp>
#include <regista/camera/projection.hpp>

namespace regista::camera {

namespace {

Error wrong(const std::string& what) { return {std::errc::invalid_argument, what}; }

/// OpenCV turns by a vector: axis times angle.
void set_rotation(ssl::CameraCalibration& camera, const double* vector) {
  const double angle = std::hypot(vector[0], vector[1], vector[2]);
  const double scale = angle > 0 ? std::sin(angle / 2) / angle : 0.5;
  camera.rotation = {scale * vector[0], scale * vector[1], scale * vector[2], std::cos(angle / 2)};
}

constexpr int lens_parameters = 4;  // focal length, principal point, distortion
constexpr int pose_parameters = 6;  // rotation vector, translation

/// What Levenberg and Marquardt minimise: how far from the pixels the model puts the points. Parameters: the lens, if
/// it is free, and a pose for each view.
class Residuals final : public cv::LMSolver::Callback {
 public:
  Residuals(std::span<const View> views, ssl::CameraCalibration camera, bool lens_is_free)
      : views_{views}, camera_{camera}, free_lens_{lens_is_free ? lens_parameters : 0} {}

  [[nodiscard]] ssl::CameraCalibration camera(const cv::Mat& parameters, int view) const {
    ssl::CameraCalibration camera = camera_;
    const auto* p = parameters.ptr<double>();
    if (free_lens_ > 0) {
      camera.focal_px = p[0];
      camera.principal_x_px = p[1];
      camera.principal_y_px = p[2];
      camera.distortion = p[3];
    }
    p += free_lens_ + view * pose_parameters;
    set_rotation(camera, p);
    camera.translation = {.x = p[3], .y = p[4], .z = p[5]};
    return camera;
  }

  [[nodiscard]] cv::Mat errors(const cv::Mat& parameters) const {
    std::vector<double> errors;
    for (std::size_t v = 0; v < views_.size(); ++v) {
      const ssl::CameraCalibration seen_by = camera(parameters, static_cast<int>(v));
      for (std::size_t i = 0; i < views_[v].points.size(); ++i) {
        constexpr double nowhere_px = 1e4;
        const auto pixel = project(seen_by, views_[v].points[i]);
        errors.push_back(pixel ? pixel->x - views_[v].pixels[i].x : nowhere_px);
        errors.push_back(pixel ? pixel->y - views_[v].pixels[i].y : nowhere_px);
      }
    }
    return cv::Mat{errors, true};
  }

  bool compute(cv::InputArray parameters, cv::OutputArray error, cv::OutputArray jacobian) const override {
    const cv::Mat here = parameters.getMat();
    const cv::Mat at = errors(here);
    at.copyTo(error);
    if (!jacobian.needed()) return true;
    jacobian.create(at.rows, here.rows, CV_64F);
    cv::Mat j = jacobian.getMat();
    for (int i = 0; i < here.rows; ++i) {
      const double step = 1e-6 * std::max(1.0, std::abs(here.at<double>(i)));
      cv::Mat beside = here.clone();
      beside.at<double>(i) += step;
      const cv::Mat after = errors(beside);
      beside.at<double>(i) -= 2 * step;
      j.col(i) = (after - errors(beside)) / (2 * step);
    }
    return true;
  }

 private:
  std::span<const View> views_;
  ssl::CameraCalibration camera_;
  int free_lens_;
};

CalibrationFit minimise(std::span<const View> views, const ssl::CameraCalibration& camera, bool lens_is_free,
                        const std::vector<double>& start) {
  const auto residuals = cv::makePtr<Residuals>(views, camera, lens_is_free);
  cv::Mat parameters{start, true};
  constexpr int most_iterations = 200;
  (void)cv::LMSolver::create(residuals, most_iterations)->run(parameters);
  CalibrationFit fit{.camera = residuals->camera(parameters, 0)};
  const cv::Mat errors = residuals->errors(parameters);
  double squares = 0;
  for (int i = 0; i < errors.rows; i += 2) {
    fit.errors_px.push_back(std::hypot(errors.at<double>(i), errors.at<double>(i + 1)));
    squares += std::pow(fit.errors_px.back(), 2);
  }
  fit.rms_px = std::sqrt(squares / static_cast<double>(fit.errors_px.size()));
  return fit;
}

std::vector<cv::Point3f> points_of(const View& view) {
  std::vector<cv::Point3f> points;
  for (const Point3d& p : view.points)
    points.emplace_back(static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z));
  return points;
}

/// The narrow side of the cloud of points over its wide side: 0 when they are in one line.
double spread_ratio(const View& view) {
  cv::Mat plane(static_cast<int>(view.points.size()), 2, CV_64F);
  for (int i = 0; i < plane.rows; ++i) {
    plane.at<double>(i, 0) = view.points[static_cast<std::size_t>(i)].x;
    plane.at<double>(i, 1) = view.points[static_cast<std::size_t>(i)].y;
  }
  for (int i = 0; i < 2; ++i) plane.col(i) -= cv::mean(plane.col(i))[0];
  cv::Mat values;
  cv::SVD::compute(plane, values, cv::SVD::NO_UV);
  return values.at<double>(1) / std::max(values.at<double>(0), 1e-9);
}

void append(std::vector<double>& parameters, const cv::Mat& rotation, const cv::Mat& translation) {
  for (const cv::Mat& vector : {rotation, translation})
    parameters.insert(parameters.end(), vector.begin<double>(), vector.end<double>());
}

}  // namespace

std::optional<View> find_board(const Image& image, int columns, int rows, double square_m) {
  const cv::Mat bgr(image.height, image.width, CV_8UC3, const_cast<std::uint8_t*>(image.pixels), image.row_bytes);
  cv::Mat grey;
  cv::cvtColor(bgr, grey, cv::COLOR_BGR2GRAY);
  std::vector<cv::Point2f> corners;
  if (!cv::findChessboardCornersSB(grey, {columns, rows}, corners,
                                   cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_ACCURACY))
    return {};
  View view;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    view.points.push_back({.x = static_cast<double>(static_cast<int>(i) % columns) * square_m,
                           .y = static_cast<double>(static_cast<int>(i) / columns) * square_m});
    view.pixels.push_back({.x = corners[i].x, .y = corners[i].y});
  }
  return view;
}

Result<CalibrationFit> fit_lens(std::span<const View> boards, ssl::CameraCalibration camera) {
  constexpr std::size_t fewest_boards = 3;
  if (boards.size() < fewest_boards) {
    return wrong("fit the lens to " + std::to_string(boards.size()) +
                 " pictures of the board: at least 3 are needed, better 10, tilted differently");
  }
  std::vector<std::vector<cv::Point3f>> points;
  std::vector<std::vector<cv::Point2f>> pixels;
  for (const View& board : boards) {
    points.push_back(points_of(board));
    auto& seen = pixels.emplace_back();
    for (const Pixel& p : board.pixels) seen.emplace_back(static_cast<float>(p.x), static_cast<float>(p.y));
  }
  cv::Mat matrix = cv::Mat::eye(3, 3, CV_64F);
  cv::Mat distortion = cv::Mat::zeros(5, 1, CV_64F);
  std::vector<cv::Mat> rotations;
  std::vector<cv::Mat> translations;
  constexpr int one_of_each =
      cv::CALIB_FIX_ASPECT_RATIO | cv::CALIB_ZERO_TANGENT_DIST | cv::CALIB_FIX_K2 | cv::CALIB_FIX_K3;
  (void)cv::calibrateCamera(points, pixels, {static_cast<int>(camera.width_px), static_cast<int>(camera.height_px)},
                            matrix, distortion, rotations, translations, one_of_each);
  // OpenCV distorts where the league undistorts: the coefficients agree to the first order only. From there on, the
  // league's model itself is fitted.
  std::vector<double> start{matrix.at<double>(0, 0), matrix.at<double>(0, 2), matrix.at<double>(1, 2),
                            -distortion.at<double>(0)};
  for (std::size_t i = 0; i < boards.size(); ++i) append(start, rotations[i], translations[i]);
  CalibrationFit fit = minimise(boards, camera, true, start);
  fit.camera.rotation = camera.rotation;
  fit.camera.translation = camera.translation;
  return fit;
}

Result<CalibrationFit> fit_pose(const View& field, ssl::CameraCalibration camera) {
  if (camera.focal_px <= 0) return wrong("fit the camera's pose before its lens is known");
  constexpr std::size_t fewest_points = 4;
  if (field.points.size() < fewest_points) {
    return wrong("fit the camera's pose to " + std::to_string(field.points.size()) +
                 " points of the field: at least 4 are needed, better 8, over all that it sees");
  }
  constexpr double in_line = 0.02;
  if (spread_ratio(field) < in_line) return wrong("fit the camera's pose to points of the field that are in one line");
  std::vector<cv::Point2f> directions;
  for (const Pixel& pixel : field.pixels) {
    const Pixel d = undistort(camera, pixel);
    directions.emplace_back(static_cast<float>(d.x), static_cast<float>(d.y));
  }
  cv::Mat rotation;
  cv::Mat translation;
  if (!cv::solvePnP(points_of(field), directions, cv::Mat::eye(3, 3, CV_64F), cv::noArray(), rotation, translation))
    return wrong("fit the camera's pose: these points are not seen from anywhere");
  std::vector<double> start;
  append(start, rotation, translation);
  CalibrationFit fit = minimise({&field, 1}, camera, false, start);
  if (ssl::position(fit.camera).z <= 0)
    return wrong("fit the camera's pose: it would be under the field; are points left and right mixed up?");
  return fit;
}

}  // namespace regista::camera
