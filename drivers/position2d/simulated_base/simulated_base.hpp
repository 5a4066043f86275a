// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/device/driver.hpp>
#include <regista/sim/random.hpp>
#include <regista/sim/simple_base.hpp>
#include <variant>

namespace regista {

/// A base that exists only here: a first-order answer to its commands, limits, and noise that a seed repeats.
///
/// `position2d:0` is the base as its wheels see it. "truth:::position2d:1" is where it really is, in the field, for
/// simulated sensors and for whoever wants to compare; it takes no commands.
///
/// | Key                 | Value                                                                     | Default      |
/// |---------------------|---------------------------------------------------------------------------|--------------|
/// | `holonomic`         | boolean; no: a differential base, which cannot go sideways                | yes          |
/// | `time_constant`     | [s] of the velocity's answer                                              | 0.05         |
/// | `motor_speed`       | [length/s] that the motors can do                                         | 1.5 m/s      |
/// | `motor_turn`        | [angle/s] that the motors can do                                          | 6 rad/s      |
/// | `motor_accel`       | [length/s²] that the motors can do                                        | 3 m/s²       |
/// | `motor_turn_accel`  | [angle/s²] that the motors can do                                         | 20 rad/s²    |
/// | `size`              | [length width height]                                                     | 0.18 0.18 0.15 m
/// | `drift`             | [m] sd of the odometry's random walk after one metre                      | 0            |
/// | `turn_drift`        | [rad] sd of its heading's random walk after one metre, or one radian turned | 0          |
/// | `noise`             | sd of the published velocity [m/s, rad/s]; also a property, within [0, 1] | 0            |
/// | `seed`              | whole number                                                              | 1            |
class SimulatedBase final : public Driver {
 public:
  explicit SimulatedBase(Setup& setup);

  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override;

 private:
  using Target = std::variant<position2d::VelocityCommand, position2d::PositionCommand, position2d::CarCommand,
                              position2d::VelocityHeadingCommand>;

  template <typename Command>
  void accept();
  [[nodiscard]] BodyVelocity wanted(const position2d::VelocityCommand& command) const;
  [[nodiscard]] BodyVelocity wanted(const position2d::PositionCommand& command) const;
  [[nodiscard]] BodyVelocity wanted(const position2d::CarCommand& command) const;
  [[nodiscard]] BodyVelocity wanted(const position2d::VelocityHeadingCommand& command) const;
  [[nodiscard]] Pose2d odometry() const { return odometry_from_field_ * base_.state().pose; }
  Result<Empty> set_odometry(const Pose2d& pose);

  Port<Position2d> port_;
  Port<Position2d> truth_port_;
  Property<double> noise_;
  sim::Random random_;
  sim::SimpleBaseParameters parameters_;
  sim::SimpleBase base_;
  sim::SimpleBase truth_;
  Size3d size_;
  Pose2d odometry_from_field_;
  Target target_;
  bool powered_ = true;
};

}  // namespace regista
