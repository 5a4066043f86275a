// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <memory>
#include <optional>
#include <regista/device/driver.hpp>
#include <regista/motor_board/link.hpp>

#include "microstrain.hpp"

namespace regista {

/// A sample in the house's axes.
struct InertialSample {
  Eigen::Vector3d acceleration_mps2;  ///< specific force in the body: level and at rest (0, 0, 9.81)
  Eigen::Vector3d rate_radps;         ///< in the body
  Eigen::Vector3d field_gauss;        ///< in the body
  Eigen::Matrix3d field_from_body;    ///< x east, y north, z up
};

/// `body_from_chip`: how the sensor is mounted, the chip's axes being x ahead, y left, z up. `declination_rad`: of
/// magnetic north from true north, positive to the east.
[[nodiscard]] InertialSample to_house(const microstrain::Sample& sample, const Eigen::Matrix3d& body_from_chip,
                                      double declination_rad);

/// The turns about x, then y, then z that make up a rotation.
[[nodiscard]] Orientation3d to_orientation(const Eigen::Matrix3d& rotation);

/// An IMU of MicroStrain with a compass, on a serial line.
///
/// `imu:0` publishes each sample, as CALIB (specific force, turn rate, the earth's field) and STATE (roll, pitch and
/// heading, counter-clockwise from east). SET_DATATYPE 3 or 4 adds QUAT or EULER; nothing is ever taken away from
/// others who listen.
///
/// | Key           | Value                                                                     | Default       |
/// |---------------|---------------------------------------------------------------------------|---------------|
/// | `port`        | "/dev/ttyACM0"                                                            | must be there |
/// | `protocol`    | "single_byte": 3DM-GX3-25; "mip": 3DM-GX3-35, GX4, GX5 and later          | must be there |
/// | `baud`        | [bits/s]; USB disregards it                                               | 115200        |
/// | `sample_rate` | [Hz] asked of a sensor that speaks MIP; a GX3-25 keeps its own (100)      | 100           |
/// | `mount`       | [roll pitch yaw] of the sensor in the robot; at 0 its x is ahead, z down  | 0 0 0         |
/// | `declination` | [angle] of magnetic north from true north, positive to the east           | 0             |
/// | `timeout`     | [s] without a sample, then the line is opened again                       | 1             |
///
/// Property, read-only: `skipped`, bytes that were no part of a packet.
class ImuDriver final : public Driver {
 public:
  explicit ImuDriver(Setup& setup);
  /// With this line to it.
  ImuDriver(Setup& setup, std::unique_ptr<motor_board::BoardLink> link);

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override {}
  void close() noexcept override;
  [[nodiscard]] std::span<const int> descriptors() const override;

 private:
  Result<> take(const microstrain::Answer& answer);
  [[nodiscard]] Error silent() const;

  Port<Imu> port_;
  Property<std::int32_t> skipped_;
  microstrain::Protocol protocol_;
  double sample_rate_hz_;
  Eigen::Matrix3d body_from_chip_;
  double declination_rad_;
  Duration timeout_;
  std::unique_ptr<motor_board::BoardLink> link_;
  mutable std::array<int, 1> descriptor_{-1};
  microstrain::Reader reader_;
  std::optional<microstrain::Sample> newest_;  ///< of this beat
  Duration silence_{};
  bool heard_ = false;  ///< bytes, since the last sample
  bool with_quaternion_ = false;
  bool with_euler_ = false;
};

}  // namespace regista
