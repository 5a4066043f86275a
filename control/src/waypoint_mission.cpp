// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/control/waypoint_mission.hpp>

#include "parameter.hpp"

namespace regista::control {

WaypointMission::WaypointMission(const WaypointMissionConfig& config, std::vector<Waypoint> waypoints)
    : config_{config}, waypoints_{std::move(waypoints)}, law_{config.law}, parking_{config.parking} {
  require(!waypoints_.empty(), "waypoints", 0, "give at least one");
  for (const Waypoint& waypoint : waypoints_) {
    const auto& [pose, work, wait] = waypoint;
    for (const double value : {pose.x, pose.y, pose.heading}) {
      require(sane(value), "waypoint", value, "give a finite place in metres and radians");
    }
    require(wait >= Duration{}, "wait", seconds(wait), "give a time, 0 or more");
  }
  require_positive("estimate_timeout", seconds(config.estimate_timeout));
  require_positive("drive_timeout", seconds(config.drive_timeout));
  require_positive("tool_timeout", seconds(config.tool_timeout));
}

WaypointMission::Output WaypointMission::step(const Input& input, Duration dt) {
  const bool under_way = phase_ != Phase::finished && phase_ != Phase::failed;
  const Pose2d& goal = waypoints_[std::min(current_, waypoints_.size() - 1)].pose;
  parking_.step(input.estimate, input.wheels, goal, dt);
  if (under_way && !paused_) {
    in_phase_ += dt;
    unseen_ = std::min(unseen_ + dt, parking_.age());
    advance(input.tool);
  }

  Output output{.command = {}, .phase = phase_, .paused = paused_, .waypoint = current_, .failure = failure_};
  if (phase_ == Phase::finished) return output;
  const Pose2d& next = waypoints_[current_].pose;
  if (parking_.pose()) output.distance_m = distance(*parking_.pose(), next);
  if (paused_) return output;
  // resume() gives the estimates time to come, not the robot time to drive blind.
  const bool sees = parking_.pose() && parking_.age() <= config_.estimate_timeout;
  if (phase_ == Phase::driving && sees && !parking_.parked()) {
    output.command = law_.step(*parking_.pose(), next).command;
  }
  if (phase_ == Phase::lowering) output.tool = ToolAction::lower;
  if (phase_ == Phase::working && waypoints_[current_].work == Work::measure) output.tool = ToolAction::measure;
  if (phase_ == Phase::raising) output.tool = ToolAction::raise;
  return output;
}

void WaypointMission::resume() {
  paused_ = false;
  unseen_ = {};
  if (phase_ == Phase::failed) enter(failed_phase_);
}

void WaypointMission::enter(Phase phase) {
  phase_ = phase;
  in_phase_ = {};
  failure_ = {};
}

void WaypointMission::fail(std::string_view reason) {
  failed_phase_ = phase_;
  enter(Phase::failed);
  failure_ = reason;
}

void WaypointMission::advance(const ToolReport& tool) {
  const Waypoint& waypoint = waypoints_[current_];
  const auto go_on = [this] {
    ++current_;
    parking_.next_goal();
    work_done_ = false;
    enter(current_ == waypoints_.size() ? Phase::finished : Phase::driving);
  };
  if (phase_ == Phase::driving) {
    if (unseen_ > config_.estimate_timeout) return fail("no position that can be believed");
    if (in_phase_ > config_.drive_timeout) return fail("the way-point was not reached in time");
    if (!parking_.parked()) return;
    return waypoint.work == Work::none ? go_on() : enter(Phase::lowering);
  }

  // At work, blind or not: what is believed of the position only matters when it says that the robot has moved.
  if (tool.failed) return fail("the tool reports a failure");
  if (!parking_.parked() && phase_ != Phase::raising) {
    fail("the robot was moved while the tool was down");
    failed_phase_ = Phase::raising;  // and then there again
    return;
  }
  const bool waiting = phase_ == Phase::working && waypoint.work == Work::wait;
  if (waiting) {
    work_done_ = in_phase_ >= waypoint.wait;
    if (work_done_) enter(Phase::raising);
    return;
  }
  const ToolAction expected = phase_ == Phase::lowering  ? ToolAction::lower
                              : phase_ == Phase::working ? ToolAction::measure
                                                         : ToolAction::raise;
  if (tool.finished != expected) {
    if (in_phase_ > config_.tool_timeout) fail("the tool did not finish in time");
  } else if (phase_ == Phase::lowering) {
    enter(Phase::working);
  } else if (phase_ == Phase::working) {
    work_done_ = true;
    enter(Phase::raising);
  } else if (work_done_) {
    go_on();
  } else {
    parking_.next_goal();
    enter(Phase::driving);
  }
}

}  // namespace regista::control
