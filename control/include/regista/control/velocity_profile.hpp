// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <regista/core/geometry.hpp>
#include <regista/core/time.hpp>

namespace regista::control {

/// Where something is on one axis, and how fast: [m, m/s] or [rad, rad/s].
struct AxisState {
  double position = 0;
  double velocity = 0;
};

/// Of one axis: [m/s, m/s²] or [rad/s, rad/s²], both positive.
struct AxisLimits {
  double speed = 0;
  double acceleration = 0;
};

/// A move along one axis at piecewise constant acceleration: to a cruising velocity, along it, and to the final one.
/// Nine numbers, however long the move. Times are in [s] from its start.
class AxisProfile {
 public:
  /// At rest at `position`, with nothing to do.
  explicit AxisProfile(double position = 0) : start_position_{position} {}

  /// The quickest move. A start faster than the limit first slows down at full deceleration; or, mirrored in time, a
  /// goal faster than the limit is sped up to last; not both in the same direction. Closed form; every number must be
  /// finite and the limits positive.
  [[nodiscard]] static AxisProfile quickest(const AxisState& start, const AxisState& goal, const AxisLimits& limits);

  /// The move that takes exactly `duration_s`, cruising slower than the quickest does. Empty when there is none: with
  /// a final velocity, some durations just above the quickest are out of reach.
  [[nodiscard]] static std::optional<AxisProfile> lasting(double duration_s, const AxisState& start,
                                                          const AxisState& goal, const AxisLimits& limits);

  [[nodiscard]] double duration_s() const { return end_s_; }

  /// Before the start: the start. After the end: on, with the final velocity.
  [[nodiscard]] AxisState at(double time_s) const {
    if (time_s <= 0) return {.position = start_position_, .velocity = start_velocity_};
    if (time_s < cruise_from_s_) {
      return {.position = start_position_ + (start_velocity_ + 0.5 * acceleration_ * time_s) * time_s,
              .velocity = start_velocity_ + acceleration_ * time_s};
    }
    const double cruise_start = start_position_ + 0.5 * (start_velocity_ + cruise_velocity_) * cruise_from_s_;
    if (time_s < cruise_until_s_) {
      return {.position = cruise_start + cruise_velocity_ * (time_s - cruise_from_s_), .velocity = cruise_velocity_};
    }
    const double cruise_end = cruise_start + cruise_velocity_ * (cruise_until_s_ - cruise_from_s_);
    if (time_s < end_s_) {
      const double t = time_s - cruise_until_s_;
      return {.position = cruise_end + (cruise_velocity_ + 0.5 * final_acceleration_ * t) * t,
              .velocity = cruise_velocity_ + final_acceleration_ * t};
    }
    return {.position = cruise_end + 0.5 * (cruise_velocity_ + final_velocity_) * (end_s_ - cruise_until_s_) +
                        final_velocity_ * (time_s - end_s_),
            .velocity = final_velocity_};
  }

  /// When the acceleration changes, ascending; the last is the duration.
  [[nodiscard]] std::array<double, 3> switches_s() const { return {cruise_from_s_, cruise_until_s_, end_s_}; }

 private:
  friend class SplitSearch;

  AxisProfile(const AxisState& start, double cruise_velocity, double final_velocity, double acceleration,
              double duration_s);

  double start_position_ = 0;
  double start_velocity_ = 0;
  double acceleration_ = 0;
  double cruise_from_s_ = 0;
  double cruise_velocity_ = 0;
  double cruise_until_s_ = 0;
  double final_acceleration_ = 0;
  double end_s_ = 0;
  double final_velocity_ = 0;
};

/// Where a robot is on the field, and how it moves.
struct MotionState {
  Pose2d pose{};
  FieldVelocity velocity{};
};

/// What a robot may do; of x and y together, as vectors. All positive.
struct MotionLimits {
  double speed_mps = 0;
  double acceleration_mps2 = 0;
  double turn_rate_radps = 0;
  double turn_acceleration_radps2 = 0;
};

/// A move in x, y and heading. A plain value: it copies, and needs no planner to be evaluated.
class MotionPlan {
 public:
  /// Stay where you are.
  explicit MotionPlan(const Pose2d& pose = {});

  /// Position and velocity at a time from the start of the plan. After the end it goes on with the final velocity.
  /// The heading is in (-π, π].
  [[nodiscard]] MotionState at(Duration since_start) const;

  /// Until the goal's pose and velocity are reached.
  [[nodiscard]] double duration_s() const;

  /// When the acceleration of x and y changes, not in order: between two neighbours it is constant.
  [[nodiscard]] std::array<double, 8> switches_s() const;

 private:
  friend class MotionPlanner;

  /// x and y together at constant acceleration.
  struct Lead {
    double duration_s = 0;
    double acceleration_x = 0;
    double acceleration_y = 0;
  };

  AxisState start_x_;
  AxisState start_y_;
  Lead brake_;    // straight back inside the limits
  Lead turn_in_;  // then to what the split between the axes allows
  AxisProfile x_;
  AxisProfile y_;
  AxisProfile heading_;
};

/// Plans moves in minimum time from any state: bang-bang on each axis, x and y synchronised by splitting speed and
/// acceleration between them at an angle α (Purwin and D'Andrea 2006; Holtzhausen 2013). On top of what they
/// published, speed and acceleration hold as vectors at every instant; a start above the speed limit first brakes
/// straight at full deceleration; the goal may have a velocity; and x and y end at the same instant, exactly.
class MotionPlanner {
 public:
  /// Throws std::invalid_argument that names the limit which is not positive and finite.
  explicit MotionPlanner(const MotionLimits& limits);

  /// Empty, and nothing is planned, when a number is not finite or above 1e8, or when the goal's velocity exceeds the
  /// limits. The heading turns whichever way is quicker. To replan without a jump, start from `at(now)` of the plan
  /// before.
  [[nodiscard]] std::optional<MotionPlan> plan(const MotionState& start, const MotionState& goal) const;

  [[nodiscard]] const MotionLimits& limits() const { return limits_; }

 private:
  MotionLimits limits_;
};

}  // namespace regista::control
