// SPDX-License-Identifier: Apache-2.0
#include "differential.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <regista/control/calibration.hpp>
#include <sstream>

namespace regista {

namespace {

using namespace std::chrono_literals;

// The angle of a wheel may roll over after so much, so that it stays exact as a float; see CanMotor.
constexpr double roll_over_rad = 512 * 2 * std::numbers::pi;

struct Radii {
  double left_m;
  double right_m;
};

Radii read_radii(const Section& config) {
  const std::vector<double> radii = config.lengths("wheel_radius", {.min = 1e-4});
  if (radii.empty() || radii.size() > 2) throw config.error("wheel_radius", "must be one length, or two: left right");
  return {radii.front(), radii.back()};
}

Size3d read_size(const Section& config, double track_m) {
  if (!config.has("size")) return {.width = track_m, .length = track_m, .height = 0.3};
  const auto size = config.lengths("size", {.min = 0.01});
  if (size.size() != 3) throw config.error("size", "must be three lengths: [length width height]");
  return {.width = size[1], .length = size[0], .height = size[2]};
}

control::Kinematics kinematics_of(bool skid_steer, double track_m) {
  return skid_steer ? control::Kinematics::skid_steer(track_m) : control::Kinematics::differential(track_m);
}

/// On the ramp from `now` to `wanted`: away from 0 with `faster`, towards it with `slower`.
double ramp(double now, double wanted, double faster, double slower) {
  const bool away = now * wanted >= 0 && std::abs(wanted) > std::abs(now);
  const double step = away ? faster : slower;
  return now + std::clamp(wanted - now, -step, step);
}

}  // namespace

Differential::Differential(Setup& setup)
    : base_{setup.provide<Position2d>()},
      wheels_{setup.require<Actarray>()},
      calibrate_{setup.property<std::string>("calibrate", "")},
      calibration_{setup.property<std::string>("calibration", "", {.read_only = true})},
      slip_{setup.property<double>("slip", 0, {.read_only = true})},
      skid_steer_{setup.config.boolean("skid_steer", false)},
      count_{skid_steer_ ? 4U : 2U},
      left_radius_m_{read_radii(setup.config).left_m},
      right_radius_m_{read_radii(setup.config).right_m},
      track_m_{setup.config.length("track", {.min = 1e-3})},
      kinematics_{kinematics_of(skid_steer_, track_m_)},
      accel_mps2_{setup.config.length("accel", 1, {.min = 1e-3})},
      decel_mps2_{setup.config.length("decel", accel_mps2_, {.min = 1e-3})},
      turn_accel_radps2_{setup.config.angle("turn_accel", 3, {.min = 1e-3})},
      timeout_{setup.config.duration("wheels_timeout", 250ms, {.min = 0.02})},
      size_{read_size(setup.config, track_m_)} {
  set_dimensions(left_radius_m_, right_radius_m_, track_m_);
  calibrate_.on_change([this] { calibrate(); });
  wheels_.on_data<actarray::State>([this](const actarray::State& state, Time measured) { on_wheels(state, measured); });
  base_.on<position2d::VelocityCommand>([this](const position2d::VelocityCommand& command) -> Result<> {
    if (!before_) return Error{std::errc::not_connected, "the wheels have told nothing yet"};
    if (!powered_) return Error{std::errc::operation_not_permitted, "the motors are off: ask for MOTOR_POWER 1"};
    target_ = command.motors_on != 0 ? BodyVelocity{.x = command.velocity.x, .w = command.velocity.w} : BodyVelocity{};
    return {};
  });
  base_.on<position2d::GetGeometry>(
      [this](const auto&) -> Result<position2d::Geometry> { return position2d::Geometry{.size = size_}; });
  base_.on<position2d::SetMotorPower>([this](const position2d::SetMotorPower& request, Responder<Empty> responder) {
    target_ = commanded_ = {};
    const auto to = std::make_shared<Responder<Empty>>(std::move(responder));
    const bool asked =
        wheels_.connected() &&
        wheels_.request(actarray::SetPower{request.on}, [to](const Result<Empty>& answer) { to->answer(answer); });
    if (!asked) to->answer(Error{std::errc::not_connected, "the wheels are not connected"});
  });
  // Every command is a velocity: the mode is always on.
  base_.on<position2d::SetVelocityMode>([](const auto&) -> Result<Empty> { return Empty{}; });
  base_.on<position2d::SetOdometry>(
      [this](const position2d::SetOdometry& request) { return set_odometry(request.pose); });
  base_.on<position2d::ResetOdometry>([this](const auto&) { return set_odometry({}); });
}

Result<Empty> Differential::set_odometry(const Pose2d& pose) {
  pose_ = pose;
  return Empty{};
}

void Differential::set_dimensions(double left_radius_m, double right_radius_m, double track_m) {
  left_radius_m_ = left_radius_m;
  right_radius_m_ = right_radius_m;
  track_m_ = track_m;
  kinematics_ = kinematics_of(skid_steer_, track_m);
  std::ostringstream text;
  text << "wheel_radius [" << left_radius_m << ' ' << right_radius_m << "] track " << track_m;
  calibration_.set(text.str());
}

Result<> Differential::open() {
  before_.reset();
  asked_ = false;
  target_ = commanded_ = velocity_ = {};
  at_rest_ = true;
  powered_ = false;  // or what the last user switched off would stop this one
  return {};
}

BodyVelocity Differential::body(const Sides& radps) const {
  const double left = left_radius_m_ * radps.left;
  const double right = right_radius_m_ * radps.right;
  return {.x = (left + right) / 2, .w = (right - left) / track_m_};
}

void Differential::on_wheels(const actarray::State& state, Time measured) {
  if (state.actuators.size() != count_) return;
  const auto sides = [&](const auto& of) {
    Sides sum;
    for (std::size_t i = 0; i < count_; ++i) (i % 2 == 0 ? sum.left : sum.right) += of(i);
    return Sides{2 * sum.left / static_cast<double>(count_), 2 * sum.right / static_cast<double>(count_)};
  };
  if (before_) {
    bool jumped = false;
    const double most_rad = 2 * fastest_radps_ * seconds(measured - measured_) + 1;
    const auto turned = [&](std::size_t i) {
      const double rad = std::remainder(
          static_cast<double>(state.actuators[i].position) - static_cast<double>(before_->actuators[i].position),
          roll_over_rad);
      jumped = jumped || (fastest_radps_ > 0 && std::abs(rad) > most_rad);
      return rad;
    };
    const Sides way = sides(turned);
    if (jumped) {
      base_.tell(1,
                 "position2d: the wheels' angles jumped, as when their driver starts anew; this is no way travelled");
    } else {
      pose_ = control::travelled(pose_, body(way), 1s);  // a way is a velocity times 1 s
      if (run_) run_ = Sides{run_->left + way.left, run_->right + way.right};
    }
  }
  velocity_ = body(sides([&](std::size_t i) { return static_cast<double>(state.actuators[i].speed); }));
  if (skid_steer_) {
    control::WheelSpeeds rims(count_);
    for (std::size_t i = 0; i < count_; ++i) {
      rims[i] = (i % 2 == 0 ? left_radius_m_ : right_radius_m_) * static_cast<double>(state.actuators[i].speed);
    }
    slip_.set(kinematics_.slip(rims));
  }
  const bool was_powered = std::exchange(powered_, state.motors_on != 0);
  if (was_powered && !powered_) {
    target_ = commanded_ = {};
    at_rest_ = true;  // their driver does not listen any more
    base_.stop("the wheels' motors are off");
  }
  before_ = state;
  measured_ = measured;
  const bool stalled = std::ranges::any_of(
      state.actuators, [](const actarray::Actuator& wheel) { return wheel.state == actarray::ActuatorState::stalled; });
  // At once, not with the next beat: whoever steers by it waits for it.
  base_.send(position2d::State{.pose = pose_, .velocity = velocity_, .stalled = static_cast<std::uint8_t>(stalled)},
             measured_);
}

Result<> Differential::read(const Tick& tick) {
  now_ = tick.now;
  if (!asked_ && wheels_.connected()) {
    asked_ = wheels_.request(actarray::GetGeometry{}, [this](const Result<actarray::Geometry>& geometry) {
      if (!geometry) {
        asked_ = false;
        return;
      }
      if (geometry->actuators.size() != count_) {
        base_.tell(2, "position2d: the wheels are " + std::to_string(geometry->actuators.size()) + ", not " +
                          std::to_string(count_) + ": see 'skid_steer'");
        return;
      }
      fastest_radps_ = static_cast<double>(geometry->actuators.front().speed);
    });
  }
  if (!before_) return {};
  if (now_ - measured_ > timeout_ && (target_ != BodyVelocity{} || commanded_ != BodyVelocity{})) {
    target_ = commanded_ = {};
    base_.stop("no data of the wheels for " + std::to_string((now_ - measured_) / 1ms) + " ms");
  }
  const double dt = seconds(tick.dt);
  commanded_.x = ramp(commanded_.x, target_.x, accel_mps2_ * dt, decel_mps2_ * dt);
  commanded_.w = ramp(commanded_.w, target_.w, turn_accel_radps2_ * dt, turn_accel_radps2_ * dt);
  command_wheels();
  return {};
}

void Differential::command_wheels() {
  const bool rest = commanded_ == BodyVelocity{} && target_ == BodyVelocity{};
  if (rest && at_rest_) return;  // wheels that stand need no commands, and others may turn them
  control::WheelSpeeds rims = kinematics_.wheels(commanded_);
  if (fastest_radps_ > 0) {
    rims = control::saturated(rims, fastest_radps_ * std::min(left_radius_m_, right_radius_m_));
  }
  actarray::MultiSpeedCommand command;
  for (std::size_t i = 0; i < count_; ++i) {
    command.speeds.push_back(static_cast<float>(rims[i] / (i % 2 == 0 ? left_radius_m_ : right_radius_m_)));
  }
  if (wheels_.send(command)) at_rest_ = rest;
}

void Differential::halt() noexcept {
  target_ = commanded_ = {};
  if (!at_rest_) command_wheels();
}

void Differential::calibrate() {
  std::istringstream words{*calibrate_};
  std::string what;
  words >> what;
  const auto refuse = [this](const std::string& why) { base_.tell(1, "calibrate: " + why); };
  const auto number = [&](double& value) { return static_cast<bool>(words >> value) && std::isfinite(value); };
  if (what == "start") {
    run_ = Sides{};
    return;
  }
  if (what == "umbmark") {
    double side_m = 0;
    control::SquareError cw;
    control::SquareError ccw;
    if (!number(side_m) || !number(cw.x_m) || !number(cw.y_m) || !number(ccw.x_m) || !number(ccw.y_m)) {
      return refuse("umbmark takes the side and four errors, clockwise X Y, counter-clockwise X Y, in metres");
    }
    const auto found = control::umbmark(left_radius_m_, right_radius_m_, track_m_, side_m, cw, ccw);
    if (!found) return refuse(found.error().what);
    set_dimensions(found->left_radius_m, found->right_radius_m, found->track_m);
    base_.tell(0, "position2d: calibrated: " + *calibration_);
    return;
  }
  double known = 0;
  if (!run_ || !number(known) || known == 0)
    return refuse("write \"start\", drive, then \"distance 5\" or \"angle 62.83\"");
  const BodyVelocity way = body(*run_);
  if (what == "distance") {
    if (way.x * known <= 0 || std::abs(way.w) > 0.2) return refuse("the base did not drive straight on, that way");
    const double scale = known / way.x;
    if (scale < 0.5 || scale > 2) return refuse("that would change the radius by more than a factor of 2");
    set_dimensions(left_radius_m_ * scale, right_radius_m_ * scale, track_m_);
  } else if (what == "angle") {
    if (way.w * known <= 0) return refuse("the base did not turn that way");
    const double scale = way.w / known;
    if (scale < 0.25 || scale > 4) return refuse("that would change the track by more than a factor of 4");
    set_dimensions(left_radius_m_, right_radius_m_, track_m_ * scale);
  } else {
    return refuse("no \"" + what + "\"; there are \"start\", \"distance\", \"angle\" and \"umbmark\"");
  }
  run_.reset();
  base_.tell(0, "position2d: calibrated: " + *calibration_);
}

}  // namespace regista
