// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/camera/image.hpp>
#include <regista/ssl/vision.hpp>
#include <span>
#include <vector>

/// From pictures of what is known to the league's model of the camera.
namespace regista::camera {

/// One picture of points whose places are known.
struct View {
  std::vector<Point3d> points{};  ///< [m], in a frame of their own
  std::vector<Pixel> pixels{};    ///< as many
};

struct CalibrationFit {
  ssl::CameraCalibration camera;
  std::vector<double> errors_px{};  ///< of each point, in the order of views and points
  double rms_px = 0;                ///< root of their mean square
};

/// The inner corners of a checkerboard, in its own plane. None unless all are seen; it may stand on its head.
std::optional<View> find_board(const Image& image, int columns, int rows, double square_m);

/// Focal length, principal point and distortion, from at least three views of a flat board, tilted in different
/// directions. The rest of `camera` stays. Fails with `invalid_argument`, and says what is missing.
Result<CalibrationFit> fit_lens(std::span<const View> boards, ssl::CameraCalibration camera);

/// Where the camera stands and looks, from at least four points of the field. Its lens stays as it is. Fails with
/// `invalid_argument`, and says what is wrong.
Result<CalibrationFit> fit_pose(const View& field, ssl::CameraCalibration camera);

}  // namespace regista::camera
