// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/sim/simple_base.hpp>

#include <chrono>
#include <limits>
#include <stdexcept>
#include <string>

namespace regista::sim {
namespace {

using namespace std::chrono_literals;

constexpr SimpleBaseParameters ideal{.time_constant_s = 0, .max_accel_mps2 = 1e6, .max_turn_accel_radps2 = 1e6};

TEST(SimpleBase, drives_ahead_to_the_left_and_turns_counter_clockwise) {
  SimpleBase base{ideal};
  base.command({.x = 1});
  EXPECT_NEAR(base.step(1s).pose.x, 1, 1e-3);
  base.command({.y = 1});
  EXPECT_NEAR(base.step(1s).pose.y, 1, 1e-3);
  base.command({.w = 1});
  EXPECT_NEAR(base.step(1s).pose.heading, 1, 1e-3);
}

TEST(SimpleBase, closes_a_circle) {
  SimpleBase base{ideal};
  base.command({.x = 1, .w = 1});
  base.step(1s);  // the jump at the start bends the first sub-step
  const Pose2d start = base.state().pose;
  const Pose2d end = base.step(from_seconds(2 * std::numbers::pi)).pose;
  EXPECT_NEAR(distance(start, end), 0, 1e-6);
}

TEST(SimpleBase, answers_a_step_with_its_time_constant) {
  SimpleBase base{{.time_constant_s = 0.2, .max_accel_mps2 = 1e6}};
  base.command({.x = 1});
  EXPECT_NEAR(base.step(200ms).velocity.x, 1 - std::exp(-1), 1e-9);
}

TEST(SimpleBase, keeps_the_vectors_limits_and_its_direction) {
  SimpleBase base{{.max_speed_mps = 1, .max_accel_mps2 = 2}};
  base.command({.x = 30, .y = 40});
  BodyVelocity before;
  for (int i = 0; i < 2000; ++i) {
    const BodyVelocity now = base.step(1ms).velocity;
    ASSERT_LE(std::hypot(now.x - before.x, now.y - before.y), 2e-3 + 1e-12);
    ASSERT_LE(std::hypot(now.x, now.y), 1 + 1e-12);
    ASSERT_NEAR(now.y * 3, now.x * 4, 1e-12);
    before = now;
  }
  EXPECT_NEAR(before.x, 0.6, 1e-6);
}

TEST(SimpleBase, a_differential_one_does_not_go_sideways) {
  SimpleBase base{{.holonomic = false, .noise_m_per_root_m = 0.1}};
  base.command({.x = 1, .y = 1});
  EXPECT_EQ(base.step(1s).pose.y, 0);
}

TEST(SimpleBase, spreads_by_the_root_of_the_way_whatever_the_step) {
  for (const Duration dt : {Duration{1ms}, Duration{40ms}}) {
    double squares = 0;
    for (std::uint64_t seed = 0; seed < 100; ++seed) {
      SimpleBase base{{.time_constant_s = 0, .max_accel_mps2 = 1e6, .noise_m_per_root_m = 0.05, .seed = seed}};
      base.command({.x = 1});
      for (Duration t{}; t < 4s; t += dt) base.step(dt);
      squares += base.state().pose.y * base.state().pose.y;
    }
    EXPECT_NEAR(std::sqrt(squares / 100), 0.05 * std::sqrt(4), 0.03);  // four standard errors
  }
}

TEST(SimpleBase, repeats_a_seed_bit_for_bit) {
  SimpleBaseParameters parameters{.noise_m_per_root_m = 0.1, .noise_rad_per_root_m = 0.1, .seed = 7};
  SimpleBase a{parameters};
  SimpleBase b{parameters};
  SimpleBase c{(parameters.seed = 8, parameters)};
  for (SimpleBase* base : {&a, &b, &c}) base->command({.x = 1, .w = 0.3});
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(a.step(10ms).pose, b.step(10ms).pose);
    ASSERT_NE(a.state().pose, c.step(10ms).pose);
  }
}

TEST(SimpleBase, stops_at_a_command_that_is_no_number) {
  SimpleBase base{ideal};
  base.command({.x = 1});
  base.step(10ms);
  base.command({.x = std::numeric_limits<double>::quiet_NaN()});
  EXPECT_EQ(base.step(10ms).velocity, BodyVelocity{});
}

TEST(SimpleBase, refuses_an_absurd_parameter_by_name_value_and_remedy) {
  try {
    SimpleBase base{{.max_speed_mps = -2}};
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_EQ(std::string{error.what()}, "max_speed_mps is -2: give a number above 0");
  }
  EXPECT_THROW(SimpleBase({.time_constant_s = std::numeric_limits<double>::quiet_NaN()}), std::invalid_argument);
  EXPECT_THROW(SimpleBase({.max_accel_mps2 = std::numeric_limits<double>::infinity()}), std::invalid_argument);
}

}  // namespace
}  // namespace regista::sim
