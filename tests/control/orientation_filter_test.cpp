// SPDX-License-Identifier: Apache-2.0
#include "regista/control/orientation_filter.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <regista/core/geometry.hpp>
#include <stdexcept>

#include "regista/control/complementary_filter.hpp"

namespace regista::control {
namespace {

using namespace std::chrono_literals;
constexpr double pi = std::numbers::pi;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

TEST(OrientationFilter, a_positive_rate_turns_it_counter_clockwise_through_the_wrap) {
  OrientationFilter filter;
  EXPECT_TRUE(filter.lost());
  EXPECT_EQ(filter.correct({.heading_rad = 3, .sd_rad = 0.01}).verdict, Verdict::initialised);
  for (int i = 0; i < 1000; ++i) filter.predict(0.5, 1ms);
  EXPECT_NEAR(filter.estimate().heading_rad, 3.5 - 2 * pi, 1e-12);
}

TEST(OrientationFilter, takes_the_short_way_across_the_wrap) {
  OrientationFilter filter;
  filter.correct({.heading_rad = pi - 0.01, .sd_rad = 0.01});
  EXPECT_EQ(filter.correct({.heading_rad = -pi + 0.01, .sd_rad = 0.01}).verdict, Verdict::fused);
  EXPECT_NEAR(std::abs(filter.estimate().heading_rad), pi, 1e-12);
}

TEST(OrientationFilter, takes_headings_of_any_turn) {
  OrientationFilter filter;
  filter.correct({.heading_rad = 0.1, .sd_rad = 0.01});
  EXPECT_EQ(filter.correct({.heading_rad = 0.1 + 20 * pi, .sd_rad = 0.01}).verdict, Verdict::fused);
  EXPECT_NEAR(filter.estimate().heading_rad, 0.1, 1e-12);
}

TEST(OrientationFilter, finds_the_bias_of_the_gyro) {
  OrientationFilter filter{{.rate_density = 1e-6}};
  double heading = 0;
  for (int i = 0; i < 20000; ++i) {
    if (i % 16 == 0) filter.correct({.heading_rad = heading, .sd_rad = 0.01});
    heading += 1.0 * 0.001;
    filter.predict(1.0 + 0.03, 1ms);
  }
  EXPECT_NEAR(filter.estimate().bias_radps, 0.03, 0.001);
  EXPECT_NEAR(filter.estimate().w_radps, 1.0, 0.001);
  EXPECT_LT(filter.estimate().bias_sd_radps, 0.005);
}

TEST(OrientationFilter, covariance_does_not_depend_on_how_time_is_cut) {
  OrientationFilter whole, parts;
  whole.correct({.sd_rad = 0.01});
  parts.correct({.sd_rad = 0.01});
  whole.predict(0.1, 1s);
  for (int i = 0; i < 1000; ++i) parts.predict(0.1, 1ms);
  EXPECT_TRUE(whole.state().kalman.p.isApprox(parts.state().kalman.p, 1e-10));
}

TEST(OrientationFilter, published_constants_give_the_published_gain) {
  // One state: with a = q / r = 0.05 a step, the steady predicted variance is m r with m = (a + sqrt(a² + 4a)) / 2,
  // and the gain m / (m + 1).
  OrientationFilter filter{OrientationConfig::holtzhausen()};
  const double r = 0.010;
  for (int i = 0; i < 500; ++i) {
    filter.correct({.sd_rad = r});
    filter.predict(0, 20ms);
  }
  const double m = (0.05 + std::sqrt(0.05 * 0.05 + 0.2)) / 2;
  EXPECT_NEAR(filter.state().kalman.p(0, 0) / (r * r), m, 1e-12);
  filter.correct({.heading_rad = 0.01, .sd_rad = r});
  EXPECT_NEAR(filter.estimate().heading_rad, 0.01 * m / (m + 1), 1e-12);
  EXPECT_EQ(filter.estimate().bias_radps, 0);
}

TEST(OrientationFilter, refuses_a_quarter_turn_flip_of_the_vision_and_restarts_when_it_stays) {
  OrientationFilter filter;
  for (int i = 0; i < 100; ++i) {
    filter.correct({.heading_rad = 1, .sd_rad = 0.01});
    filter.predict(0, 16ms);
  }
  for (int i = 0; i < 7; ++i) {
    EXPECT_EQ(filter.correct({.heading_rad = 1 + pi / 2, .sd_rad = 0.01}).verdict, Verdict::outlier);
  }
  EXPECT_NEAR(filter.estimate().heading_rad, 1, 1e-9);
  EXPECT_EQ(filter.correct({.heading_rad = 1 + pi / 2, .sd_rad = 0.01}).verdict, Verdict::restarted);
  EXPECT_NEAR(filter.estimate().heading_rad, 1 + pi / 2, 1e-12);
}

TEST(OrientationFilter, turn_rate_gate_refuses_what_no_robot_turns_and_grows_with_time) {
  OrientationFilter filter{{.rate_density = 100, .max_turn_rate_radps = 10}};  // the innovation gate lets all pass
  filter.correct({.sd_rad = 0.01});
  filter.predict(0, 16ms);
  EXPECT_EQ(filter.correct({.heading_rad = 1, .sd_rad = 0.01}).verdict, Verdict::too_fast);
  filter.predict(0, 100ms);
  EXPECT_EQ(filter.correct({.heading_rad = 1, .sd_rad = 0.01}).verdict, Verdict::fused);
}

TEST(OrientationFilter, refuses_what_is_not_a_number_and_an_absurd_configuration) {
  OrientationFilter filter;
  filter.correct({.sd_rad = 0.01});
  EXPECT_EQ(filter.correct({.heading_rad = nan, .sd_rad = 0.01}).verdict, Verdict::invalid);
  EXPECT_EQ(filter.correct({.sd_rad = -1}).verdict, Verdict::invalid);
  filter.predict(nan, 1ms);
  EXPECT_EQ(filter.state().refused_inputs, 1u);
  EXPECT_EQ(filter.estimate().heading_rad, 0);
  EXPECT_THROW(OrientationFilter{{.rate_density = nan}}, std::invalid_argument);
  EXPECT_THROW(OrientationFilter{{.bias_density = -1}}, std::invalid_argument);
  EXPECT_THROW(OrientationFilter{{.max_turn_rate_radps = 0}}, std::invalid_argument);
}

TEST(OrientationFilter, is_as_uncertain_as_it_says) {
  constexpr int runs = 400, steps = 200;
  constexpr double t = 0.01, sd = 0.05;
  const OrientationConfig config{
      .rate_density = 1e-3, .bias_density = 1e-4, .initial_bias_sd_radps = 0.05, .gate = 100};
  const double rate = config.rate_density, bias = config.bias_density;
  const Eigen::Matrix2d q{{rate * t + bias * t * t * t / 3, -bias * t * t / 2}, {-bias * t * t / 2, bias * t}};
  const Eigen::Matrix2d noise = q.llt().matrixL();
  std::mt19937 random{6};
  std::normal_distribution<double> normal;
  double nees[steps] = {};
  double nis = 0;
  int compared = 0;
  for (int run = 0; run < runs; ++run) {
    OrientationFilter filter{config};
    Eigen::Vector2d truth{3, 0.05 * normal(random)};  // near the wrap
    filter.correct({.heading_rad = truth(0) + sd * normal(random), .sd_rad = sd});
    for (int i = 0; i < steps; ++i) {
      // The gyro shows 1 rad/s; what the body does differs by bias and noise.
      truth(0) += (1 - truth(1)) * t;
      truth += noise * Eigen::Vector2d{normal(random), normal(random)};
      filter.predict(1, 10ms);
      if (i % 3 == 2) {
        nis += filter.correct({.heading_rad = truth(0) + sd * normal(random), .sd_rad = sd}).nis;
        ++compared;
      }
      const Eigen::Vector2d error{angle_between(filter.estimate().heading_rad, truth(0)),
                                  truth(1) - filter.estimate().bias_radps};
      nees[i] += error.dot(filter.state().kalman.p.inverse() * error) / runs;
    }
  }
  // 2 degrees of freedom: the mean over 400 runs scatters by sqrt(4 / 400) = 0.1.
  for (int i = 0; i < steps; ++i) EXPECT_NEAR(nees[i], 2, 0.45) << i;
  EXPECT_NEAR(nis / compared, 1, 4 * std::sqrt(2.0 / compared));
}

TEST(ComplementaryFilter, follows_the_gyro_at_once_and_the_heading_within_its_time_constant) {
  ComplementaryFilter filter{{.time_constant_s = 0.5}};
  filter.correct({.heading_rad = 3, .sd_rad = 0.01});
  filter.predict(1, 200ms);
  EXPECT_NEAR(filter.heading_rad(), 3.2 - 2 * pi, 1e-12);

  filter = ComplementaryFilter{{.time_constant_s = 0.5}};
  filter.correct({.sd_rad = 0.01});
  for (int i = 0; i < 50; ++i) {
    filter.predict(0, 10ms);
    filter.correct({.heading_rad = 1, .sd_rad = 0.01});
  }
  EXPECT_NEAR(filter.heading_rad(), 1 - std::exp(-1), 1e-12);
}

TEST(ComplementaryFilter, is_the_same_filter_at_any_rate_of_headings) {
  ComplementaryFilter often{{.time_constant_s = 0.5}}, seldom{{.time_constant_s = 0.5}};
  often.correct({.sd_rad = 0.01});
  seldom.correct({.sd_rad = 0.01});
  for (int i = 1; i <= 100; ++i) {
    often.predict(0, 10ms);
    seldom.predict(0, 10ms);
    often.correct({.heading_rad = 0.5, .sd_rad = 0.01});
    if (i % 20 == 0) seldom.correct({.heading_rad = 0.5, .sd_rad = 0.01});
  }
  EXPECT_NEAR(often.heading_rad(), seldom.heading_rad(), 1e-12);
}

TEST(ComplementaryFilter, an_unknown_bias_leaves_bias_times_time_constant) {
  ComplementaryFilter filter{{.time_constant_s = 0.5}};
  filter.correct({.sd_rad = 0.01});
  for (int i = 0; i < 10000; ++i) {
    filter.predict(0.02, 1ms);
    filter.correct({.sd_rad = 0.01});
  }
  EXPECT_NEAR(filter.heading_rad(), 0.01, 1e-4);
}

TEST(ComplementaryFilter, refuses_impossible_turns_and_restarts_when_they_stay) {
  ComplementaryFilter filter{{.max_turn_rate_radps = 10}};
  filter.correct({.heading_rad = pi - 0.1, .sd_rad = 0.01});
  for (int i = 0; i < 7; ++i) {
    EXPECT_EQ(filter.correct({.heading_rad = 0, .sd_rad = 0.01}).verdict, Verdict::too_fast);
  }
  EXPECT_EQ(filter.correct({.heading_rad = 0, .sd_rad = 0.01}).verdict, Verdict::restarted);
  EXPECT_EQ(filter.heading_rad(), 0);
  EXPECT_EQ(filter.correct({.heading_rad = nan, .sd_rad = 0.01}).verdict, Verdict::invalid);
  EXPECT_THROW(ComplementaryFilter{{.time_constant_s = 0}}, std::invalid_argument);
}

}  // namespace
}  // namespace regista::control
