// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/sim/gps.hpp>
#include <regista/sim/imu.hpp>
#include <regista/sim/vision.hpp>

#include <chrono>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace regista::sim {
namespace {

using namespace std::chrono_literals;
constexpr double pi = std::numbers::pi;

constexpr ImuParameters perfect_imu{.accel_noise_mps2 = 0,
                                    .accel_bias_mps2 = 0,
                                    .accel_step_mps2 = 0,
                                    .gyro_noise_radps = 0,
                                    .gyro_bias_radps = 0,
                                    .gyro_bias_walk_radps_per_root_s = 0,
                                    .gyro_step_radps = 0,
                                    .misalignment_rad = 0};

TEST(Imu, a_perfect_one_reads_the_truth) {
  Imu imu{perfect_imu};
  const auto reading = imu.read(1, -2, 3, 0.001);
  EXPECT_EQ(reading.accel_x_mps2, 1);
  EXPECT_EQ(reading.accel_y_mps2, -2);
  EXPECT_EQ(reading.rate_radps, 3);
}

TEST(Imu, a_tilt_of_a_hundredth_leaks_a_hundredth_of_gravity) {
  double squares = 0;
  for (std::uint64_t seed = 0; seed < 1000; ++seed) {
    ImuParameters p = perfect_imu;
    p.misalignment_rad = 0.01;
    p.seed = seed;
    squares += std::pow(Imu{p}.read(0, 0, 0, 0.001).accel_x_mps2, 2);
  }
  EXPECT_NEAR(std::sqrt(squares / 1000), 0.0981, 0.009);  // four standard errors
}

TEST(Imu, its_noise_has_the_sd_it_was_given_and_its_bias_stays) {
  ImuParameters p = perfect_imu;
  p.gyro_noise_radps = 0.01;
  p.gyro_bias_radps = 0.1;
  Imu imu{p};
  double sum = 0, squares = 0;
  for (int i = 0; i < 10000; ++i) {
    const double rate = imu.read(0, 0, 0, 0.001).rate_radps;
    sum += rate;
    squares += rate * rate;
  }
  const double mean = sum / 10000;
  EXPECT_GT(std::abs(mean), 0.001);
  EXPECT_NEAR(std::sqrt(squares / 10000 - mean * mean), 0.01, 3e-4);
}

TEST(Imu, its_last_bit_is_the_chips) {
  ImuParameters p = perfect_imu;
  p.accel_step_mps2 = 0.038;
  Imu imu{p};
  EXPECT_NEAR(imu.read(0.02, 0.018, 0, 0.001).accel_x_mps2, 0.038, 1e-12);
  EXPECT_EQ(imu.read(0.018, 0.018, 0, 0.001).accel_y_mps2, 0);
}

TEST(Gps, comes_once_a_period_with_the_errors_it_was_given) {
  double squares = 0, steps = 0;
  int fixes = 0;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Gps gps{{.noise_m = 0.1, .drift_m = 2, .drift_s = 60, .seed = seed}};
    double before = 0;
    for (int i = 0; i < 1000; ++i) {
      const auto fix = gps.step({.x = 5}, 10ms);
      if (!fix) continue;
      if (i > 0) steps += std::pow(fix->x_m - before, 2);
      before = fix->x_m;
      squares += std::pow(fix->x_m - 5, 2);
      ++fixes;
    }
  }
  EXPECT_EQ(fixes, 200 * 51);  // at 0.01, 0.2, 0.4 … 10 s
  EXPECT_NEAR(std::sqrt(squares / fixes), std::hypot(2, 0.1), 0.3);
  // From fix to fix it moves by its noise twice and by what the drift forgets: metres of error, centimetres of step.
  const double step_variance = 2 * 0.01 + 2 * 4 * (1 - std::exp(-0.2 / 60));
  EXPECT_NEAR(std::sqrt(steps / (fixes - 200)), std::sqrt(step_variance), 0.02);
}

TEST(Gps, loses_the_signal_for_the_share_of_time_it_was_given) {
  Gps gps{{.loss_every_s = 20, .loss_s = 5}};
  int fixes = 0;
  for (int i = 0; i < 50000; ++i) fixes += gps.step({}, 200ms) ? 1 : 0;
  EXPECT_NEAR(fixes / 50000.0, 20.0 / 25, 0.04);
}

TEST(Gps, a_jump_leaps_by_metres_between_two_fixes) {
  Gps gps{{.noise_m = 0, .drift_m = 0, .jump_every_s = 10, .jump_m = 3}};
  double before = 0, largest = 0;
  for (int i = 0; i < 500; ++i) {
    const double x = gps.step({}, 200ms)->x_m;
    largest = std::max(largest, std::abs(x - before));
    before = x;
  }
  EXPECT_GT(largest, 2);
}

TEST(Magnetometer, errs_by_6_to_7_degrees_at_most_and_by_heading) {
  const Magnetometer compass{{}};
  double largest = 0;
  for (int i = 0; i < 360; ++i) largest = std::max(largest, std::abs(compass.error_rad(i * pi / 180)));
  EXPECT_GT(largest * 180 / pi, 6);
  EXPECT_LT(largest * 180 / pi, 7);
  EXPECT_NEAR(compass.error_rad(1), compass.error_rad(1 + 2 * pi), 1e-12);
}

TEST(Vision, delivers_what_was_true_when_it_was_captured) {
  Vision vision{{.period_s = 0.02, .noise_m = 0, .noise_rad = 0, .loss = 0, .delay_s = 0.03}};
  int count = 0;
  for (int ms = 1; ms <= 1000; ++ms) {
    for (const Detection& d : vision.step({.x = ms * 0.001}, 1ms)) {
      EXPECT_EQ(d.age, 30ms);
      EXPECT_NEAR(d.pose.x, (ms - 30) * 0.001, 1e-12);
      ++count;
    }
  }
  EXPECT_NEAR(count, 48.5, 1);
}

TEST(Vision, frames_stay_in_order_under_jitter) {
  Vision vision{{.period_s = 0.01, .noise_m = 0, .delay_s = 0.01, .delay_jitter_s = 0.05}};
  double before = 0;
  for (int ms = 1; ms <= 2000; ++ms) {
    for (const Detection& d : vision.step({.x = ms * 0.001}, 1ms)) {
      EXPECT_GT(d.pose.x, before);
      EXPECT_NEAR(d.pose.x, ms * 0.001 - seconds(d.age), 1e-9);
      before = d.pose.x;
    }
  }
  EXPECT_GT(before, 1.9);
}

TEST(Vision, two_cameras_see_the_robot_where_they_overlap_each_with_its_own_offset) {
  VisionParameters p{.cameras = {{.max_x_m = 0.5, .offset = {.x = 0.02}}, {.min_x_m = -0.5, .offset = {.x = -0.02}}},
                     .noise_m = 0,
                     .loss = 0,
                     .delay_s = 0};
  EXPECT_EQ(Vision{p}.step({.x = 1}, 1ms).size(), 1u);
  EXPECT_EQ(Vision{p}.step({.x = -1}, 1ms).size(), 1u);
  Vision vision{p};
  const auto& both = vision.step({}, 1ms);
  ASSERT_EQ(both.size(), 2u);
  EXPECT_EQ(both[0].pose.x, 0.02);
  EXPECT_EQ(both[1].pose.x, -0.02);
  EXPECT_TRUE(Vision{p}.step({.y = 11}, 1ms).empty());
}

TEST(Vision, loses_flips_and_teleports_as_often_as_it_was_told) {
  Vision vision{{.period_s = 0.01, .noise_rad = 0, .loss = 0.2, .delay_s = 0, .flip = 0.1, .teleport = 0.1}};
  int seen = 0, flipped = 0, elsewhere = 0;
  for (int i = 0; i < 10000; ++i) {
    for (const Detection& d : vision.step({.heading = 0.3}, 10ms)) {
      ++seen;
      flipped += std::abs(angle_between(0.3, d.pose.heading)) > 0.1 ? 1 : 0;
      elsewhere += std::hypot(d.pose.x, d.pose.y) > 0.5 ? 1 : 0;
    }
  }
  EXPECT_NEAR(seen, 8000, 160);
  EXPECT_NEAR(flipped, 800, 110);
  EXPECT_NEAR(elsewhere, 800, 110);
}

TEST(Sensors, repeat_a_seed_bit_for_bit) {
  Imu imu_a{{.seed = 5}}, imu_b{{.seed = 5}};
  Gps gps_a{{.seed = 5}}, gps_b{{.seed = 5}};
  Vision vision_a{{.seed = 5}}, vision_b{{.seed = 5}};
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(imu_a.read(1, 2, 3, 0.01).rate_radps, imu_b.read(1, 2, 3, 0.01).rate_radps);
    const auto fix_a = gps_a.step({}, 10ms);
    const auto fix_b = gps_b.step({}, 10ms);
    ASSERT_EQ(fix_a ? fix_a->x_m : 0, fix_b ? fix_b->x_m : 0);
    const auto& a = vision_a.step({}, 10ms);
    const auto& b = vision_b.step({}, 10ms);
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t k = 0; k < a.size(); ++k) ASSERT_EQ(a[k].pose, b[k].pose);
  }
}

TEST(Sensors, refuse_absurd_parameters) {
  EXPECT_THROW(Imu({.gyro_noise_radps = -1}), std::invalid_argument);
  EXPECT_THROW(Gps({.period_s = 0}), std::invalid_argument);
  EXPECT_THROW(Magnetometer({.noise_rad = NAN}), std::invalid_argument);
  EXPECT_THROW(Vision({.loss = 1.5}), std::invalid_argument);
  EXPECT_THROW(Vision({.cameras = {}}), std::invalid_argument);
  EXPECT_THROW(Vision({.cameras = {{.min_x_m = 1, .max_x_m = 0}}}), std::invalid_argument);
}

}  // namespace
}  // namespace regista::sim
