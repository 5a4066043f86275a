// SPDX-License-Identifier: Apache-2.0
#include "simulated_base.hpp"

#include <algorithm>
#include <cmath>

namespace regista {

namespace {

constexpr double max_noise = 1;
constexpr double arrived_m = 0.001;  // nearer than this, only the heading is left to correct

sim::SimpleBaseParameters read_parameters(const Section& config, std::uint64_t seed) {
  const Range positive{.min = 1e-3};
  const double turn_drift = config.number("turn_drift", 0, {.min = 0});
  return {.holonomic = config.boolean("holonomic", true),
          .time_constant_s = config.number("time_constant", 0.05, {.min = 0}),
          .max_speed_mps = config.length("motor_speed", 1.5, positive),
          .max_turn_radps = config.angle("motor_turn", 6, positive),
          .max_accel_mps2 = config.length("motor_accel", 3, positive),
          .max_turn_accel_radps2 = config.angle("motor_turn_accel", 20, positive),
          .noise_m_per_root_m = config.number("drift", 0, {.min = 0}),
          .noise_rad_per_root_m = turn_drift,
          .noise_rad_per_root_rad = turn_drift,
          .seed = seed};
}

sim::SimpleBaseParameters without_noise(sim::SimpleBaseParameters parameters) {
  parameters.noise_m_per_root_m = parameters.noise_rad_per_root_m = parameters.noise_rad_per_root_rad = 0;
  return parameters;
}

Size3d read_size(const Section& config) {
  if (!config.has("size")) return {.width = 0.18, .length = 0.18, .height = 0.15};
  const auto size = config.lengths("size", {.min = 0.01});
  if (size.size() != 3) throw config.error("size", "must be three lengths: [length width height]");
  return {.width = size[1], .length = size[0], .height = size[2]};
}

/// A limit that a command names; 0 leaves it to the device.
double limit_or(double named, double own) { return named == 0 ? own : std::min(std::abs(named), own); }

/// The speed towards something `way` ahead that comes to rest there: proportional near it, so that the lag of the
/// motors does not make it swing (gain · lag ≤ 1/4: a loop of a lag and an integrator is then damped at least
/// critically), and with half of the deceleration farther off.
double approach(double way, double limit, double deceleration, double lag_s) {
  const double gain = lag_s > 0 ? std::min(3.0, 0.25 / lag_s) : 3.0;
  const double speed = std::min({gain * std::abs(way), std::sqrt(deceleration * std::abs(way)), limit});
  return std::copysign(speed, way);
}

}  // namespace

SimulatedBase::SimulatedBase(Setup& setup)
    : port_{setup.provide<Position2d>()},
      truth_port_{setup.provide<Position2d>("truth")},
      noise_{setup.property<double>("noise", setup.config.number("noise", 0, {.min = 0, .max = max_noise}),
                                    {.min = 0, .max = max_noise})},
      random_{static_cast<std::uint64_t>(setup.config.integer("seed", 1))},
      parameters_{read_parameters(setup.config, random_.fork())},
      base_{parameters_},
      truth_{without_noise(parameters_)},
      size_{read_size(setup.config)} {
  accept<position2d::VelocityCommand>();
  accept<position2d::PositionCommand>();
  accept<position2d::CarCommand>();
  accept<position2d::VelocityHeadingCommand>();

  port_.on<position2d::GetGeometry>(
      [this](const auto&) -> Result<position2d::Geometry> { return position2d::Geometry{.size = size_}; });
  port_.on<position2d::SetMotorPower>([this](const position2d::SetMotorPower& request) -> Result<Empty> {
    powered_ = request.on != 0;
    if (!powered_) halt();
    return Empty{};
  });
  // Every command says itself whether it is a velocity or a position: both modes are always on.
  port_.on<position2d::SetVelocityMode>([](const auto&) -> Result<Empty> { return Empty{}; });
  port_.on<position2d::SetPositionMode>([](const auto&) -> Result<Empty> { return Empty{}; });
  port_.on<position2d::SetOdometry>(
      [this](const position2d::SetOdometry& request) { return set_odometry(request.pose); });
  port_.on<position2d::ResetOdometry>([this](const auto&) { return set_odometry({}); });
}

template <typename Command>
void SimulatedBase::accept() {
  port_.on<Command>([this](const Command& command) -> Result<> {
    if (!powered_) return Error{std::errc::operation_not_permitted, "the motors are off: ask for MOTOR_POWER 1"};
    target_ = command;
    return {};
  });
}

Result<Empty> SimulatedBase::set_odometry(const Pose2d& pose) {
  odometry_from_field_ = pose * inverse(base_.state().pose);
  return Empty{};
}

BodyVelocity SimulatedBase::wanted(const position2d::VelocityCommand& command) const {
  return command.motors_on != 0 ? command.velocity : BodyVelocity{};
}

BodyVelocity SimulatedBase::wanted(const position2d::PositionCommand& command) const {
  if (command.motors_on == 0) return {};
  const Pose2d to_go = inverse(odometry()) * command.pose;
  const double way = std::hypot(to_go.x, to_go.y);
  const double bearing = std::atan2(to_go.y, to_go.x);
  const double lag = parameters_.time_constant_s;
  const double speed =
      approach(way, limit_or(std::hypot(command.velocity.x, command.velocity.y), parameters_.max_speed_mps),
               parameters_.max_accel_mps2, lag);
  const auto turn = [&](double angle) {
    return approach(angle, limit_or(command.velocity.w, parameters_.max_turn_radps), parameters_.max_turn_accel_radps2,
                    lag);
  };
  if (parameters_.holonomic) {
    return {.x = speed * std::cos(bearing), .y = speed * std::sin(bearing), .w = turn(to_go.heading)};
  }
  if (way < arrived_m) return {.w = turn(to_go.heading)};
  return {.x = speed * std::max(0.0, std::cos(bearing)), .w = turn(bearing)};
}

BodyVelocity SimulatedBase::wanted(const position2d::CarCommand& command) const {
  // The bicycle model, its axles as far apart as the base is long.
  return {.x = command.speed_mps, .w = command.speed_mps * std::tan(command.steering_rad) / size_.length};
}

BodyVelocity SimulatedBase::wanted(const position2d::VelocityHeadingCommand& command) const {
  return {.x = command.speed_mps,
          .w = approach(angle_between(odometry().heading, command.heading_rad), parameters_.max_turn_radps,
                        parameters_.max_turn_accel_radps2, parameters_.time_constant_s)};
}

Result<> SimulatedBase::read(const Tick& tick) {
  const BodyVelocity velocity = std::visit([this](const auto& command) { return wanted(command); }, target_);
  for (sim::SimpleBase* base : {&base_, &truth_}) {
    base->command(velocity);
    base->step(tick.dt);
  }
  return {};
}

void SimulatedBase::publish() {
  truth_port_.send(position2d::State{.pose = truth_.state().pose, .velocity = truth_.state().velocity});
  BodyVelocity velocity = base_.state().velocity;
  velocity.x += random_.normal(*noise_);
  velocity.y += random_.normal(*noise_);
  velocity.w += random_.normal(*noise_);
  port_.send(position2d::State{.pose = odometry(), .velocity = velocity});
}

void SimulatedBase::halt() noexcept {
  target_ = position2d::VelocityCommand{};
  for (sim::SimpleBase* base : {&base_, &truth_}) {
    base->command({});
    base->place(base->state().pose);
  }
}

}  // namespace regista
