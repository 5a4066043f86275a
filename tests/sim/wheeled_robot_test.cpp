// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/sim/wheeled_robot.hpp>

#include <chrono>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

namespace regista::sim {
namespace {

using namespace std::chrono_literals;
constexpr double pi = std::numbers::pi;

// A loop that gives full voltage until the robot is as fast as `flat_out`, which it never is.
constexpr double flat_out = 1e6;
constexpr SpeedLoopParameters full_throttle{.p = 1e9, .i_per_s = 0};
constexpr BatteryParameters stiff_12_v{.full_v = 12, .empty_v = 12, .resistance_ohm = 0};

// Without the chain's delay all wheels start at once, and the robot does not wag.
WheeledRobotParameters in_step(WheeledRobotParameters parameters) {
  parameters.hop_s = 0;
  return parameters;
}

double kinetic_energy_j(const WheeledRobotParameters& p, const WheeledRobot::State& s) {
  double energy = 0.5 * p.mass_kg * (s.velocity.x * s.velocity.x + s.velocity.y * s.velocity.y) +
                  0.5 * p.inertia_kg_m2 * s.velocity.w * s.velocity.w;
  for (std::size_t i = 0; i < p.wheels.size(); ++i) {
    const Wheel& wheel = p.wheels[i];
    const double inertia = wheel.inertia_kg_m2 + p.motor.inertia_kg_m2 * wheel.gear * wheel.gear;
    energy += 0.5 * inertia * s.wheels[i].speed_radps * s.wheels[i].speed_radps;
  }
  return energy;
}

TEST(SslRobot, wheels_that_turn_forward_turn_it_counter_clockwise) {
  WheeledRobot robot{in_step(ssl_robot())};
  robot.command(std::array{5.0, 5.0, 5.0, 5.0});
  EXPECT_GT(robot.step(1s).velocity.w, 1);
  EXPECT_NEAR(robot.state().velocity.x, 0, 1e-9);
  EXPECT_NEAR(robot.state().velocity.y, 0, 1e-9);
}

TEST(SslRobot, drives_ahead_when_the_wheels_on_its_left_turn_backward_and_those_on_its_right_forward) {
  WheeledRobot robot{in_step(ssl_robot())};  // wheels at 45° and 135° on the left, at 225° and 315° on the right
  robot.command(std::array{-5.0, -5.0, 5.0, 5.0});
  EXPECT_GT(robot.step(1s).pose.x, 0.02);
  EXPECT_NEAR(robot.state().pose.y, 0, 1e-3);  // the encoders' first edges are not equally far away
  EXPECT_NEAR(robot.state().pose.heading, 0, 0.01);
}

TEST(SkidSteerRobot, turns_left_when_its_right_wheels_turn_forward) {
  WheeledRobot robot{skid_steer_robot(0.4, 0.3, 10)};
  robot.command(std::array{-10.0, 10.0, -10.0, 10.0});
  EXPECT_GT(robot.step(2s).pose.heading, 0.1);
}

TEST(SkidSteerRobot, turns_slower_than_a_differential_robot_with_the_same_track) {
  WheeledRobot skid{skid_steer_robot(0.4, 0.3, 5)};
  WheeledRobot differential{differential_robot(0.4, 5)};
  skid.command(std::array{0.0, 10.0, 0.0, 10.0});
  differential.command(std::array{0.0, 10.0});
  skid.step(3s);
  differential.step(3s);
  const auto effective_track = [](const WheeledRobot& robot) {  // from the true wheel speeds
    const auto& s = robot.state();
    return 0.035 * (s.wheels[1].speed_radps - s.wheels[0].speed_radps) / s.velocity.w;
  };
  EXPECT_NEAR(effective_track(differential), 0.4, 0.02);
  EXPECT_GT(effective_track(skid), 0.44);
}

TEST(Motor, no_load_speed_and_stall_torque_are_near_the_data_sheets) {
  EXPECT_NEAR(faulhaber_2342_012_cr.no_load_radps() * 60 / (2 * pi), 8100, 0.05 * 8100);
  EXPECT_NEAR(faulhaber_2342_012_cr.torque_constant_nm_per_a * 12 / 1.9, 80e-3, 0.08 * 80e-3);
}

// With all wheels turning it on the spot the robot is one flywheel, whose speed and time constant have closed forms.
TEST(SslRobot, spins_up_as_the_closed_form_of_its_motors_says) {
  WheeledRobotParameters p = ssl_robot();
  p.loop = full_throttle;
  p.battery = stiff_12_v;
  p.hop_s = 0;
  p.grip = 5;  // rubber on a rack: no slip at full torque
  p.creep_mps = 0.05;
  WheeledRobot robot{p};
  robot.command(std::array{flat_out, flat_out, flat_out, flat_out});
  const double g = 9, k = p.motor.torque_constant_nm_per_a, r = p.motor.resistance_ohm;
  const double steady = p.motor.no_load_radps() / g;  // of a wheel: friction is the motor's alone, contacts idle
  const double inertia = 2e-5 + p.motor.inertia_kg_m2 * g * g + p.inertia_kg_m2 / 4 * std::pow(0.035 / 0.08, 2);
  const double time_constant_s = inertia * r / (g * g * k * k);
  robot.step(from_seconds(time_constant_s));
  EXPECT_NEAR(robot.state().wheels[0].speed_radps, steady * (1 - std::exp(-1)), 0.02 * steady);
  robot.step(5s);
  EXPECT_NEAR(robot.state().wheels[0].speed_radps, steady, 1e-3 * steady);
  EXPECT_NEAR(robot.state().velocity.w * 0.08, steady * 0.035, 1e-3 * steady * 0.035);
  EXPECT_NEAR(robot.state().wheels[0].motor_a, p.motor.no_load_a, 1e-3);
}

TEST(SslRobot, puts_all_electric_energy_into_heat_friction_slip_and_motion) {
  WheeledRobotParameters p = ssl_robot();
  p.loop = full_throttle;
  p.battery = stiff_12_v;
  WheeledRobot robot{p};
  robot.command(std::array{-flat_out, -flat_out, flat_out, flat_out});
  double electric = 0, copper = 0, friction = 0, slip = 0;
  constexpr double h = 0.0005;
  for (int i = 0; i < 1000; ++i) {
    const auto before = robot.state();
    const auto& s = robot.step(500us);
    electric += robot.battery().voltage_v() * robot.battery().current_a() * h;
    for (std::size_t w = 0; w < 4; ++w) {
      const double speed = (before.wheels[w].speed_radps + s.wheels[w].speed_radps) / 2;
      copper += p.motor.resistance_ohm * s.wheels[w].motor_a * s.wheels[w].motor_a * h;
      friction += 9 * p.motor.friction_nm() * std::abs(speed) * h;
      slip += s.wheels[w].force_n * s.wheels[w].slip_mps * h;
    }
  }
  const double motion = kinetic_energy_j(p, robot.state());
  EXPECT_GT(motion, 1);
  EXPECT_NEAR(electric, copper + friction + slip + motion, 0.02 * electric);
}

TEST(SslRobot, accelerates_no_faster_than_grip_allows) {
  WheeledRobotParameters p = ssl_robot();
  p.loop = full_throttle;
  p.battery = stiff_12_v;
  p.hop_s = 0;
  p.grip = 0.1;
  WheeledRobot robot{p};
  robot.command(std::array{-flat_out, -flat_out, flat_out, flat_out});
  // Four wheels at 45°: cos 45° of μmg, once the wheels spin.
  robot.step(100ms);
  const double before = robot.state().velocity.x;
  robot.step(100ms);
  EXPECT_NEAR((robot.state().velocity.x - before) / 0.1, 0.1 * 9.80665 * std::sqrt(0.5), 0.01);
  EXPECT_GT(robot.state().wheels[3].slip_mps, 1);
}

TEST(SslRobot, slides_without_wheel_grip_as_a_free_body_keeps_momentum_and_energy) {
  WheeledRobotParameters p = ssl_robot();
  p.grip = 0;
  WheeledRobot robot{p};
  robot.place({}, {.x = 1, .y = 0.5, .w = 3});
  robot.step(2s);
  const FieldVelocity v = to_field(robot.state().velocity, robot.state().pose.heading);
  EXPECT_NEAR(v.x, 1, 1e-9);
  EXPECT_NEAR(v.y, 0.5, 1e-9);
  EXPECT_NEAR(v.w, 3, 1e-9);
  EXPECT_NEAR(robot.state().pose.x, 2, 1e-9);
  EXPECT_NEAR(robot.state().pose.y, 1, 1e-9);
}

TEST(SslRobot, pushed_on_ice_gains_force_times_time_over_mass) {
  WheeledRobotParameters p = ssl_robot();
  p.grip = 0;
  WheeledRobot robot{p};
  robot.push(6, 0, 0.02);
  robot.step(500ms);
  const FieldVelocity v = to_field(robot.state().velocity, robot.state().pose.heading);
  EXPECT_NEAR(v.w, 0.02 / p.inertia_kg_m2 * 0.5, 1e-9);
  EXPECT_NEAR(robot.state().accel_x_mps2, 2, 1e-12);
  // The push turns with the body: v = ∫ F/m (cos θ, sin θ) dt with θ = t².
  double x = 0, y = 0;
  for (int i = 0; i < 5000; ++i) {
    const double t = (i + 0.5) * 1e-4;
    x += 2 * std::cos(t * t) * 1e-4;
    y += 2 * std::sin(t * t) * 1e-4;
  }
  EXPECT_NEAR(v.x, x, 1e-4);
  EXPECT_NEAR(v.y, y, 1e-4);
}

TEST(DifferentialRobot, rolls_out_by_the_closed_form_of_its_friction) {
  WheeledRobotParameters p = differential_robot(0.3, 3);
  p.loop = {.p = 0, .i_per_s = 0};  // terminals shorted: duty 0 brakes by the back-EMF
  p.creep_mps = 0.006;
  WheeledRobot robot{p};
  robot.place({}, {.x = 1});
  // m_eff dv/dt = -n (g² k²/R v/r² + g M_f / r)
  const double r = 0.035, g = 9, k = p.motor.torque_constant_nm_per_a;
  const double m_eff = 3 + 2 * (2e-5 + p.motor.inertia_kg_m2 * g * g) / (r * r);
  const double b = 2 * g * g * k * k / p.motor.resistance_ohm / (r * r);
  const double f = 2 * g * p.motor.friction_nm() / r;
  const double stop_s = m_eff / b * std::log(1 + b / f);
  const double way_m = m_eff / b * (1 - f / b * std::log(1 + b / f));
  robot.step(from_seconds(2 * stop_s));
  EXPECT_NEAR(robot.state().pose.x, way_m, 0.01 * way_m);
  EXPECT_NEAR(robot.state().velocity.x, 0, 1e-6);
}

TEST(SslRobot, does_not_move_by_itself) {
  WheeledRobotParameters p = ssl_robot();
  p.rough_nm = 0.002;
  WheeledRobot robot{p};
  robot.step(5s);
  EXPECT_EQ(robot.state().pose, Pose2d{});
}

TEST(SslRobot, a_command_reaches_board_k_after_k_plus_one_hops) {
  WheeledRobotParameters p = ssl_robot();
  p.hop_s = 0.01;
  WheeledRobot robot{p};
  robot.step(5ms);
  robot.command(std::array{20.0, 20.0, 20.0, 20.0});
  std::array<int, 4> began_ms{};
  for (int ms = 1; ms <= 60; ++ms) {
    robot.step(1ms);
    for (std::size_t i = 0; i < 4; ++i) {
      if (began_ms[i] == 0 && robot.state().wheels[i].motor_a > 0.5) began_ms[i] = ms;
    }
  }
  for (std::size_t i = 1; i < 4; ++i) EXPECT_NEAR(began_ms[i] - began_ms[i - 1], 10, 1);
}

TEST(SpeedLoop, reads_the_speed_from_the_time_between_edges_and_0_after_a_stall) {
  const SpeedLoopParameters parameters;
  SpeedLoop loop{parameters, 800};
  double angle = 0;
  for (int i = 0; i < 1000; ++i) loop.see(angle -= 20 * 0.0005, 0.0005);
  EXPECT_NEAR(loop.speed_radps(), -20, 1e-9);
  EXPECT_EQ(loop.count(), static_cast<std::int64_t>(std::floor(-10 / (2 * pi) * 16)));
  for (int i = 0; i < 150; ++i) loop.see(angle, 0.0005);
  EXPECT_NEAR(loop.speed_radps(), -20, 1e-9);  // an old reading lives until the stall timer
  for (int i = 0; i < 60; ++i) loop.see(angle, 0.0005);
  EXPECT_EQ(loop.speed_radps(), 0);
}

TEST(SpeedLoop, forgets_its_integral_when_the_set_point_jumps) {
  const SpeedLoopParameters parameters{.p = 0, .i_per_s = 2};
  SpeedLoop loop{parameters, 100};
  for (int i = 0; i < 100; ++i) loop.duty(50);
  EXPECT_NEAR(loop.duty(60), 100 * 0.001 + 0.0012, 1e-9);  // 20 % more: kept
  EXPECT_NEAR(loop.duty(10), 0.0002, 1e-9);                // 83 % less: anew
}

TEST(WheeledRobot, repeats_a_seed_bit_for_bit) {
  WheeledRobotParameters p = ssl_robot();
  p.rough_nm = 0.01;
  WheeledRobot a{p};
  WheeledRobot b{p};
  WheeledRobot c{(p.seed = 2, p)};
  for (WheeledRobot* robot : {&a, &b, &c}) robot->command(std::array{-10.0, -10.0, 10.0, 10.0});
  for (int i = 0; i < 200; ++i) {
    a.step(5ms);
    b.step(5ms);
    c.step(5ms);
  }
  EXPECT_EQ(a.state().pose, b.state().pose);
  EXPECT_NE(a.state().pose, c.state().pose);
}

TEST(WheeledRobot, stays_finite_on_any_wheels_and_commands) {
  Random random{3};
  for (int run = 0; run < 100; ++run) {
    WheeledRobotParameters p{.mass_kg = random.uniform(0.5, 200)};
    const int count = 1 + static_cast<int>(random.uniform(0, 8));
    for (int i = 0; i < count; ++i) {
      p.wheels.push_back({.x_m = random.normal(0.2),
                          .y_m = random.normal(0.2),
                          .drive_rad = random.uniform(-4, 4),
                          .radius_m = random.uniform(0.02, 0.3),
                          .gear = random.uniform(1, 50),
                          .sideways = random.uniform(0, 1)});
    }
    p.inertia_kg_m2 = p.mass_kg * random.uniform(0.01, 0.1);
    p.grip = random.uniform(0, 1);
    WheeledRobot robot{p};
    std::array<double, 8> command{};
    for (int i = 0; i < 20; ++i) {
      for (double& speed : command) speed = random.normal(100);
      robot.command(std::span{command}.first(p.wheels.size()));
      robot.step(20ms);
    }
    ASSERT_TRUE(std::isfinite(robot.state().pose.x + robot.state().pose.y + robot.state().pose.heading));
    ASSERT_LT(std::hypot(robot.state().velocity.x, robot.state().velocity.y), 300);
  }
}

TEST(WheeledRobot, refuses_absurd_parameters_by_name_value_and_remedy) {
  const auto refusal = [](auto change) -> std::string {
    WheeledRobotParameters p = ssl_robot();
    change(p);
    try {
      WheeledRobot robot{p};
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_EQ(refusal([](auto& p) { p.mass_kg = -3; }), "mass_kg is -3: give a number above 0");
  EXPECT_EQ(refusal([](auto& p) { p.wheels[2].radius_m = 0; }), "wheels[2].radius_m is 0: give a number above 0");
  EXPECT_EQ(refusal([](auto& p) { p.wheels.clear(); }), "wheels is 0: give one to eight");
  EXPECT_EQ(refusal([](auto& p) { p.grip = std::numeric_limits<double>::quiet_NaN(); }), "grip is nan: give 0 or more");
  EXPECT_EQ(refusal([](auto& p) { p.creep_mps = 0.001; }), "creep_mps is 0.001: give at least 0.005884");
  EXPECT_EQ(refusal([](auto& p) { p.wheels[0].drive_rad = std::numeric_limits<double>::infinity(); }),
            "wheels[0].drive_rad is inf: give a number");
}

}  // namespace
}  // namespace regista::sim
