// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <regista/core/geometry.hpp>
#include <regista/vision/delay_estimator.hpp>

namespace regista::vision {
namespace {

using namespace std::chrono_literals;

/// A robot that turns as it is told, its gyro, and a camera above it.
struct Turning {
  std::function<double(double t)> heading = [](double) { return 0.0; };
  double delay_s = 0.025;
  double noise_rad = 0.010;
  double flips = 0;
  double gyro_hz = 200;
  double gyro_noise_radps = 0.02;
  double gyro_bias_radps = 0.02;
  double gyro_scale = 1;
  double clock_s = 1.8e9;     ///< of the robot
  double way_s = 0.0003;      ///< of its messages, and at random
  double way_more_s = 0.002;  ///< more, in the mean
  std::uint64_t seed = 1;

  static Time at(double t) { return Time{} + 1h + from_seconds(t); }
  double rate(double t) const { return (heading(t + 1e-5) - heading(t - 1e-5)) / 2e-5; }

  void run(DelayEstimator& estimator, double duration_s, ssl::RobotId id = {ssl::Team::yellow, 3}) const {
    std::mt19937_64 random{seed};
    std::normal_distribution<double> normal;
    std::exponential_distribution<double> exponential{1};
    std::uniform_real_distribution<double> uniform;
    double gyro = 0;
    double frame = 0;
    double last_arrival = 0;
    while (gyro < duration_s) {
      if (gyro < frame + delay_s) {
        const double said = gyro_scale * rate(gyro) + gyro_bias_radps + gyro_noise_radps * normal(random);
        last_arrival = std::max(last_arrival, gyro + way_s + way_more_s * exponential(random));
        estimator.turning(id, said, clock_s + gyro, at(last_arrival), from_seconds(way_s));
        gyro += 1 / gyro_hz;
        continue;
      }
      double seen = heading(frame) + noise_rad * normal(random);
      if (uniform(random) < flips) seen += uniform(random) < 0.5 ? std::numbers::pi / 2 : -std::numbers::pi / 2;
      estimator.seen(id, 0, wrap_angle(seen), at(frame + delay_s));
      frame += 1.0 / 75;
    }
  }
};

/// Quarter turns to and fro, at 3 rad/s with 12 rad/s², each begun every 1.2 s.
double quarter_turns(double t) {
  const double phase = std::fmod(t, 2.4);
  const auto half = [](double s) {
    constexpr double acceleration = 12, speed = 3, angle = std::numbers::pi / 2;
    constexpr double ramp = speed / acceleration, total = angle / speed + ramp;
    if (s <= 0) return 0.0;
    if (s >= total) return angle;
    if (s < ramp) return acceleration * s * s / 2;
    if (s > total - ramp) return angle - acceleration * (total - s) * (total - s) / 2;
    return speed * (s - ramp / 2);
  };
  return phase < 1.2 ? half(phase) : std::numbers::pi / 2 - half(phase - 1.2);
}

TEST(DelayEstimator, learns_any_delay_within_two_milliseconds) {
  for (const double delay_s : {0.0, 0.003, 0.025, 0.06, 0.15}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      DelayEstimator estimator;
      Turning{.heading = quarter_turns, .delay_s = delay_s, .seed = seed}.run(estimator, 15);
      const auto learnt = estimator.estimate();
      ASSERT_TRUE(learnt) << delay_s;
      EXPECT_NEAR(seconds(learnt->delay), delay_s, 0.002);
      EXPECT_NEAR(seconds(learnt->delay), delay_s, 4 * seconds(learnt->sd) + 0.0005);
      if (seed == 1) {
        std::printf("%5.1f ms: learnt %.2f ± %.2f ms from %lu turns\n", 1e3 * delay_s, 1e3 * seconds(learnt->delay),
                    1e3 * seconds(learnt->sd), learnt->turns);
      }
    }
  }
}

TEST(DelayEstimator, says_how_certain_it_is) {
  double squares = 0;
  double said = 0;
  constexpr int runs = 40;
  for (std::uint64_t seed = 1; seed <= runs; ++seed) {
    DelayEstimator estimator;
    Turning{.heading = quarter_turns, .noise_rad = 0.02, .way_more_s = 0, .seed = seed}.run(estimator, 20);
    const auto learnt = estimator.estimate();
    ASSERT_TRUE(learnt);
    squares += std::pow(seconds(learnt->delay) - 0.025, 2) / runs;
    said += seconds(learnt->sd) / runs;
  }
  std::printf("deviation %.2f ms, said %.2f ms\n", 1e3 * std::sqrt(squares), 1e3 * said);
  EXPECT_LT(std::sqrt(squares), 1.3 * said);
  EXPECT_GT(std::sqrt(squares), said / 4);
}

TEST(DelayEstimator, does_not_learn_from_robots_that_stand_or_turn_steadily) {
  for (const double rate : {0.0, 0.5, 6.0}) {
    DelayEstimator estimator;
    Turning{.heading = [rate](double t) { return rate * t; }}.run(estimator, 60);
    EXPECT_FALSE(estimator.estimate()) << rate;
  }
}

TEST(DelayEstimator, does_not_learn_from_what_is_another_robot) {
  DelayEstimator estimator;
  Turning told{.heading = quarter_turns, .delay_s = 0.02};
  told.gyro_scale = -1;
  told.run(estimator, 60);
  EXPECT_FALSE(estimator.estimate());
}

TEST(DelayEstimator, is_not_led_astray_by_misread_patterns_and_a_bad_gyro) {
  DelayEstimator estimator;
  Turning{.heading = quarter_turns, .flips = 0.1, .gyro_bias_radps = 0.1, .gyro_scale = 1.05}.run(estimator, 20);
  const auto learnt = estimator.estimate();
  ASSERT_TRUE(learnt);
  EXPECT_NEAR(seconds(learnt->delay), 0.025, 0.002);
}

TEST(DelayEstimator, learns_from_a_robot_that_tells_seldom) {
  DelayEstimator estimator;
  Turning{.heading = quarter_turns, .gyro_hz = 40}.run(estimator, 20);
  const auto learnt = estimator.estimate();
  ASSERT_TRUE(learnt);
  EXPECT_NEAR(seconds(learnt->delay), 0.025, 0.003);
}

TEST(DelayEstimator, learns_anew_when_the_delay_changes) {
  DelayEstimator estimator;
  Turning{.heading = quarter_turns, .delay_s = 0.02}.run(estimator, 20);
  Turning later{.heading = quarter_turns, .delay_s = 0.05};
  // Another robot, so that the time of the first does not run backwards.
  later.run(estimator, 1000, {ssl::Team::blue, 1});
  const auto learnt = estimator.estimate();
  ASSERT_TRUE(learnt);
  EXPECT_NEAR(seconds(learnt->delay), 0.05, 0.002);
}

TEST(DelayEstimator, learns_nothing_from_robots_that_disagree) {
  constexpr ssl::RobotId other{ssl::Team::blue, 1}, third{ssl::Team::blue, 2};
  DelayEstimator estimator;
  Turning{.heading = quarter_turns}.run(estimator, 15);
  Turning{.heading = quarter_turns, .seed = 2}.run(estimator, 15, other);
  EXPECT_FALSE(estimator.disagree());
  EXPECT_TRUE(estimator.estimate());
  // It tells what it was commanded, and does so 40 ms later.
  Turning{.heading = quarter_turns, .delay_s = 0.065, .seed = 3}.run(estimator, 15, third);
  EXPECT_TRUE(estimator.disagree());
  EXPECT_FALSE(estimator.estimate());
}

TEST(DelayEstimator, refuses_what_no_robot_can_turn) {
  constexpr ssl::RobotId id{ssl::Team::yellow, 3};
  DelayEstimator estimator;
  const Turning turning{.heading = quarter_turns};
  double t = -1;
  for (const double rate : {1e308, 1e308, -1e308, 101.0, std::numeric_limits<double>::quiet_NaN()}) {
    estimator.turning(id, rate, turning.clock_s + t, Turning::at(t), 0ms);
    t += 0.005;
  }
  turning.run(estimator, 15);
  const auto learnt = estimator.estimate();
  ASSERT_TRUE(learnt);
  EXPECT_NEAR(seconds(learnt->delay), 0.025, 0.002);
}

}  // namespace
}  // namespace regista::vision
