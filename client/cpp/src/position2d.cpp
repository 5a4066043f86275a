// SPDX-License-Identifier: Apache-2.0
#include <regista/client/robot.hpp>

namespace regista::client {

namespace {

using namespace std::chrono_literals;

template <Described T>
void require_finite(const T& value, const char* what) {
  for_each_field(value, [&](const auto&, double number) {
    if (!std::isfinite(number)) throw std::invalid_argument{std::string{what} + ": not a finite number"};
  });
}

}  // namespace

void Position2dProxy::set_velocity(const BodyVelocity& velocity) {
  require_finite(velocity, "set_velocity");
  keep_alive(false);
  send(position2d::VelocityCommand{.velocity = velocity});
}

void Position2dProxy::go_to(const Pose2d& goal, const BodyVelocity& limits) {
  require_finite(goal, "go_to");
  require_finite(limits, "go_to");
  send(position2d::PositionCommand{.pose = goal, .velocity = limits});
  keep_alive(true);
}

void Position2dProxy::stop() {
  keep_alive(false);
  if (connection().extended()) {
    (void)ask(server_address, player::Stop{wire_address()});
  } else {
    send(position2d::VelocityCommand{});
  }
}

void Position2dProxy::set_odometry(const Pose2d& pose) {
  require_finite(pose, "set_odometry");
  (void)request(position2d::SetOdometry{pose});
}

bool Position2dProxy::is_at(const Pose2d& goal, const Tolerance& tolerance) const {
  const Pose2d& pose = state().pose;
  return count() > 0 && distance(pose, goal) <= tolerance.distance_m &&
         std::abs(angle_between(pose.heading, goal.heading)) <= tolerance.heading_rad;
}

void Position2dProxy::drive_to(const Pose2d& goal, Duration timeout, const Tolerance& tolerance) {
  follow({goal}, timeout, tolerance);
}

void Position2dProxy::follow(std::vector<Pose2d> path, Duration timeout, const Tolerance& tolerance) {
  Follower follower{*this, std::move(path), tolerance};
  const Time until = Clock::now() + timeout;
  while (!follower.step()) {
    const Time now = Clock::now();
    if (now >= until) {
      stop();
      raise("drive", {Errc::no_answer, "not there after " + std::to_string(timeout / 1ms) + " ms, " +
                                           std::to_string(distance(state().pose, follower.goal())) + " m to go"});
    }
    (void)robot().read(until - now);
  }
}

Follower::Follower(Position2dProxy& base, std::vector<Pose2d> path, const Tolerance& tolerance)
    : base_{base}, path_{std::move(path)}, tolerance_{tolerance} {
  if (path_.empty()) throw std::invalid_argument{"a path needs at least one pose"};
}

bool Follower::step() {
  const auto reached = [&] {
    Tolerance tolerance = tolerance_;
    if (next_ < path_.size()) tolerance.heading_rad = std::numbers::pi;  // on the way any heading will do
    return base_.is_at(goal(), tolerance);
  };
  if (next_ > 0) {
    if (reached()) {
      if (next_ == path_.size()) return true;
    } else if (base_.was_stopped()) {
      const auto motion = base_.motion();
      base_.raise("drive", {std::error_code{no_reason, refusal_category()},
                            motion ? std::string{motion->reason.view()} : "the connection was lost on the way"});
    } else {
      return false;
    }
  }
  base_.go_to(path_[next_]);
  ++next_;
  return false;
}

}  // namespace regista::client
