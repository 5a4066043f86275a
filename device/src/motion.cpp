// SPDX-License-Identifier: Apache-2.0
#include <regista/device/motion.hpp>

#include <algorithm>
#include <type_traits>

#include "finite.hpp"

namespace regista {

namespace {

using player::MotionState;

constexpr SessionId everybody = std::numeric_limits<SessionId>::max();

template <typename... Fs>
struct Overloaded : Fs... {
  using Fs::operator()...;
};

std::string milliseconds(Duration duration) {
  return std::to_string(std::chrono::round<std::chrono::milliseconds>(duration).count()) + " ms";
}

/// A command whose effect lasts until it is reached, not until the next one.
bool is_destination(const AnyCommand& command) {
  return std::visit(
      []<typename M>(const M&) {
        return std::same_as<M, position2d::PositionCommand> || std::same_as<M, position1d::PositionCommand> ||
               std::same_as<M, actarray::PositionCommand> || std::same_as<M, actarray::MultiPositionCommand> ||
               std::same_as<M, planner::GoalCommand> || std::same_as<M, planner::StartCommand> ||
               std::same_as<M, planner::RunCommand>;
      },
      command);
}

bool is_edge(const AnyCommand& command) {
  return std::visit([]<typename M>(const M&) { return M::message.flow == Flow::edge; }, command);
}

/// Scale down to `limit`; whether that was needed.
template <typename T>
bool limit(T& value, double limit) {
  if (std::abs(value) <= limit) return false;
  value = static_cast<T>(std::copysign(limit, value));
  return true;
}

bool limit(BodyVelocity& velocity, double speed, double turn) {
  const double faster = std::hypot(velocity.x, velocity.y) / speed;
  if (faster > 1) {  // keeps the direction
    velocity.x /= faster;
    velocity.y /= faster;
  }
  return limit(velocity.w, turn) || faster > 1;
}

/// Go from `from` towards `to`, by at most `step`. True: there.
template <typename T>
bool approach(T& from, T to, double step) {
  const double difference = static_cast<double>(to) - static_cast<double>(from);
  if (std::abs(difference) <= step) {
    from = to;
    return true;
  }
  from = static_cast<T>(from + std::copysign(step, difference));
  return false;
}

bool approach(BodyVelocity& from, const BodyVelocity& to, double step, double turn_step) {
  const bool turned = approach(from.w, to.w, turn_step);
  const double dx = to.x - from.x;
  const double dy = to.y - from.y;
  const double difference = std::hypot(dx, dy);
  if (difference <= step) {
    from.x = to.x;
    from.y = to.y;
    return turned;
  }
  from.x += dx / difference * step;
  from.y += dy / difference * step;
  return false;
}

/// Of the commands that move a base at a velocity; null for all others.
std::optional<BodyVelocity> base_velocity(const AnyCommand& command) {
  if (const auto* c = std::get_if<position2d::VelocityCommand>(&command)) return c->velocity;
  if (const auto* c = std::get_if<position2d::CarCommand>(&command)) return BodyVelocity{.x = c->speed_mps};
  if (const auto* c = std::get_if<position2d::VelocityHeadingCommand>(&command)) return BodyVelocity{.x = c->speed_mps};
  return std::nullopt;
}

/// The same command, but at this velocity.
AnyCommand at_velocity(AnyCommand command, const BodyVelocity& velocity) {
  if (auto* c = std::get_if<position2d::VelocityCommand>(&command)) c->velocity = velocity;
  if (auto* c = std::get_if<position2d::CarCommand>(&command)) c->speed_mps = velocity.x;
  if (auto* c = std::get_if<position2d::VelocityHeadingCommand>(&command)) c->speed_mps = velocity.x;
  return command;
}

/// The same for the velocities of a whole command; what is not a velocity jumps. True: there.
bool approach(AnyCommand& output, const AnyCommand& target, double step, double turn_step) {
  if (output.index() != target.index()) {
    const std::optional<BodyVelocity> velocity = base_velocity(output);
    if (!velocity || !base_velocity(target)) {
      output = target;
      return true;
    }
    output = at_velocity(target, *velocity);
  }
  return std::visit(Overloaded{
                        [&](position2d::VelocityCommand& out) {
                          position2d::VelocityCommand next = *std::get_if<position2d::VelocityCommand>(&target);
                          const BodyVelocity wanted = std::exchange(next.velocity, out.velocity);
                          const bool there = approach(next.velocity, wanted, step, turn_step);
                          out = next;
                          return there;
                        },
                        [&](position2d::CarCommand& out) {
                          const auto& wanted = *std::get_if<position2d::CarCommand>(&target);
                          out.steering_rad = wanted.steering_rad;
                          return approach(out.speed_mps, wanted.speed_mps, step);
                        },
                        [&](position2d::VelocityHeadingCommand& out) {
                          const auto& wanted = *std::get_if<position2d::VelocityHeadingCommand>(&target);
                          out.heading_rad = wanted.heading_rad;
                          return approach(out.speed_mps, wanted.speed_mps, step);
                        },
                        [&](position1d::VelocityCommand& out) {
                          const auto& wanted = *std::get_if<position1d::VelocityCommand>(&target);
                          out.motor_on = wanted.motor_on;
                          return approach(out.velocity, wanted.velocity, step);
                        },
                        [&](actarray::SpeedCommand& out) {
                          const auto& wanted = *std::get_if<actarray::SpeedCommand>(&target);
                          if (out.joint != wanted.joint) {
                            out = wanted;
                            return true;
                          }
                          return approach(out.speed, wanted.speed, step);
                        },
                        [&](actarray::MultiSpeedCommand& out) {
                          const auto& wanted = *std::get_if<actarray::MultiSpeedCommand>(&target);
                          out.speeds.resize(wanted.speeds.size());
                          bool there = true;
                          for (std::size_t i = 0; i < wanted.speeds.size(); ++i) {
                            there = approach(out.speeds[i], wanted.speeds[i], step) && there;
                          }
                          return there;
                        },
                        [&](auto& out) {
                          out = *std::get_if<std::remove_reference_t<decltype(out)>>(&target);
                          return true;
                        },
                    },
                    output);
}

/// Which joint of an array a command is for: -1: all of them; empty: it is for no array.
std::optional<std::int32_t> joint_of(const AnyCommand& command) {
  return std::visit(
      []<typename M>(const M& c) -> std::optional<std::int32_t> {
        if constexpr (requires { c.joint; }) return c.joint;
        if (M::message.interface == Actarray::code) return -1;
        return std::nullopt;
      },
      command);
}

/// The set-point that leads to rest from where `last` had led; the velocities in it are the present ones.
/// Empty: none does, the driver must halt.
std::optional<AnyCommand> way_to_rest(const AnyCommand& last, const Measured& measured) {
  // A command for one joint says nothing of the others, which may move since an earlier one.
  const auto joints = [&]() -> std::optional<AnyCommand> {
    if (measured.speeds.empty()) return actarray::SpeedCommand{.joint = -1};
    return actarray::MultiSpeedCommand{.speeds = measured.speeds};
  };
  return std::visit(Overloaded{
                        [&](const position2d::PositionCommand&) -> std::optional<AnyCommand> {
                          return position2d::VelocityCommand{.velocity = measured.velocity};
                        },
                        [&](const position1d::PositionCommand&) -> std::optional<AnyCommand> {
                          return position1d::VelocityCommand{.velocity = static_cast<float>(measured.velocity.x)};
                        },
                        [&](const actarray::PositionCommand&) { return joints(); },
                        [&](const actarray::MultiPositionCommand&) { return joints(); },
                        [&](const actarray::SpeedCommand&) { return joints(); },
                        [](const planner::GoalCommand&) -> std::optional<AnyCommand> { return std::nullopt; },
                        [](const planner::StartCommand&) -> std::optional<AnyCommand> { return std::nullopt; },
                        [](const planner::RunCommand&) -> std::optional<AnyCommand> { return std::nullopt; },
                        [](const auto& same) -> std::optional<AnyCommand> { return AnyCommand{same}; },
                    },
                    last);
}

/// How far a velocity may go in `dt`; an infinite limit lets it jump, in no time too.
double step_within(double limit, Duration dt) { return std::isinf(limit) ? limit : limit * seconds(dt); }

/// The same command, at rest.
AnyCommand at_rest(AnyCommand command) {
  std::visit(Overloaded{
                 [](position2d::VelocityCommand& c) { c.velocity = {}; },
                 [](position2d::CarCommand& c) { c.speed_mps = 0; },
                 [](position2d::VelocityHeadingCommand& c) { c.speed_mps = 0; },
                 [](position1d::VelocityCommand& c) { c.velocity = 0; },
                 [](actarray::SpeedCommand& c) { c = {.joint = -1}; },  // all of them, whichever was told last
                 [](actarray::MultiSpeedCommand& c) { std::ranges::fill(c.speeds, 0.0F); },
                 [](actarray::CurrentCommand& c) { c = {.joint = -1}; },
                 [](actarray::MultiCurrentCommand& c) { std::ranges::fill(c.currents_a, 0.0F); },
                 [](kicker::DribblerCommand& c) { c.speed_radps = 0; },
                 [](auto&) {},
             },
             command);
  return command;
}

}  // namespace

MotionPolicy MotionPolicy::read(const Section& config) {
  const double infinite = std::numeric_limits<double>::infinity();
  const Range positive{.min = 1e-6, .max = infinite};
  MotionPolicy policy;
  policy.lease = config.duration("lease", policy.lease, {.min = 0.1, .max = 2.0});
  policy.outlives_owner = config.boolean("outlives_owner", false);
  policy.max_speed = config.length("max_speed", infinite, positive);
  policy.max_turn = config.angle("max_turn", infinite, positive);
  policy.max_acceleration = config.length("max_acceleration", infinite, positive);
  policy.max_turn_acceleration = config.angle("max_turn_acceleration", infinite, positive);
  policy.ramp = config.length("ramp", infinite, positive);
  policy.turn_ramp = config.angle("turn_ramp", infinite, positive);
  return policy;
}

MotionGroup::MotionGroup(std::string device, std::string group, const MotionPolicy& policy)
    : device_{std::move(device)}, group_{std::move(group)}, policy_{policy} {
  if (group_ != "motion") device_ += ' ' + group_;
}

bool MotionGroup::destination() const { return is_destination(target_); }

Error MotionGroup::owned_by_other() const {
  return {std::errc::device_or_resource_busy, "owned by \"" + owner_->who.name + "\" (prio " +
                                                  std::to_string(owner_->who.priority) + ") until released or " +
                                                  milliseconds(policy_.lease) + " idle"};
}

Result<> MotionGroup::command(SessionId session, const Identity& who, const AnyCommand& command, Time arrived,
                              Time now) {
  if (std::string found = first_not_finite(command); !found.empty()) {
    return Error{std::errc::invalid_argument, std::move(found)};
  }
  if (policy_.sensor) return {};
  if (now - arrived > policy_.lease) {
    return Error{std::errc::timed_out, "command waited " + milliseconds(now - arrived) + " for the driver (lease " +
                                           milliseconds(policy_.lease) + ")"};
  }
  if (displaced_ != 0 && (session == displaced_ || (displaced_ == everybody && session != stopped_by_))) {
    const bool paused = arrived - std::exchange(displaced_heard_, arrived) > policy_.lease;
    if (!paused) {
      return Error{std::errc::operation_not_permitted,
                   "stopped or taken over: pause for " + milliseconds(policy_.lease) + " or take"};
    }
    displaced_ = 0;
  }
  const bool idle = lapses() && now - heard_ > policy_.lease;
  if (owner_ && owner_->session != session && !idle) return owned_by_other();
  if (!owner_ || owner_->session != session) {
    owner_ = Owner{session, who};
    changed_ = true;
  }
  heard_ = arrived;
  if (is_edge(command)) return {};
  if (std::exchange(untold_, true)) ++replaced_;
  target_ = command;
  clamp(target_);
  if (state_ == MotionState::stopping && rests_first_) {
    queued_ = true;  // told when the device stands
    return {};
  }
  if (state_ != MotionState::driving) {
    if (state_ == MotionState::stopped) {
      next_output_ = at_rest(target_);
      stepped_ = now;
    }
    state_ = MotionState::driving;
    reason_.clear();
    changed_ = true;
  }
  if (!pending_) stepped_ = now;  // the way to the target starts here, not at the last step
  pending_ = true;
  return {};
}

void MotionGroup::clamp(AnyCommand& command) {
  const bool clamped = std::visit(
      Overloaded{
          [&](position2d::VelocityCommand& c) { return limit(c.velocity, policy_.max_speed, policy_.max_turn); },
          [&](position2d::PositionCommand& c) {
            // 0 is "as fast as it can", which must not be faster than it may.
            if (c.velocity.x == 0 && c.velocity.y == 0 && std::isfinite(policy_.max_speed)) {
              c.velocity.x = policy_.max_speed;
            }
            if (c.velocity.w == 0 && std::isfinite(policy_.max_turn)) c.velocity.w = policy_.max_turn;
            return limit(c.velocity, policy_.max_speed, policy_.max_turn);
          },
          [&](position2d::CarCommand& c) { return limit(c.speed_mps, policy_.max_speed); },
          [&](position2d::VelocityHeadingCommand& c) { return limit(c.speed_mps, policy_.max_speed); },
          [&](position1d::VelocityCommand& c) { return limit(c.velocity, policy_.max_speed); },
          [&](position1d::PositionCommand& c) {
            if (c.velocity == 0 && std::isfinite(policy_.max_speed)) c.velocity = static_cast<float>(policy_.max_speed);
            return limit(c.velocity, policy_.max_speed);
          },
          [&](actarray::SpeedCommand& c) { return limit(c.speed, policy_.max_speed); },
          [&](actarray::MultiSpeedCommand& c) {
            bool any = false;
            for (float& speed : c.speeds) any = limit(speed, policy_.max_speed) || any;
            return any;
          },
          [](auto&) { return false; },
      },
      command);
  if (clamped) ++clamped_;
}

Result<> MotionGroup::take(SessionId session, const Identity& who, bool blend, Time now) {
  if (owner_ && owner_->session != session) {
    if (owner_->who.priority > who.priority) return owned_by_other();
    if (tell_) tell_(0, device_ + ": \"" + who.name + "\" took over from \"" + owner_->who.name + '"');
    displaced_ = owner_->session;
    displaced_heard_ = now;
    if (state_ == MotionState::driving && !blend) begin_stop("taken over by \"" + who.name + '"', true, now);
    queued_ = false;
  } else if (session == displaced_ || displaced_ == everybody) {
    displaced_ = 0;
  }
  rests_first_ = state_ == MotionState::stopping;
  owner_ = Owner{session, who};
  // To take is not to command: what moves, or waits to, gets no new lease.
  if (state_ != MotionState::driving && !queued_) heard_ = now;
  changed_ = true;
  return {};
}

void MotionGroup::release(SessionId session, Time now) {
  if (!owner_ || owner_->session != session) return;
  const std::string name = owner_->who.name;
  begin_stop("released by \"" + name + '"', false, now);
}

void MotionGroup::gone(SessionId session, Time now) {
  if (session == displaced_) displaced_ = 0;
  if (!owner_ || owner_->session != session) return;
  if (policy_.outlives_owner && state_ == MotionState::driving && destination()) {
    owner_.reset();
    changed_ = true;
    return;
  }
  const std::string name = owner_->who.name;
  begin_stop("owner \"" + name + "\" disconnected", false, now);
}

void MotionGroup::keep_alive(SessionId session, Time arrived) {
  if (owner_ && owner_->session == session && destination()) heard_ = std::max(heard_, arrived);
}

void MotionGroup::stop(SessionId by, const std::string& reason, Time now) {
  displaced_ = everybody;
  stopped_by_ = by;
  displaced_heard_ = now;
  begin_stop(reason, false, now);
}

void MotionGroup::begin_stop(std::string reason, bool keep_owner, Time now) {
  if (!keep_owner) owner_.reset();
  changed_ = true;
  queued_ = false;
  if (state_ != MotionState::driving) return;
  const bool moves = output_ != at_rest(output_);
  if (tell_) tell_(moves ? 1 : 0, device_ + " stopped: " + reason);
  come_to_rest(std::move(reason), now);
}

void MotionGroup::come_to_rest(std::string reason, Time now) {
  changed_ = true;
  reason_ = std::move(reason);
  state_ = MotionState::stopping;
  rests_first_ = false;
  pending_ = true;
  stepped_ = now;
}

MotionGroup::AfterRefusal MotionGroup::refused(const std::string& reason, Time now) {
  if (told_rest_) {
    if (state_ == MotionState::stopping) stand(now);
    return AfterRefusal::halt;
  }
  if (state_ != MotionState::driving || !destination()) return AfterRefusal::carry_on;
  come_to_rest("refused: " + reason, now);
  rests_first_ = true;  // what is refused again and again does not hold up the stop
  return AfterRefusal::come_to_rest;
}

void MotionGroup::halted(const std::string& reason, bool fault) {
  owner_.reset();
  displaced_ = 0;
  state_ = fault ? MotionState::fault : MotionState::stopped;
  reason_ = reason;
  pending_ = false;
  rests_first_ = false;
  queued_ = false;
  changed_ = true;
}

void MotionGroup::recovered() {
  if (state_ != MotionState::fault) return;
  state_ = MotionState::stopped;
  changed_ = true;
}

void MotionGroup::stand(Time now) {
  changed_ = true;
  rests_first_ = false;
  pending_ = std::exchange(queued_, false);
  state_ = pending_ ? MotionState::driving : MotionState::stopped;
  if (pending_) next_output_ = at_rest(target_);
  stepped_ = now;
}

bool MotionGroup::displaces(const AnyCommand& command) const {
  return pending_ && joint_of(command) != joint_of(target_);
}

const AnyCommand* MotionGroup::step(Time now, const Measured& measured) {
  untold_ = false;
  if (next_output_) output_ = *std::exchange(next_output_, std::nullopt);
  if (lapses() && now - heard_ > policy_.lease) {
    if (state_ == MotionState::driving) {
      // Whoever wrote a program for Player did not know of leases.
      const char* hint = owner_ && !owner_->who.extended ? "; repeat it, see docs/policies.md#motion" : "";
      begin_stop((destination() ? "no sign of life for " : "no command for ") + milliseconds(now - heard_) +
                     " (lease " + milliseconds(policy_.lease) + ')' + hint,
                 false, now);
    } else {
      owner_.reset();
      changed_ = true;
    }
  }
  const Duration dt = now - std::exchange(stepped_, now);
  told_rest_ = state_ == MotionState::stopping;
  switch (state_) {
    case MotionState::driving:
      if (!pending_) return nullptr;
      if (is_destination(output_) && !destination()) output_ = way_to_rest(output_, measured).value_or(output_);
      pending_ = !approach(output_, target_, step_within(policy_.max_acceleration, dt),
                           step_within(policy_.max_turn_acceleration, dt));
      return &output_;
    case MotionState::stopping:
      if (std::exchange(pending_, false)) {
        std::optional<AnyCommand> way = way_to_rest(output_, measured);
        if (!way) {
          halt_requested_ = true;
          stand(now);
          return nullptr;
        }
        output_ = *std::move(way);
      }
      if (approach(output_, at_rest(output_), step_within(policy_.ramp, dt), step_within(policy_.turn_ramp, dt))) {
        stand(now);
      }
      return &output_;
    case MotionState::stopped:
    case MotionState::fault:
      return nullptr;
  }
  return nullptr;
}

bool MotionGroup::lapses() const {
  if (state_ != MotionState::driving) return owner_ && state_ != MotionState::stopping;
  // A destination needs its owner alive, not repeated: a stock client's connection says so, ours sends keep-alives.
  if (destination()) return owner_ && owner_->who.extended;
  return true;
}

Time MotionGroup::due(Time next_beat) const {
  if (state_ == MotionState::stopping || pending_) return next_beat;
  return lapses() ? heard_ + policy_.lease + Duration{1} : Time::max();
}

player::Motion MotionGroup::status() const {
  player::Motion motion{.group = group_, .state = state_, .lease_s = seconds(policy_.lease), .reason = reason_};
  if (owner_) {
    motion.owner = owner_->who.name;
    motion.priority = owner_->who.priority;
  }
  return motion;
}

}  // namespace regista
