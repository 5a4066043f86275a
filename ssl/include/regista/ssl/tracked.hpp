// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <regista/core/geometry.hpp>
#include <regista/core/result.hpp>
#include <regista/ssl/robot_id.hpp>
#include <span>
#include <string>
#include <vector>

namespace regista::ssl {

struct TrackedRobot {
  RobotId id;
  Pose2d pose{};
  std::optional<FieldVelocity> velocity{};
  double visibility = 1;  ///< 0 to 1
};

struct TrackedBall {
  Point3d position{};
  std::optional<Point3d> velocity{};  ///< [m/s]
  double visibility = 1;
};

/// The whole field at one time, as some tracker believes it to be.
struct TrackedFrame {
  std::string uuid;         ///< of the tracker: its name is no key
  std::string source_name;  ///< for people
  std::uint32_t frame_number = 0;
  double timestamp_s = 0;  ///< Unix time
  std::vector<TrackedRobot> robots;
  std::vector<TrackedBall> balls;  ///< the first is the one that is played with
};

/// Reads TrackerWrapperPacket. Fails with `bad_message` for what is none; robots that make no sense are left out.
Result<TrackedFrame> decode_tracked(std::span<const std::byte> datagram);

std::vector<std::byte> encode(const TrackedFrame& frame);

}  // namespace regista::ssl
