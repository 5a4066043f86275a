// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <chrono>
#include <cstdint>
#include <regista/core/geometry.hpp>
#include <regista/core/time.hpp>

namespace regista::control {

/// Of three axes, as a chip or a body has them.
struct ImuSample {
  Eigen::Vector3d accel_mps2 = Eigen::Vector3d::Zero();  ///< specific force: at rest it points up, with 9.81
  Eigen::Vector3d rate_radps = Eigen::Vector3d::Zero();
};

struct ImuCalibrationConfig {
  Orientation3d mount{};                    ///< of the chip's axes in the body; within some 20° will do
  Duration rest = std::chrono::seconds{1};  ///< how long the robot must stand for it
  double still_mps2 = 0.5;                  ///< a sample farther from the mean than this is no rest
  double still_radps = 0.1;                 ///< likewise
};

/// Finds, while the robot stands, how the chip is mounted and what its gyro reads for nothing, and takes both away. Up
/// is where the specific force points, so that the bias of the accelerometer across it, which looks like a tilt, is
/// gone too. Each further rest calibrates anew.
class ImuCalibration {
 public:
  explicit ImuCalibration(const ImuCalibrationConfig& config = {});

  /// One sample. `may_rest`: nothing else says that the robot moves. A sample that is not finite is counted and
  /// ignored.
  void step(const ImuSample& chip, bool may_rest, Duration dt);

  /// The last sample in the body's axes, level and without the gyro's bias.
  [[nodiscard]] const ImuSample& calibrated() const { return calibrated_; }
  /// There was a rest, long enough.
  [[nodiscard]] bool ready() const { return ready_; }
  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  void begin();

  ImuCalibrationConfig config_;
  Eigen::Matrix3d body_from_chip_;
  Eigen::Matrix3d level_ = Eigen::Matrix3d::Identity();
  Eigen::Vector3d bias_radps_ = Eigen::Vector3d::Zero();
  ImuSample sum_;
  std::uint32_t count_ = 0;
  Duration rested_{};
  ImuSample calibrated_;
  bool ready_ = false;
  std::uint64_t refused_ = 0;
};

}  // namespace regista::control
