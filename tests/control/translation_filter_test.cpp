// SPDX-License-Identifier: Apache-2.0
#include "regista/control/translation_filter.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

namespace regista::control {
namespace {

using namespace std::chrono_literals;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

TranslationFilter at_rest(const TranslationConfig& config = {}) {
  TranslationFilter filter{config};
  for (int i = 0; i < 200; ++i) {
    filter.correct(PositionMeasurement{.sd_m = 0.004});
    filter.predict({}, 16ms);
  }
  return filter;
}

TEST(TranslationFilter, starts_at_the_first_position_and_lets_velocities_wait) {
  TranslationFilter filter;
  EXPECT_TRUE(filter.lost());
  EXPECT_EQ(filter.correct(VelocityMeasurement{.x = 1, .sd_mps = 0.1}).verdict, Verdict::waiting);
  EXPECT_EQ(filter.correct(PositionMeasurement{.x = 1, .y = 2, .sd_m = 0.004}).verdict, Verdict::initialised);
  EXPECT_EQ(filter.estimate().x, 1);
  EXPECT_EQ(filter.estimate().y, 2);
  EXPECT_EQ(filter.estimate().vx, 0);
  EXPECT_FALSE(filter.lost());
}

TEST(TranslationFilter, acceleration_moves_it_exactly) {
  TranslationFilter filter;
  filter.correct(PositionMeasurement{.sd_m = 0.004});
  for (int i = 0; i < 1000; ++i) filter.predict({.x = 2, .y = -1}, 1ms);
  EXPECT_NEAR(filter.estimate().x, 1, 1e-12);
  EXPECT_NEAR(filter.estimate().y, -0.5, 1e-12);
  EXPECT_NEAR(filter.estimate().vx, 2, 1e-12);
  EXPECT_NEAR(filter.estimate().vy, -1, 1e-12);
}

TEST(TranslationFilter, covariance_does_not_depend_on_how_time_is_cut) {
  TranslationFilter whole, parts;
  whole.correct(PositionMeasurement{.sd_m = 0.004});
  parts.correct(PositionMeasurement{.sd_m = 0.004});
  whole.predict({.x = 1, .y = 0}, 1s);
  for (int i = 0; i < 1000; ++i) parts.predict({.x = 1, .y = 0}, 1ms);
  EXPECT_TRUE(whole.state().kalman.p.isApprox(parts.state().kalman.p, 1e-12));
  EXPECT_TRUE(whole.state().kalman.x.isApprox(parts.state().kalman.x, 1e-12));
}

TEST(TranslationFilter, learns_the_velocity_from_positions) {
  TranslationFilter filter;
  for (int i = 0; i < 500; ++i) {
    filter.correct(PositionMeasurement{.x = 0.6 * 0.016 * i, .y = -0.3 * 0.016 * i, .sd_m = 0.004});
    filter.predict({}, 16ms);
  }
  EXPECT_NEAR(filter.estimate().vx, 0.6, 1e-3);
  EXPECT_NEAR(filter.estimate().vy, -0.3, 1e-3);
}

TEST(TranslationFilter, fuses_velocities_of_the_wheels) {
  TranslationFilter filter = at_rest();
  const double before = filter.estimate().speed_sd_mps;
  EXPECT_EQ(filter.correct(VelocityMeasurement{.x = 0.01, .sd_mps = 0.01}).verdict, Verdict::fused);
  EXPECT_GT(filter.estimate().vx, 0);
  EXPECT_LT(filter.estimate().speed_sd_mps, before);
}

TEST(TranslationFilter, refuses_an_outlier_and_takes_the_next_good_one) {
  TranslationFilter filter = at_rest();
  const auto before = filter.estimate();
  const Correction refused = filter.correct(PositionMeasurement{.x = 0.5, .sd_m = 0.004});
  EXPECT_EQ(refused.verdict, Verdict::outlier);
  EXPECT_GT(refused.nis, 16);
  EXPECT_EQ(filter.estimate().x, before.x);
  EXPECT_EQ(filter.state().position.refused, 1u);
  EXPECT_EQ(filter.correct(PositionMeasurement{.sd_m = 0.004}).verdict, Verdict::fused);
  EXPECT_EQ(filter.state().position.refused_in_a_row, 0u);
}

TEST(TranslationFilter, restarts_after_eight_refusals_in_a_row) {
  TranslationFilter filter = at_rest();
  for (int i = 0; i < 7; ++i) {
    filter.predict({}, 16ms);
    EXPECT_EQ(filter.correct(PositionMeasurement{.x = 3, .y = 1, .sd_m = 0.004}).verdict, Verdict::outlier);
  }
  EXPECT_EQ(filter.correct(PositionMeasurement{.x = 3, .y = 1, .sd_m = 0.004}).verdict, Verdict::restarted);
  EXPECT_EQ(filter.estimate().x, 3);
  EXPECT_EQ(filter.estimate().vx, 0);
  EXPECT_EQ(filter.state().position.restarts, 1u);
  EXPECT_EQ(filter.correct(PositionMeasurement{.x = 3, .y = 1, .sd_m = 0.004}).verdict, Verdict::fused);
}

TEST(TranslationFilter, one_good_position_in_between_prevents_the_restart) {
  TranslationFilter filter = at_rest();
  for (int i = 0; i < 100; ++i) {
    filter.predict({}, 16ms);
    const bool wild = i % 8 != 7;
    filter.correct(PositionMeasurement{.x = wild ? 3.0 : 0.0, .sd_m = 0.004});
  }
  EXPECT_EQ(filter.state().position.restarts, 0u);
  EXPECT_NEAR(filter.estimate().x, 0, 1e-3);
}

TEST(TranslationFilter, speed_gate_refuses_what_no_robot_reaches_and_grows_with_time) {
  TranslationFilter filter{{.initial_speed_sd_mps = 1000, .max_speed_mps = 5}};  // the innovation gate lets all pass
  filter.correct(PositionMeasurement{.sd_m = 0.004});
  filter.predict({}, 16ms);
  EXPECT_EQ(filter.correct(PositionMeasurement{.x = 0.5, .sd_m = 0.004}).verdict, Verdict::too_fast);
  filter.predict({}, 100ms);
  EXPECT_EQ(filter.correct(PositionMeasurement{.x = 0.5, .sd_m = 0.004}).verdict, Verdict::fused);
}

TEST(TranslationFilter, is_lost_two_seconds_after_the_last_position_and_found_again) {
  TranslationFilter filter = at_rest();
  filter.predict({}, 500ms);
  EXPECT_FALSE(filter.lost());
  filter.predict({}, 1s);
  EXPECT_FALSE(filter.lost());
  filter.predict({}, 600ms);
  EXPECT_TRUE(filter.lost());
  EXPECT_GE(filter.state().position.unseen, 2s);
  filter.correct(PositionMeasurement{.sd_m = 0.004});
  EXPECT_FALSE(filter.lost());
}

TEST(TranslationFilter, refuses_what_is_not_a_number_and_counts_it) {
  TranslationFilter filter = at_rest();
  const auto before = filter.state().kalman;
  EXPECT_EQ(filter.correct(PositionMeasurement{.x = nan, .sd_m = 0.004}).verdict, Verdict::invalid);
  EXPECT_EQ(filter.correct(PositionMeasurement{.y = 1e12, .sd_m = 0.004}).verdict, Verdict::invalid);
  EXPECT_EQ(filter.correct(PositionMeasurement{.sd_m = 0}).verdict, Verdict::invalid);
  EXPECT_EQ(filter.correct(PositionMeasurement{.sd_m = nan}).verdict, Verdict::invalid);
  EXPECT_EQ(filter.correct(VelocityMeasurement{.x = nan, .sd_mps = 1}).verdict, Verdict::invalid);
  EXPECT_EQ(filter.state().position.refused, 4u);
  EXPECT_EQ(filter.state().velocity.refused, 1u);
  filter.predict({.x = nan}, 0s);
  filter.predict({}, -1s);
  EXPECT_EQ(filter.state().refused_inputs, 1u);
  EXPECT_EQ(filter.state().kalman.x, before.x);
  EXPECT_EQ(filter.state().kalman.p, before.p);
}

TEST(TranslationFilter, bridges_a_bad_input_with_the_last_good_one) {
  TranslationFilter filter;
  filter.correct(PositionMeasurement{.sd_m = 0.004});
  for (int i = 0; i < 1000; ++i) filter.predict({.x = i % 10 == 9 ? nan : 2, .y = 0}, 1ms);
  EXPECT_NEAR(filter.estimate().x, 1, 1e-12);
  EXPECT_EQ(filter.state().refused_inputs, 100u);
}

TEST(TranslationFilter, refuses_an_absurd_configuration_and_says_why) {
  EXPECT_THROW(TranslationFilter{{.acceleration_density = -1}}, std::invalid_argument);
  EXPECT_THROW(TranslationFilter{{.initial_speed_sd_mps = 0}}, std::invalid_argument);
  EXPECT_THROW(TranslationFilter{{.max_speed_mps = nan}}, std::invalid_argument);
  EXPECT_THROW(TranslationFilter{{.restart_after = 0}}, std::invalid_argument);
  EXPECT_THROW(TranslationFilter{{.lost_sd_m = nan}}, std::invalid_argument);
  try {
    TranslationFilter filter{{.gate = nan}};
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "gate is nan: give a positive number of standard deviations, 4 is usual");
  }
}

// Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", 5.4: over independent runs,
// the error weighted by the filter's own covariance is chi-square distributed.
TEST(TranslationFilter, is_as_uncertain_as_it_says) {
  constexpr int runs = 400, steps = 100;
  constexpr double t = 0.01, density = 0.5, sd = 0.01;
  std::mt19937 random{4};
  std::normal_distribution<double> normal;
  double nees[steps] = {};
  double nis = 0;
  int compared = 0;
  const Eigen::Matrix2d q{{density * t * t * t / 3, density * t * t / 2}, {density * t * t / 2, density * t}};
  const Eigen::Matrix2d noise = q.llt().matrixL();
  for (int run = 0; run < runs; ++run) {
    TranslationFilter filter{{.acceleration_density = density, .initial_speed_sd_mps = 1, .gate = 100}};
    const auto pair = [&] { return Eigen::RowVector2d{normal(random), normal(random)}; };
    Eigen::Matrix2d truth;
    truth << 0, 0, pair();
    const auto look = [&] {
      const Eigen::RowVector2d z = truth.row(0) + sd * pair();
      return filter.correct(PositionMeasurement{.x = z(0), .y = z(1), .sd_m = sd});
    };
    look();
    for (int i = 0; i < steps; ++i) {
      Eigen::Matrix2d shake;
      shake << pair(), pair();
      const Eigen::RowVector2d a{std::sin(0.1 * i), 1};
      truth.row(0) += t * truth.row(1) + t * t / 2 * a;
      truth.row(1) += t * a;
      truth += noise * shake;
      filter.predict({.x = a(0), .y = a(1)}, 10ms);
      if (i % 2 == 1) {
        nis += look().nis;
        ++compared;
      }
      const Eigen::Matrix2d error = truth - filter.state().kalman.x;
      nees[i] += (error.transpose() * filter.state().kalman.p.inverse() * error).trace() / runs;
    }
  }
  // 4 degrees of freedom: the mean over 400 runs scatters by sqrt(8 / 400) = 0.14; 4.5 of those for a hundred looks.
  for (int i = 0; i < steps; ++i) EXPECT_NEAR(nees[i], 4, 0.64) << i;
  EXPECT_NEAR(nis / compared, 2, 4 * std::sqrt(4.0 / compared));
}

}  // namespace
}  // namespace regista::control
