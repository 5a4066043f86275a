// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/control/trajectory_tracker.hpp>

#include "parameter.hpp"

namespace regista::control {

TrajectoryTracker::TrajectoryTracker(const TrajectoryTrackerConfig& config)
    : config_{config},
      planner_{config.profile},
      x_{{.proportional = config.translation_proportional,
          .integral = config.translation_integral,
          .output_limit = config.speed_limit_mps}},
      y_{x_},
      heading_{{.proportional = config.rotation_proportional,
                .integral = config.rotation_integral,
                .output_limit = config.turn_rate_limit_radps}} {
  require(config.feed_forward >= 0 && config.feed_forward <= 1, "feed_forward", config.feed_forward, "give 0 to 1");
  require_positive("restart_distance_m", config.restart_distance_m);
}

TrajectoryTracker::Output TrajectoryTracker::step(const Pose2d& estimate, const Pose2d& target, Duration dt) {
  const Duration elapsed = elapsed_ + dt;
  auto plan = plan_;
  bool restarted = !plan;
  if (plan) {
    restarted = distance(estimate, plan->at(elapsed).pose) > config_.restart_distance_m;
    if (restarted || replans_ || !(target == target_)) {
      plan = planner_.plan(restarted ? MotionState{.pose = estimate, .velocity = commanded_} : plan->at(elapsed),
                           {.pose = target});
    }
  } else {
    plan = planner_.plan({.pose = estimate, .velocity = commanded_}, {.pose = target});
  }
  const bool sane_estimate = sane(estimate.x) && sane(estimate.y) && sane(estimate.heading);
  if (!plan || !sane_estimate) {
    ++refused_;
    return {.command = {}, .reference = {.pose = estimate}, .refused = true};
  }

  const bool replanned = restarted || replans_ || !(target == target_);
  if (restarted || distance(target, target_) > 0.3 * distance(estimate, target_)) clear_integrals();
  plan_ = plan;
  target_ = target;
  replans_ = false;
  elapsed_ = replanned ? Duration{} : elapsed;

  const MotionState reference = plan_->at(elapsed_);
  const auto& [pose, velocity] = reference;
  const double turn = angle_between(estimate.heading, pose.heading);
  FieldVelocity command{.x = config_.feed_forward * velocity.x + x_.step(pose.x, estimate.x, dt),
                        .y = config_.feed_forward * velocity.y + y_.step(pose.y, estimate.y, dt),
                        .w = config_.feed_forward * velocity.w + heading_.step(turn, 0, dt)};
  const double speed = std::hypot(command.x, command.y);
  const double scale = speed > config_.speed_limit_mps ? config_.speed_limit_mps / speed : 1;
  command = {.x = scale * command.x,
             .y = scale * command.y,
             .w = std::clamp(command.w, -config_.turn_rate_limit_radps, config_.turn_rate_limit_radps)};
  commanded_ = command;
  return {.command = to_body(command, estimate.heading),
          .reference = reference,
          .plan_ended = seconds(elapsed_) >= plan_->duration_s()};
}

void TrajectoryTracker::reset(const FieldVelocity& moving) {
  plan_.reset();
  elapsed_ = {};
  commanded_ = moving;
  clear_integrals();
}

void TrajectoryTracker::limit_profile(double speed_mps, double turn_rate_radps) {
  MotionLimits limits = planner_.limits();
  if (limits.speed_mps == speed_mps && limits.turn_rate_radps == turn_rate_radps) return;
  limits.speed_mps = speed_mps;
  limits.turn_rate_radps = turn_rate_radps;
  planner_ = MotionPlanner{limits};
  replans_ = true;
}

void TrajectoryTracker::clear_integrals() {
  x_.reset();
  y_.reset();
  heading_.reset();
}

}  // namespace regista::control
