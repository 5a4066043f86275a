// SPDX-License-Identifier: Apache-2.0
#include "regista/control/pose_ekf.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>

namespace regista::control {
namespace {

using namespace std::chrono_literals;
using Status = PoseEkf::Status;
constexpr double pi = std::numbers::pi;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

WheelMeasurement wheels(double speed, double w) {
  return {.speed_mps = speed, .w_radps = w, .speed_sd_mps = 0.02, .w_sd_radps = 0.02};
}
PositionMeasurement gps(double x, double y) { return {.x = x, .y = y, .sd_m = 0.5}; }
HeadingMeasurement compass(double heading) { return {.heading_rad = heading, .sd_rad = 0.05}; }

/// At x 1, y 2, heading 0.5, standing.
PoseEkf tracking(const PoseEkfConfig& config = {}) {
  PoseEkf ekf{config};
  ekf.reset({.x = 1, .y = 2, .heading = 0.5}, 0.1, 0.05);
  ekf.correct(wheels(0, 0));
  return ekf;
}

TEST(PoseEkf, wheels_ahead_and_left_move_it_ahead_and_left) {
  PoseEkf ekf;
  ekf.reset({}, 0.1, 0.05);
  for (int i = 0; i < 1000; ++i) {
    ekf.correct(wheels(0.5, 0.2));
    ekf.predict({}, 10ms);
  }
  const Pose2d expected = travelled({}, {.x = 0.5, .w = 0.2}, 10s);
  EXPECT_GT(ekf.estimate().pose.y, 0);
  EXPECT_NEAR(ekf.estimate().pose.x, expected.x, 0.01);
  EXPECT_NEAR(ekf.estimate().pose.y, expected.y, 0.01);
  EXPECT_NEAR(ekf.estimate().pose.heading, expected.heading, 0.01);
}

TEST(PoseEkf, a_position_to_the_left_of_a_straight_drive_turns_the_heading_left) {
  PoseEkf ekf;
  ekf.reset({}, 0.01, 0.3);
  for (int i = 0; i < 500; ++i) {
    ekf.correct(wheels(1, 0));
    ekf.correct(GyroMeasurement{.sd_radps = 0.001});
    ekf.predict({}, 10ms);
  }
  ekf.correct(PositionMeasurement{.x = 4.9, .y = 1, .sd_m = 0.05});
  EXPECT_NEAR(ekf.estimate().pose.heading, 0.2, 0.02);
}

TEST(PoseEkf, finds_the_bias_of_the_gyro_while_the_wheels_stand) {
  PoseEkf ekf = tracking();
  for (int i = 0; i < 1000; ++i) {
    ekf.correct(WheelMeasurement{.speed_sd_mps = 0.01, .w_sd_radps = 0.005});
    ekf.correct(GyroMeasurement{.w_radps = 0.03, .sd_radps = 0.005});
    ekf.predict({}, 10ms);
  }
  EXPECT_NEAR(ekf.estimate().bias_radps, 0.03, 0.001);
  EXPECT_NEAR(ekf.estimate().w_radps, 0, 0.001);
  EXPECT_NEAR(ekf.estimate().pose.heading, 0.5, 0.01);
}

TEST(PoseEkf, headings_cross_the_wrap) {
  PoseEkf ekf;
  ekf.reset({.heading = 3.1}, 0.1, 0.05);
  EXPECT_EQ(ekf.correct(compass(-3.1)).verdict, Verdict::fused);
  EXPECT_GT(std::abs(ekf.estimate().pose.heading), 3.1);
}

TEST(PoseEkf, waits_for_position_and_heading_in_either_order) {
  for (const bool position_first : {true, false}) {
    PoseEkf ekf;
    EXPECT_EQ(ekf.status(), Status::waiting);
    ekf.correct(wheels(0, 0));
    ekf.predict({}, 10ms);
    EXPECT_EQ(ekf.status(), Status::waiting);
    const auto position = [&] { EXPECT_EQ(ekf.correct(gps(7, 8)).verdict, Verdict::initialised); };
    const auto heading = [&] { EXPECT_EQ(ekf.correct(compass(2)).verdict, Verdict::initialised); };
    position_first ? position() : heading();
    EXPECT_EQ(ekf.status(), Status::waiting);
    position_first ? heading() : position();
    EXPECT_EQ(ekf.status(), Status::tracking);
    EXPECT_NEAR(ekf.estimate().pose.x, 7, 1e-12);
    EXPECT_NEAR(ekf.estimate().pose.y, 8, 1e-12);
    EXPECT_NEAR(ekf.estimate().pose.heading, 2, 1e-12);
    EXPECT_NEAR(std::sqrt(ekf.estimate().covariance.hh), 0.05, 1e-12);
  }
}

TEST(PoseEkf, turns_the_way_since_the_first_position_when_the_heading_comes_late) {
  PoseEkf ekf;
  ekf.correct(gps(10, 0));
  for (int i = 0; i < 300; ++i) {
    ekf.correct(wheels(1, 0));
    ekf.predict({}, 10ms);
  }
  ekf.correct(compass(pi / 2));
  EXPECT_NEAR(ekf.estimate().pose.x, 10, 0.01);
  EXPECT_NEAR(ekf.estimate().pose.y, 3, 0.01);
}

TEST(PoseEkf, finds_the_heading_from_the_way_where_no_sensor_gives_it) {
  PoseEkf ekf;
  Pose2d truth{.x = 4, .y = -3, .heading = -2.5};
  std::mt19937 random{9};
  std::normal_distribution<double> noise{0, 0.3};
  int waited = 0;
  for (int i = 0; i < 3000; ++i) {
    ekf.correct(wheels(0.8, 0.1));
    if (i % 20 == 0) {
      const PositionMeasurement z{.x = truth.x + noise(random), .y = truth.y + noise(random), .sd_m = 0.3};
      if (ekf.correct(z).verdict == Verdict::waiting) ++waited;
    }
    ekf.predict({}, 10ms);
    truth = travelled(truth, {.x = 0.8, .w = 0.1}, 10ms);
  }
  EXPECT_GT(waited, 20);
  EXPECT_EQ(ekf.status(), Status::tracking);
  EXPECT_NEAR(angle_between(ekf.estimate().pose.heading, truth.heading), 0, 0.1);
  EXPECT_LT(distance(ekf.estimate().pose, truth), 0.3);
}

TEST(PoseEkf, refuses_a_gps_jump_and_restarts_where_it_stays) {
  PoseEkf ekf = tracking();
  for (int i = 0; i < 7; ++i) {
    EXPECT_EQ(ekf.correct(gps(21, 2)).verdict, Verdict::outlier);
    ekf.predict({}, 200ms);
    ekf.correct(wheels(0, 0));
  }
  EXPECT_NEAR(ekf.estimate().pose.x, 1, 0.1);
  EXPECT_EQ(ekf.correct(gps(21, 2)).verdict, Verdict::restarted);
  EXPECT_EQ(ekf.estimate().pose.x, 21);
  EXPECT_EQ(ekf.correct(gps(21, 2)).verdict, Verdict::fused);
  EXPECT_EQ(ekf.explain().position.restarts, 1u);
}

TEST(PoseEkf, recovers_from_a_wrong_heading_without_a_heading_sensor) {
  PoseEkf ekf;
  ekf.reset({.heading = 2}, 0.1, 0.05);  // in truth it looks along x
  Pose2d truth;
  for (int i = 0; i < 12000; ++i) {
    ekf.correct(wheels(0.8, 0));
    if (i % 20 == 0) ekf.correct(gps(truth.x, truth.y));
    ekf.predict({}, 10ms);
    truth.x += 0.008;
  }
  EXPECT_NEAR(ekf.estimate().pose.heading, 0, 0.05);
  EXPECT_LT(distance(ekf.estimate().pose, truth), 0.3);
}

TEST(PoseEkf, a_flipped_heading_does_not_cost_the_position_beside_it) {
  PoseEkf ekf = tracking();
  EXPECT_EQ(ekf.correct(compass(0.5 + pi / 2)).verdict, Verdict::outlier);
  EXPECT_EQ(ekf.correct(gps(1, 2)).verdict, Verdict::fused);
  EXPECT_NEAR(ekf.estimate().pose.heading, 0.5, 1e-9);
}

TEST(PoseEkf, refuses_spinning_wheels_when_the_gyro_says_otherwise) {
  PoseEkf ekf = tracking({.turn_density = 0.05});
  for (int i = 0; i < 100; ++i) {
    ekf.correct(wheels(0.5, 0));
    ekf.correct(GyroMeasurement{.sd_radps = 0.005});
    ekf.predict({}, 10ms);
  }
  EXPECT_EQ(ekf.correct(wheels(0.5, 2)).verdict, Verdict::outlier);
  EXPECT_NEAR(ekf.estimate().w_radps, 0, 0.01);
}

TEST(PoseEkf, is_lost_when_it_is_too_uncertain_and_found_by_the_next_fix) {
  PoseEkf ekf = tracking();
  EXPECT_EQ(ekf.status(), Status::tracking);
  ekf.predict({}, 60s);
  EXPECT_EQ(ekf.status(), Status::lost);
  ekf.correct(compass(0.5));
  ekf.correct(gps(1, 2));
  EXPECT_EQ(ekf.status(), Status::tracking);
}

TEST(PoseEkf, refuses_what_is_not_a_number_and_counts_it) {
  PoseEkf ekf = tracking();
  const auto before = ekf.state().kalman;
  EXPECT_EQ(ekf.correct(wheels(nan, 0)).verdict, Verdict::invalid);
  EXPECT_EQ(ekf.correct(WheelMeasurement{}).verdict, Verdict::invalid);  // no standard deviation
  EXPECT_EQ(ekf.correct(GyroMeasurement{.w_radps = nan, .sd_radps = 1}).verdict, Verdict::invalid);
  EXPECT_EQ(ekf.correct(compass(nan)).verdict, Verdict::invalid);
  EXPECT_EQ(ekf.correct(gps(1, std::numeric_limits<double>::infinity())).verdict, Verdict::invalid);
  EXPECT_EQ(ekf.correct(gps(1e300, 1)).verdict, Verdict::invalid);
  ekf.predict({}, -1s);
  EXPECT_EQ(ekf.state().kalman.x, before.x);
  EXPECT_EQ(ekf.state().kalman.p, before.p);
  EXPECT_EQ(ekf.explain().wheels.refused, 2u);
  EXPECT_EQ(ekf.explain().position.refused, 2u);
}

TEST(PoseEkf, refuses_an_absurd_configuration_or_pose_and_says_why) {
  EXPECT_THROW(PoseEkf{{.turn_density = -1}}, std::invalid_argument);
  EXPECT_THROW(PoseEkf{{.initial_bias_sd_radps = nan}}, std::invalid_argument);
  EXPECT_THROW(PoseEkf{{.align_distance_m = 0}}, std::invalid_argument);
  PoseEkf ekf;
  EXPECT_THROW(ekf.reset({.x = nan}, 1, 1), std::invalid_argument);
  EXPECT_THROW(ekf.reset({}, 0, 1), std::invalid_argument);
  EXPECT_EQ(ekf.status(), Status::waiting);
}

TEST(PoseEkf, explains_itself_in_words) {
  PoseEkf ekf;
  EXPECT_NE(to_string(ekf.explain()).find("waiting for a position and a heading"), std::string::npos);
  ekf.correct(gps(1, 2));
  EXPECT_NE(to_string(ekf.explain()).find("waiting for a heading"), std::string::npos);
  ekf.correct(compass(0));
  ekf.correct(wheels(0, 0));
  ekf.predict({}, 1500ms);
  ekf.correct(gps(100, 2));
  const std::string text = to_string(ekf.explain());
  EXPECT_NE(text.find("tracking: position sd"), std::string::npos) << text;
  EXPECT_NE(text.find("position: 1 taken, 1 refused, 0 restarts; last refused: outlier (NIS "), std::string::npos)
      << text;
  EXPECT_NE(text.find("last taken 1.500 s ago"), std::string::npos) << text;
  EXPECT_NE(text.find("gyro: nothing yet\n"), std::string::npos) << text;
}

TEST(PoseEkf, covariance_stays_symmetric_and_positive_through_a_day_of_everything) {
  std::mt19937 random{10};
  std::uniform_real_distribution<double> uniform{-1, 1};
  PoseEkf ekf = tracking();
  for (int i = 0; i < 100000; ++i) {
    switch (random() % 6) {
      case 0:
        ekf.correct(wheels(uniform(random), 2 * uniform(random)));
        break;
      case 1:
        ekf.correct(GyroMeasurement{.w_radps = uniform(random), .sd_radps = 1e-3});
        break;
      case 2:
        ekf.correct(compass(10 * uniform(random)));
        break;
      case 3:
        ekf.correct(PositionMeasurement{.x = uniform(random), .y = uniform(random), .sd_m = 1e-3});
        break;
      case 4:
        ekf.predict({}, std::chrono::microseconds{random() % 100000});
        break;
      default:
        ekf.predict({}, std::chrono::microseconds{random() % 1000});
        break;
    }
    if (i % 100 == 0) {
      const auto& p = ekf.state().kalman.p;
      ASSERT_TRUE(p.allFinite());
      ASSERT_TRUE(p.isApprox(p.transpose(), 1e-12));
      const double most = p.diagonal().maxCoeff();
      using Solver = Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>>;
      ASSERT_GT(Solver{p}.eigenvalues().minCoeff(), -1e-14 * most) << i;
    }
  }
}

TEST(PoseEkf, is_as_uncertain_as_it_says) {
  constexpr int runs = 150, steps = 1000;
  constexpr double t = 0.01;
  const PoseEkfConfig config{.acceleration_density = 0.1,
                             .turn_density = 0.05,
                             .bias_density = 1e-6,
                             .slip_density = 1e-4,
                             .initial_speed_sd_mps = 0.5,
                             .initial_turn_sd_radps = 0.2,
                             .gate = 100};
  std::mt19937 random{12};
  std::normal_distribution<double> normal;
  double nees[5] = {}, nis[4] = {};
  int compared[4] = {};
  for (int run = 0; run < runs; ++run) {
    PoseEkf ekf{config};
    const Pose2d start{.x = 3, .y = 4, .heading = 3};
    ekf.reset(start, 0.5, 0.1);
    Pose2d pose{.x = 3 + 0.5 * normal(random), .y = 4 + 0.5 * normal(random), .heading = 3 + 0.1 * normal(random)};
    double v = 0.5 * normal(random), w = 0.2 * normal(random), bias = 0.05 * normal(random);
    const auto look = [&](int sensor, const PoseEkf::Measurement& z) {
      nis[sensor] += ekf.correct(z).nis;
      ++compared[sensor];
    };
    for (int i = 1; i <= steps; ++i) {
      for (int part = 0; part < 5; ++part) {  // the truth moves in finer steps than the filter
        constexpr double s = t / 5;
        const double dv = std::sqrt(config.acceleration_density * s) * normal(random);
        const double dw = std::sqrt(config.turn_density * s) * normal(random);
        pose = travelled(pose, {.x = v + dv / 2, .w = w + dw / 2}, 2ms);
        v += dv, w += dw;
        pose.x += std::sqrt(config.slip_density * s) * normal(random);
        pose.y += std::sqrt(config.slip_density * s) * normal(random);
        bias += std::sqrt(config.bias_density * s) * normal(random);
      }
      ekf.predict({}, 10ms);
      look(0, WheelMeasurement{.speed_mps = v + 0.05 * normal(random),
                               .w_radps = w + 0.1 * normal(random),
                               .speed_sd_mps = 0.05,
                               .w_sd_radps = 0.1});
      look(1, GyroMeasurement{.w_radps = w + bias + 0.02 * normal(random), .sd_radps = 0.02});
      if (i % 10 == 0) look(2, HeadingMeasurement{.heading_rad = pose.heading + 0.1 * normal(random), .sd_rad = 0.1});
      if (i % 20 == 0) {
        look(3,
             PositionMeasurement{.x = pose.x + 0.5 * normal(random), .y = pose.y + 0.5 * normal(random), .sd_m = 0.5});
      }
      if (i % 200 == 0) {
        const auto estimate = ekf.estimate();
        Eigen::Matrix<double, 6, 1> error;
        error << pose.x - estimate.pose.x, pose.y - estimate.pose.y, angle_between(estimate.pose.heading, pose.heading),
            v - estimate.speed_mps, w - estimate.w_radps, bias - estimate.bias_radps;
        nees[i / 200 - 1] += error.dot(ekf.state().kalman.p.ldlt().solve(error)) / runs;
      }
    }
  }
  // 6 degrees of freedom: the mean over 150 runs scatters by sqrt(12 / 150) = 0.28; four of those.
  for (const double mean : nees) EXPECT_NEAR(mean, 6, 1.13);
  const double freedom[4] = {2, 1, 1, 2};
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(nis[i] / compared[i], freedom[i], 4.5 * std::sqrt(2 * freedom[i] / compared[i])) << i;
  }
}

}  // namespace
}  // namespace regista::control
