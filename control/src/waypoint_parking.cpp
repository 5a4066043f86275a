// SPDX-License-Identifier: Apache-2.0
#include <regista/control/waypoint_parking.hpp>

#include "parameter.hpp"

namespace regista::control {
namespace {

// Along the chord of the arc, to third order in the turn of one step.
Pose2d moved(const Pose2d& pose, const BodyVelocity& velocity, double dt_s) {
  const double half_turn = 0.5 * velocity.w * dt_s;
  const FieldVelocity field = to_field(velocity, pose.heading + half_turn);
  return {
      .x = pose.x + field.x * dt_s, .y = pose.y + field.y * dt_s, .heading = wrap_angle(pose.heading + 2 * half_turn)};
}

}  // namespace

ParkingDetector::ParkingDetector(const ParkingConfig& config) : config_{config} {
  require_positive("radius_m", config.radius_m);
  require(config.leave_radius_m >= config.radius_m && std::isfinite(config.leave_radius_m), "leave_radius_m",
          config.leave_radius_m, "give radius_m or more");
  require(config.estimates > 0, "estimates", config.estimates, "give 1 or more");
  require_positive("jump_m", config.jump_m);
  require(config.believe_after > 0, "believe_after", config.believe_after, "give 1 or more");
}

void ParkingDetector::step(const std::optional<Pose2d>& estimate, const BodyVelocity& wheels, const Pose2d& goal,
                           Duration dt) {
  age_ += dt;
  if (sane(wheels.x) && sane(wheels.y) && sane(wheels.w)) {
    if (believed_) believed_ = moved(*believed_, wheels, seconds(dt));
    if (suspect_) suspect_ = moved(*suspect_, wheels, seconds(dt));
  }
  if (!estimate) return;
  if (!sane(estimate->x) || !sane(estimate->y) || !sane(estimate->heading) || !believes(*estimate)) {
    ++jumps_;
    streak_ = 0;
    return;
  }
  believed_ = estimate;
  age_ = {};
  suspect_.reset();
  suspects_ = 0;

  const double off = distance(*estimate, goal);
  const bool speaks_for_change = parked_ ? off > config_.leave_radius_m : off <= config_.radius_m;
  streak_ = speaks_for_change ? streak_ + 1 : 0;
  if (streak_ >= config_.estimates) {
    parked_ = !parked_;
    streak_ = 0;
  }
}

bool ParkingDetector::believes(const Pose2d& estimate) {
  if (!believed_ || distance(estimate, *believed_) <= config_.jump_m) return true;
  suspects_ = suspect_ && distance(estimate, *suspect_) <= config_.jump_m ? suspects_ + 1 : 1;
  suspect_ = estimate;
  return suspects_ >= config_.believe_after;
}

void ParkingDetector::forget() {
  believed_.reset();
  suspect_.reset();
  suspects_ = 0;
}

void ParkingDetector::next_goal() {
  parked_ = false;
  streak_ = 0;
}

}  // namespace regista::control
