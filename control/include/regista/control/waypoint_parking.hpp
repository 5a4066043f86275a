// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <regista/core/geometry.hpp>
#include <regista/core/time.hpp>

namespace regista::control {

struct ParkingConfig {
  double radius_m = 0.3;        ///< parked within this of the goal
  double leave_radius_m = 0.6;  ///< and until beyond this
  int estimates = 10;           ///< in a row, to park and to leave
  double jump_m = 1;            ///< an estimate farther than this from where the wheels say the robot is has jumped
  int believe_after = 50;       ///< jumped estimates in a row that agree among themselves: the jump was true
};

/// Tells when a robot stands at its goal, so that a jump of the GPS does not end the approach early. Estimates are
/// compared with the last one believed, moved on by the wheels; those that jump count for nothing until they have
/// persisted. A jump that stays within `jump_m`, or persists, cannot be told from a movement.
class ParkingDetector {
 public:
  /// Throws std::invalid_argument that names the value which cannot be.
  explicit ParkingDetector(const ParkingConfig& config);

  /// Take in what happened during `dt`: the movement measured by the wheels, and the estimate if one came. Numbers that
  /// are none are refused like a jump.
  void step(const std::optional<Pose2d>& estimate, const BodyVelocity& wheels, const Pose2d& goal, Duration dt);

  /// Start anew for another goal; what is believed of the position stays.
  void next_goal();

  /// The robot may be anywhere by now: the next estimate is believed.
  void forget();

  [[nodiscard]] bool parked() const { return parked_; }

  /// The last believed estimate, moved on by the wheels: steer by this. Empty before the first estimate.
  [[nodiscard]] const std::optional<Pose2d>& pose() const { return believed_; }

  /// Since the last estimate that was believed.
  [[nodiscard]] Duration age() const { return age_; }

  [[nodiscard]] std::uint64_t jumps() const { return jumps_; }

 private:
  bool believes(const Pose2d& estimate);

  ParkingConfig config_;
  std::optional<Pose2d> believed_;
  std::optional<Pose2d> suspect_;
  int suspects_ = 0;
  int streak_ = 0;  ///< of estimates that speak for a change of `parked_`
  bool parked_ = false;
  Duration age_{};
  std::uint64_t jumps_ = 0;
};

}  // namespace regista::control
