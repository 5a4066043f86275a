// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <regista/control/pi_controller.hpp>
#include <regista/control/velocity_profile.hpp>

namespace regista::control {

struct TrajectoryTrackerConfig {
  MotionLimits profile;                 ///< of the moves planned
  double translation_proportional = 0;  ///< [1/s]
  double translation_integral = 0;      ///< [1/s²]
  double rotation_proportional = 0;     ///< [1/s]
  double rotation_integral = 0;         ///< [1/s²]
  double speed_limit_mps = 0;           ///< of the command
  double turn_rate_limit_radps = 0;     ///< of the command
  double feed_forward = 1;              ///< part of the planned velocity that goes straight into the command
  double restart_distance_m = 0.5;      ///< farther than this from the plan, it starts anew from where the robot is

  /// Holtzhausen 2013: three PI loops on the position, nothing fed forward; turn limits of the profile are ours.
  static TrajectoryTrackerConfig published() {
    return {
        .profile = {.speed_mps = 0.6, .acceleration_mps2 = 1.5, .turn_rate_radps = 2, .turn_acceleration_radps2 = 6},
        .translation_proportional = 3,
        .translation_integral = 6,
        .rotation_proportional = 1.5,
        .rotation_integral = 2,
        .speed_limit_mps = 1,
        .turn_rate_limit_radps = 2,
        .feed_forward = 0};
  }

  /// Ours, on the same profile: the plan's velocity fed forward, and gains as high as the chain's delay allows. No
  /// integral: what the boards' integrators leave is small, and ours would only overshoot.
  static TrajectoryTrackerConfig fed_forward() {
    TrajectoryTrackerConfig config = published();
    config.translation_proportional = 15;
    config.translation_integral = 0;
    config.rotation_proportional = 10;
    config.rotation_integral = 0;
    config.feed_forward = 1;
    return config;
  }
};

/// Brings an omnidirectional robot to a target: plans a move, and commands the velocity that keeps the robot on it.
class TrajectoryTracker {
 public:
  struct Output {
    BodyVelocity command;
    MotionState reference;  ///< where the plan wants the robot now
    bool plan_ended = false;
    bool refused = false;  ///< estimate or target was no number: the command is zero, and nothing changed inside
  };

  /// Throws std::invalid_argument that names the value which cannot be.
  explicit TrajectoryTracker(const TrajectoryTrackerConfig& config);

  /// `dt` is the time since the last step. A new target is planned for from the current reference, without a jump;
  /// one that differs by more than 30 % of the way still to go clears the integrals (Holtzhausen's rule).
  [[nodiscard]] Output step(const Pose2d& estimate, const Pose2d& target, Duration dt);

  /// Forget plan and integrals: the next step starts from the estimate, at the velocity that the robot has.
  void reset(const FieldVelocity& moving = {});

  /// Plan no faster than this from now on, [m/s, rad/s]; the next step goes on from the plan before, without a jump.
  /// Throws std::invalid_argument for what is not positive.
  void limit_profile(double speed_mps, double turn_rate_radps);

  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  void clear_integrals();

  TrajectoryTrackerConfig config_;
  MotionPlanner planner_;
  PiController x_;
  PiController y_;
  PiController heading_;
  std::optional<MotionPlan> plan_;
  Pose2d target_;
  bool replans_ = false;  ///< the limits have changed
  Duration elapsed_{};
  FieldVelocity commanded_;
  std::uint64_t refused_ = 0;
};

}  // namespace regista::control
