// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <regista/camera/colours.hpp>
#include <regista/camera/image.hpp>
#include <regista/ssl/vision.hpp>

namespace regista::camera {

struct DetectorOptions {
  std::vector<ColourModel> colours = usual_colours();
  /// Of the patterns above the field. [m]
  double yellow_height_m = 0.15;
  double blue_height_m = 0.15;
};

/// Finds robots and balls in pictures of one camera, each by itself. One thread at a time.
class Detector {
 public:
  Detector(const ssl::CameraCalibration& camera, const DetectorOptions& options);
  ~Detector();
  Detector(const Detector&) = delete;
  Detector& operator=(const Detector&) = delete;

  /// Sets robots and balls of `out`, and leaves the rest. Fails with `invalid_argument` when the picture has not the
  /// size that the camera was calibrated for. Does not allocate once `out` and the detector have seen as much.
  Result<> detect(const Image& image, ssl::Detection& out);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace regista::camera
