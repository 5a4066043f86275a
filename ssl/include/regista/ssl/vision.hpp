// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <regista/core/geometry.hpp>
#include <regista/core/result.hpp>
#include <regista/ssl/robot_id.hpp>
#include <span>
#include <vector>

/// The messages of RoboCup's Small Size League, in our units and frames: metres, +x towards the positive half's goal.
namespace regista::ssl {

struct DetectedRobot {
  RobotId id;
  double x_m = 0;
  double y_m = 0;
  std::optional<double> heading_rad{};  ///< not every pattern shows one
  double confidence = 1;
  double pixel_x = 0;
  double pixel_y = 0;
  double height_m = 0;  ///< of the pattern above the field; 0: not told
};

struct DetectedBall {
  double x_m = 0;
  double y_m = 0;
  double z_m = 0;  ///< simulators only
  double confidence = 1;
  double pixel_x = 0;
  double pixel_y = 0;
  std::uint32_t area_px = 0;  ///< 0: not told
};

/// What one camera saw. All numbers are finite.
struct Detection {
  std::uint32_t camera = 0;
  std::uint32_t frame_number = 0;
  double t_capture_s = 0;  ///< by a clock that nobody knows: only differences mean something
  double t_sent_s = 0;     ///< by the same clock
  std::vector<DetectedRobot> robots{};
  std::vector<DetectedBall> balls{};
  std::size_t unusable = 0;  ///< robots and balls without id or place, or with absurd ones: left out above
};

/// How a camera sees the field: SSL_GeometryCameraCalibration. The camera looks along its z, x is to the right and y
/// down in its picture; (0, 0) is the middle of the first pixel.
struct CameraCalibration {
  std::uint32_t camera = 0;
  double focal_px = 0;
  double principal_x_px = 0;
  double principal_y_px = 0;
  /// k in r_undistorted = r (1 + k r²), where r is the distance from the principal point over the focal length: above 0
  /// for a barrel.
  double distortion = 0;
  std::array<double, 4> rotation{0, 0, 0, 1};  ///< from field to camera: quaternion x, y, z, w
  Point3d translation{};                       ///< of the field's centre, in the camera's frame [m]
  std::uint32_t width_px = 0;
  std::uint32_t height_px = 0;
};

/// Where the camera stands, in the field's frame [m].
Point3d position(const CameraCalibration& camera);

struct Geometry {
  double length_m = 0;    ///< of the playing field, along x
  double width_m = 0;     ///< along y
  double boundary_m = 0;  ///< around it
  double goal_width_m = 1;
  double goal_depth_m = 0.18;
  double defence_depth_m = 0;  ///< of the areas before the goals; 0: not told, as the next two
  double defence_width_m = 0;
  double circle_radius_m = 0;  ///< in the centre
  std::vector<CameraCalibration> cameras{};
  std::optional<double> rolling_mps2{};  ///< how the ball loses speed when it rolls; positive
  bool is_2010 = false;                  ///< was in the layout that SSL-Vision used until 2013
};

struct VisionPacket {
  std::optional<Detection> detection;
  std::optional<Geometry> geometry;
};

/// Reads SSL_WrapperPacket of 2010 to 2026. Keeps its memory from packet to packet: a camera's frame is read without
/// allocation once all robots were seen.
class VisionDecoder {
 public:
  VisionDecoder();
  ~VisionDecoder();
  VisionDecoder(const VisionDecoder&) = delete;
  VisionDecoder& operator=(const VisionDecoder&) = delete;

  /// Fails with `bad_message` for what is no such packet, or has no time. The result is valid until the next call.
  Result<const VisionPacket*> decode(std::span<const std::byte> datagram);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// As a league program of today would send it. Detection and geometry that it has; of a camera also where it stands.
std::vector<std::byte> encode(const VisionPacket& packet);

}  // namespace regista::ssl
