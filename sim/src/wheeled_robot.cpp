// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>
#include <regista/sim/wheeled_robot.hpp>
#include <string>

#include "require.hpp"
#include "sub_steps.hpp"

namespace regista::sim {
namespace {

constexpr double gravity_mps2 = 9.80665;
constexpr double longest_sub_step_s = 0.0005;

void check(const WheeledRobotParameters& p) {
  require(!p.wheels.empty() && p.wheels.size() <= WheeledRobot::max_wheels, "wheels",
          static_cast<double>(p.wheels.size()), "give one to eight");
  for (std::size_t i = 0; i < p.wheels.size(); ++i) {
    const Wheel& wheel = p.wheels[i];
    const auto name = [i](const char* field) { return "wheels[" + std::to_string(i) + "]." + field; };
    require(true, name("x_m"), wheel.x_m, "give a number");
    require(true, name("y_m"), wheel.y_m, "give a number");
    require(true, name("drive_rad"), wheel.drive_rad, "give a number");
    require_positive(name("radius_m"), wheel.radius_m);
    require_positive(name("gear"), wheel.gear);
    require_not_negative(name("inertia_kg_m2"), wheel.inertia_kg_m2);
    require_not_negative(name("coulomb_nm"), wheel.coulomb_nm);
    require_not_negative(name("viscous_nm_s"), wheel.viscous_nm_s);
    require_not_negative(name("sideways"), wheel.sideways);
  }
  require_positive("mass_kg", p.mass_kg);
  require_positive("inertia_kg_m2", p.inertia_kg_m2);
  require_positive("motor.nominal_v", p.motor.nominal_v);
  require_positive("motor.resistance_ohm", p.motor.resistance_ohm);
  require_positive("motor.torque_constant_nm_per_a", p.motor.torque_constant_nm_per_a);
  require_positive("motor.inertia_kg_m2", p.motor.inertia_kg_m2);
  require_not_negative("motor.no_load_a", p.motor.no_load_a);
  require(p.motor.no_load_radps() > 0, "motor.no_load_a", p.motor.no_load_a,
          "give less than nominal_v / resistance_ohm");
  require_not_negative("loop.p", p.loop.p);
  require_not_negative("loop.i_per_s", p.loop.i_per_s);
  require(p.loop.period_s >= longest_sub_step_s, "loop.period_s", p.loop.period_s, "give at least 0.0005");
  require_not_negative("loop.reset_at_jump", p.loop.reset_at_jump);
  require(p.loop.triggers_per_revolution > 0, "loop.triggers_per_revolution", p.loop.triggers_per_revolution,
          "give 1 or more");
  require_positive("loop.stall_s", p.loop.stall_s);
  require_not_negative("hop_s", p.hop_s);
  require_not_negative("grip", p.grip);
  // Above this the contacts, whose forces act one sub-step late on the body, stay stable.
  const double least_creep = 2 * p.grip * gravity_mps2 * longest_sub_step_s;
  require(p.creep_mps > 0 && p.creep_mps >= least_creep, "creep_mps", p.creep_mps,
          "give at least " + std::to_string(least_creep));
  require_not_negative("rough_nm", p.rough_nm);
  require_positive("rough_s", p.rough_s);
}

}  // namespace

Wheel omni_wheel(double angle_rad, double distance_m) {
  return {.x_m = distance_m * std::cos(angle_rad),
          .y_m = distance_m * std::sin(angle_rad),
          .drive_rad = angle_rad + std::numbers::pi / 2,
          .sideways = 0.05};
}

WheeledRobotParameters ssl_robot() {
  WheeledRobotParameters parameters;
  for (int k = 0; k < 4; ++k) parameters.wheels.push_back(omni_wheel(std::numbers::pi / 4 * (2 * k + 1), 0.08));
  return parameters;
}

WheeledRobotParameters used_ssl_robot(std::uint64_t seed) {
  WheeledRobotParameters robot = ssl_robot();
  constexpr std::array off_centre_m{0.002, -0.003, 0.004, -0.001};
  constexpr std::array gear_friction_nm{0.0, 0.065, 0.0, 0.025};
  for (std::size_t i = 0; i < robot.wheels.size(); ++i) {
    robot.wheels[i].x_m += off_centre_m[i];
    robot.wheels[i].y_m -= off_centre_m[(i + 1) % 4];
    robot.wheels[i].coulomb_nm = gear_friction_nm[i];
  }
  robot.rough_nm = 0.03;
  robot.seed = seed;
  return robot;
}

WheeledRobotParameters skid_steer_robot(double track_m, double wheelbase_m, double mass_kg) {
  WheeledRobotParameters parameters{.mass_kg = mass_kg,
                                    .inertia_kg_m2 = mass_kg * (track_m * track_m + wheelbase_m * wheelbase_m) / 12};
  for (const double x : {wheelbase_m / 2, -wheelbase_m / 2}) {
    for (const double y : {track_m / 2, -track_m / 2}) parameters.wheels.push_back({.x_m = x, .y_m = y});
  }
  return parameters;
}

WheeledRobotParameters differential_robot(double track_m, double mass_kg) {
  WheeledRobotParameters parameters{.mass_kg = mass_kg, .inertia_kg_m2 = mass_kg * track_m * track_m / 6};
  for (const double y : {track_m / 2, -track_m / 2}) parameters.wheels.push_back({.y_m = y});
  return parameters;
}

WheeledRobot::WheeledRobot(const WheeledRobotParameters& parameters)
    : parameters_{(check(parameters), parameters)}, random_{parameters.seed}, battery_{parameters.battery} {
  for (const Wheel& wheel : parameters.wheels) {
    const double c = std::cos(wheel.drive_rad);
    const double s = std::sin(wheel.drive_rad);
    wheels_.push_back({.wheel = wheel,
                       .cos_drive = c,
                       .sin_drive = s,
                       .lever_m = wheel.x_m * s - wheel.y_m * c,
                       .cross_lever_m = wheel.x_m * c + wheel.y_m * s,
                       .inertia_kg_m2 = wheel.inertia_kg_m2 + parameters.motor.inertia_kg_m2 * wheel.gear * wheel.gear,
                       .loop = SpeedLoop{parameters.loop, parameters.motor.no_load_radps()}});
    wheels_.back().rough_nm = random_.normal(parameters.rough_nm);
  }
}

void WheeledRobot::command(std::span<const double> wheel_radps) {
  assert(wheel_radps.size() == wheels_.size());
  for (std::size_t i = 0; i < std::min(wheel_radps.size(), wheels_.size()); ++i)
    input_[i] = std::isfinite(wheel_radps[i]) ? wheel_radps[i] : 0;
}

void WheeledRobot::place(const Pose2d& pose, const BodyVelocity& velocity) {
  state_.pose = pose;
  state_.velocity = velocity;
  for (std::size_t i = 0; i < wheels_.size(); ++i) {
    const Drive& drive = wheels_[i];
    state_.wheels[i].speed_radps =
        (drive.cos_drive * velocity.x + drive.sin_drive * velocity.y + drive.lever_m * velocity.w) /
        drive.wheel.radius_m;
  }
}

const WheeledRobot::State& WheeledRobot::step(Duration dt) {
  const SubSteps steps{dt, longest_sub_step_s};
  if (steps.count > 0) state_.accel_x_mps2 = state_.accel_y_mps2 = 0;
  for (int i = 0; i < steps.count; ++i) {
    run_boards(steps.length_s);
    const auto [accel_x, accel_y] = sub_step(steps.length_s);
    state_.accel_x_mps2 += accel_x / steps.count;
    state_.accel_y_mps2 += accel_y / steps.count;
  }
  return state_;
}

void WheeledRobot::run_boards(double h) {
  until_hop_s_ -= h;
  if (until_hop_s_ <= 0) {
    until_hop_s_ += std::max(h, parameters_.hop_s);
    std::copy_backward(chain_.begin(), chain_.end() - 1, chain_.end());
    chain_[0] = input_;
  }
  until_loop_s_ -= h;
  if (until_loop_s_ > 0) return;
  until_loop_s_ += parameters_.loop.period_s;
  const double rough_kept = std::exp(-parameters_.loop.period_s / parameters_.rough_s);
  const double rough_sd = parameters_.rough_nm * std::sqrt(1 - rough_kept * rough_kept);
  for (std::size_t i = 0; i < wheels_.size(); ++i) {
    if (rough_sd > 0) wheels_[i].rough_nm = rough_kept * wheels_[i].rough_nm + random_.normal(rough_sd);
    const Targets& target = parameters_.hop_s > 0 ? chain_[i] : input_;
    wheels_[i].duty = wheels_[i].loop.duty(target[i] * wheels_[i].wheel.gear);
  }
}

std::array<double, 2> WheeledRobot::sub_step(double h) {
  const MotorParameters& motor = parameters_.motor;
  const double supply_v = battery_.voltage_v();
  const double load_n = parameters_.mass_kg * gravity_mps2 / static_cast<double>(wheels_.size());
  const double k2_over_r = motor.torque_constant_nm_per_a * motor.torque_constant_nm_per_a / motor.resistance_ohm;
  const double creep2 = parameters_.creep_mps * parameters_.creep_mps;

  BodyVelocity& v = state_.velocity;
  auto [force_x, force_y, torque] = push_;
  double supply_a = 0;
  for (std::size_t i = 0; i < wheels_.size(); ++i) {
    Drive& drive = wheels_[i];
    WheelState& wheel = state_.wheels[i];
    const double radius = drive.wheel.radius_m;
    const double gear = drive.wheel.gear;
    const double v_along = drive.cos_drive * v.x + drive.sin_drive * v.y + drive.lever_m * v.w;
    const double v_across = -drive.sin_drive * v.x + drive.cos_drive * v.y + drive.cross_lever_m * v.w;

    // Contact: force = stiffness · slip, from the potential μN √(slip² + (sideways · across)² + creep²).
    const double slip = wheel.speed_radps * radius - v_along;
    const double shared = drive.wheel.sideways * v_across;
    const double stiffness = parameters_.grip * load_n / std::sqrt(slip * slip + shared * shared + creep2);

    // Wheel, implicit in its own speed, so that the stiff contact sets no limit on the step.
    const double volts = drive.duty * supply_v;
    const double damping = gear * gear * k2_over_r + drive.wheel.viscous_nm_s + stiffness * radius * radius;
    const double drive_nm =
        gear * motor.torque_constant_nm_per_a * volts / motor.resistance_ohm + stiffness * radius * v_along;
    const double friction_nm = std::max(0.0, gear * motor.friction_nm() + drive.wheel.coulomb_nm + drive.rough_nm);
    const double per_h = drive.inertia_kg_m2 / h;
    const double impulse = per_h * wheel.speed_radps + drive_nm;  // friction takes from it, down to rest at most
    const double before = wheel.speed_radps;
    wheel.speed_radps = std::copysign(std::max(0.0, std::abs(impulse) - friction_nm), impulse) / (per_h + damping);
    wheel.angle_rad += h * (before + wheel.speed_radps) / 2;
    wheel.slip_mps = wheel.speed_radps * radius - v_along;
    wheel.force_n = stiffness * wheel.slip_mps;
    wheel.motor_a = (volts - motor.torque_constant_nm_per_a * gear * wheel.speed_radps) / motor.resistance_ohm;
    supply_a += drive.duty * wheel.motor_a;
    drive.loop.see(wheel.angle_rad * gear, h);
    wheel.measured_radps = drive.loop.speed_radps() / gear;
    wheel.count = drive.loop.count();

    const double across_n = -stiffness * drive.wheel.sideways * shared;
    force_x += drive.cos_drive * wheel.force_n - drive.sin_drive * across_n;
    force_y += drive.sin_drive * wheel.force_n + drive.cos_drive * across_n;
    torque += drive.lever_m * wheel.force_n + drive.cross_lever_m * across_n;
  }
  battery_.draw(supply_a, from_seconds(h));

  // Newton in the field frame, where a free body's velocity stays as it is.
  const double accel_x = force_x / parameters_.mass_kg;
  const double accel_y = force_y / parameters_.mass_kg;
  const BodyVelocity old = v;
  const double new_w = old.w + h * torque / parameters_.inertia_kg_m2;
  const double turn = h * (old.w + new_w) / 2;
  FieldVelocity field = to_field(old, state_.pose.heading);
  const FieldVelocity change =
      to_field(BodyVelocity{.x = h * accel_x, .y = h * accel_y}, state_.pose.heading + turn / 2);
  state_.pose.x += h * (field.x + change.x / 2);
  state_.pose.y += h * (field.y + change.y / 2);
  field.x += change.x;
  field.y += change.y;
  field.w = new_w;
  state_.pose.heading = wrap_angle(state_.pose.heading + turn);
  v = to_body(field, state_.pose.heading);
  return {accel_x, accel_y};
}

}  // namespace regista::sim
