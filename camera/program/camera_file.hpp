// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <regista/camera/detector.hpp>

namespace regista::camera {

/// Of the rules of 2026.
inline ssl::Geometry division_b() {
  return {.length_m = 9,
          .width_m = 6,
          .boundary_m = 0.3,
          .goal_width_m = 1,
          .defence_depth_m = 1,
          .defence_width_m = 2,
          .circle_radius_m = 0.5};
}
inline ssl::Geometry division_a() {
  return {.length_m = 12,
          .width_m = 9,
          .boundary_m = 0.3,
          .goal_width_m = 1.8,
          .defence_depth_m = 1.8,
          .defence_width_m = 3.6,
          .circle_radius_m = 0.5};
}

/// All that is known of a camera: what `regista-camera calibrate` writes.
struct CameraFile {
  ssl::CameraCalibration camera;  ///< its focal length is 0 before the lens is calibrated
  bool has_pose = false;          ///< `rotation` and `translation` of `camera` are known
  ssl::Geometry field = division_b();
  DetectorOptions detector;
};

/// Throws ConfigError, with file, line and column, for what is not as docs/camera.md says.
CameraFile read_camera_file(const std::filesystem::path& file);

/// The whole file anew; what people have written as comments is lost. Throws std::system_error.
void write_camera_file(const std::filesystem::path& file, const CameraFile& camera);

}  // namespace regista::camera
