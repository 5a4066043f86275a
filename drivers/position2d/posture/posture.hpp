// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/control/obedience.hpp>
#include <regista/control/posture_regulator.hpp>
#include <regista/device/driver.hpp>

namespace regista {

/// Drives a base that cannot move sideways to a pose, heading included: control::PostureRegulator, after Kvalheim,
/// Isaksen and Næss 2017.
///
/// `requires ["position2d:0" "position2d:1"]`: the base, which is driven by velocities, and whatever knows the pose,
/// such as a `localizer`; with one alone, its odometry is the pose. Here or on other servers.
/// `provides ["position2d:2"]`, which takes destinations, and velocities that it passes on; it tells the pose and the
/// base's velocity. It commands the base while it has a destination and falls silent then: when this driver or its
/// server dies, the base's own lease stops it.
///
/// A destination is given up when no pose came for `pose_timeout`, when the pose jumps, and when the base does not do
/// what it is told for `obey_timeout`: blocked, stopped, or driven by somebody else. Property to read: `arrived`.
///
/// | Key                 | Value                                                                     | Default       |
/// |---------------------|---------------------------------------------------------------------------|---------------|
/// | `k1`, `k2`, `k3`    | gains on the distance [1/s], the bearing [1/s], the direction of approach | 2, 4, 1.3     |
/// | `speed`             | [length/s] at most, either way; a destination may name less               | 1 m/s         |
/// | `turn_speed`        | [angle/s] at most                                                         | 2 rad/s       |
/// | `accel`, `turn_accel` | [length/s², angle/s²] by which the command changes at most              | 3 m/s², 20
/// rad/s² | | `tolerance`, `turn_tolerance` | [length, angle] within which it has arrived                     | 0.05 m,
/// 0.05 rad | | `pose_timeout`      | [s]                                                                       | 0.5 |
/// | `jump`              | [length] that a pose is off where the base's velocity led                 | 1 m           |
/// | `obey_timeout`      | [s]                                                                       | 3             |
class Posture final : public Driver {
 public:
  explicit Posture(Setup& setup);

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override;

 private:
  Result<> go_to(const position2d::PositionCommand& goal);
  void take_pose(const Pose2d& pose);
  [[nodiscard]] std::string why_not(Time now) const;
  void rest() noexcept;

  Port<Position2d> port_;
  Required<Position2d> base_;
  std::optional<Required<Position2d>> poses_;
  Property<bool> arrived_;

  // As configured.
  control::PostureRegulatorConfig config_;
  double accel_mps2_;
  double turn_accel_radps2_;
  Duration pose_timeout_;
  double jump_m_;

  control::PostureRegulator regulator_;
  control::Obedience obedience_;
  std::optional<position2d::PositionCommand> goal_;
  BodyVelocity command_;
  std::optional<Pose2d> pose_;
  Time pose_seen_{};
  bool jumped_ = false;      ///< the pose, since the destination was given
  position2d::State moves_;  ///< what the base said last
  std::optional<Time> moves_seen_;
};

}  // namespace regista
