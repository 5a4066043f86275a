// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <regista/core/geometry.hpp>
#include <regista/core/time.hpp>
#include <regista/sim/random.hpp>
#include <vector>

namespace regista::sim {

/// What one camera sees of the field, and by how much its calibration is off.
struct Camera {
  double min_x_m = -10;
  double max_x_m = 10;
  double min_y_m = -10;
  double max_y_m = 10;
  Pose2d offset = {};  ///< added to what it sees
};

/// The defaults are those of a well calibrated SSL-Vision: 2 mm and 6 mrad on a robot that stands, 4 mm and 10 mrad on
/// one that drives (ER-Force, robotfilter), 2 % of the frames without the robot, 60 frames a second.
struct VisionParameters {
  std::vector<Camera> cameras = {{}};  ///< one to 16; their areas may overlap
  double period_s = 1.0 / 60;
  double noise_m = 0.004;     ///< sd along each axis
  double noise_rad = 0.010;   ///< sd
  double loss = 0.02;         ///< probability that a camera misses the robot in a frame
  double delay_s = 0.03;      ///< from capture to arrival
  double delay_jitter_s = 0;  ///< uniformly added, up to this; frames stay in order
  double flip = 0;            ///< probability that a frame shows the heading ±90° or 180° off
  double teleport = 0;        ///< probability that a frame sees the robot's pattern elsewhere
  double teleport_m = 1;      ///< how far off, in a random direction
  std::uint64_t seed = 1;
};

struct Detection {
  int camera = 0;  ///< index in VisionParameters::cameras
  Duration age{};  ///< since its capture
  Pose2d pose;
};

/// Cameras above the field that look for one robot.
class Vision {
 public:
  /// Throws std::invalid_argument that names field, value and remedy.
  explicit Vision(const VisionParameters& parameters);

  /// Where the robot is after `dt`. What arrives now, oldest first; valid until the next step.
  const std::vector<Detection>& step(const Pose2d& truth, Duration dt);

 private:
  struct Pending {
    Detection detection;
    Duration left{};
  };

  void capture(const Pose2d& truth);

  VisionParameters parameters_;
  Random random_;
  Duration until_frame_{};
  std::vector<Pending> pending_;  // bounded by delay / period frames
  std::vector<Detection> arrived_;
};

}  // namespace regista::sim
