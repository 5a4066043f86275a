// SPDX-License-Identifier: Apache-2.0
#include "posture.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <regista/control/odometry.hpp>

namespace regista {

namespace {

using namespace std::chrono_literals;

constexpr Range positive{.min = 1e-6};
constexpr Duration base_timeout = 500ms;  // without its data it is not known to do anything

control::PostureRegulatorConfig read_regulator(const Section& config) {
  control::PostureRegulatorConfig regulator;
  regulator.k1 = config.number("k1", regulator.k1, positive);
  regulator.k2 = config.number("k2", regulator.k2, positive);
  regulator.k3 = config.number("k3", regulator.k3, positive);
  regulator.speed_limit_mps = config.length("speed", regulator.speed_limit_mps, positive);
  regulator.turn_rate_limit_radps = config.angle("turn_speed", regulator.turn_rate_limit_radps, positive);
  regulator.tolerance_m = config.length("tolerance", regulator.tolerance_m, positive);
  regulator.tolerance_rad = config.angle("turn_tolerance", regulator.tolerance_rad, positive);
  return regulator;
}

std::size_t count_position2d(const Section& config) {
  const auto names = config.device_names("requires");
  return static_cast<std::size_t>(
      std::ranges::count_if(names, [](const PlacedName& p) { return p.name.interface == Position2d::code; }));
}

/// A limit that a command names; 0 leaves it to the driver.
double limit_or(double named, double own) { return named == 0 ? own : std::clamp(std::abs(named), 1e-3 * own, own); }

std::string seconds_text(Duration duration) {
  char text[32];
  (void)std::snprintf(text, sizeof text, "%.3g s", seconds(duration));
  return text;
}

}  // namespace

Posture::Posture(Setup& setup)
    : port_{setup.provide<Position2d>()},
      base_{setup.require<Position2d>()},
      poses_{count_position2d(setup.config) > 1 ? std::optional{setup.require<Position2d>()} : std::nullopt},
      arrived_{setup.property<bool>("arrived", false, {.read_only = true})},
      config_{read_regulator(setup.config)},
      accel_mps2_{setup.config.length("accel", 3, positive)},
      turn_accel_radps2_{setup.config.angle("turn_accel", 20, positive)},
      pose_timeout_{setup.config.duration("pose_timeout", 500ms, {.min = 0.05, .max = 10})},
      jump_m_{setup.config.length("jump", 1, positive)},
      regulator_{config_},
      obedience_{{.patience = setup.config.duration("obey_timeout", 3s, {.min = 0.1, .max = 60})}} {
  base_.on_data<position2d::State>([this](const position2d::State& state, Time) {
    moves_ = state;
    moves_seen_ = port_.now();
    if (!poses_) take_pose(state.pose);
  });
  if (poses_) {
    poses_->on_data<position2d::State>([this](const position2d::State& state, Time) { take_pose(state.pose); });
  }
  port_.on<position2d::PositionCommand>([this](const position2d::PositionCommand& goal) { return go_to(goal); });
  // Passed on as it comes, and never repeated: the base's lease sees the same silence as ours.
  port_.on<position2d::VelocityCommand>([this](const position2d::VelocityCommand& command) {
    goal_.reset();
    command_ = command.velocity;
    arrived_.set(false);
    (void)base_.send(command);
  });
}

Result<> Posture::open() {
  goal_.reset();
  pose_.reset();
  moves_seen_.reset();
  command_ = {};
  return {};
}

void Posture::take_pose(const Pose2d& pose) {
  const Time now = port_.now();
  if (pose_) {
    const Pose2d expected = control::travelled(*pose_, moves_.velocity, now - pose_seen_);
    jumped_ = jumped_ || !(distance(expected, pose) <= jump_m_);
  }
  pose_ = pose;
  pose_seen_ = now;
}

Result<> Posture::go_to(const position2d::PositionCommand& goal) {
  if (goal.motors_on == 0) {
    rest();
    return {};
  }
  if (!pose_ || port_.now() - pose_seen_ > pose_timeout_) {
    return Error{std::errc::operation_not_permitted, "there is no pose to go from: " + why_not(port_.now())};
  }
  if (goal_ == goal) return {};
  control::PostureRegulatorConfig config = config_;
  config.speed_limit_mps = limit_or(std::hypot(goal.velocity.x, goal.velocity.y), config.speed_limit_mps);
  config.turn_rate_limit_radps = limit_or(goal.velocity.w, config.turn_rate_limit_radps);
  regulator_ = control::PostureRegulator{config};
  obedience_.forgive();
  jumped_ = false;
  goal_ = goal;
  return {};
}

/// Why the destination has to be given up; empty: it has not.
std::string Posture::why_not(Time now) const {
  if (!pose_) return "none came yet";
  if (now - pose_seen_ > pose_timeout_) return "no pose for " + seconds_text(now - pose_seen_);
  if (jumped_) return "the pose jumped";
  return {};
}

Result<> Posture::read(const Tick& tick) {
  if (!goal_) return {};
  const bool speaks = moves_seen_ && tick.now - *moves_seen_ <= base_timeout;
  const bool obeys = obedience_.step(command_, speaks ? std::optional{moves_.velocity} : std::nullopt, tick.dt);
  std::string reason = why_not(tick.now);
  if (reason.empty() && !obeys) reason = "the base does not do what it is told: blocked, stopped, or driven by others";
  if (!reason.empty()) {
    goal_.reset();
    port_.stop(reason + ": destination given up");  // which ramps the velocity down
    return {};
  }
  const auto output = regulator_.step(*pose_, goal_->pose);
  const double most = accel_mps2_ * seconds(tick.dt);
  const double most_turn = turn_accel_radps2_ * seconds(tick.dt);
  command_.x += std::clamp(output.command.x - command_.x, -most, most);
  command_.w += std::clamp(output.command.w - command_.w, -most_turn, most_turn);
  arrived_.set(output.arrived);
  (void)base_.send(position2d::VelocityCommand{.velocity = command_});
  return {};
}

void Posture::publish() {
  if (pose_ && port_.now() - pose_seen_ <= pose_timeout_) {
    port_.send(position2d::State{.pose = *pose_, .velocity = moves_.velocity, .stalled = moves_.stalled});
  }
}

void Posture::rest() noexcept {
  if (goal_ || command_ != BodyVelocity{}) (void)base_.send(position2d::VelocityCommand{});
  goal_.reset();
  command_ = {};
  arrived_.set(false);
}

void Posture::halt() noexcept { rest(); }

}  // namespace regista
