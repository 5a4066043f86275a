// SPDX-License-Identifier: Apache-2.0
#include "regista/control/rollback.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "regista/control/complementary_filter.hpp"
#include "regista/control/orientation_filter.hpp"
#include "regista/control/pose_ekf.hpp"
#include "regista/control/translation_filter.hpp"

namespace regista::control {
namespace {

using namespace std::chrono_literals;

TranslationFilter started() {
  TranslationFilter filter;
  filter.correct(PositionMeasurement{.sd_m = 0.004});
  return filter;
}

PositionMeasurement at(double x) { return {.x = x, .sd_m = 0.004}; }

TEST(Rollback, a_late_measurement_counts_as_if_it_had_come_in_time) {
  TranslationFilter in_time = started();
  Rollback<TranslationFilter> late{started()};
  for (int i = 0; i < 40; ++i) {
    const FieldAcceleration a{.x = std::sin(0.3 * i), .y = 1};
    if (i == 15) in_time.correct(at(0.01));
    in_time.predict(a, 5ms);
    late.predict(a, 5ms);
  }
  EXPECT_FALSE(late.filter().state().kalman.x.isApprox(in_time.state().kalman.x, 1e-6));
  EXPECT_EQ(late.correct(at(0.01), 125ms).verdict, Verdict::fused);
  EXPECT_TRUE(late.filter().state().kalman.x.isApprox(in_time.state().kalman.x, 1e-13));
  EXPECT_TRUE(late.filter().state().kalman.p.isApprox(in_time.state().kalman.p, 1e-13));
}

TEST(Rollback, measurements_out_of_order_and_between_steps_equal_the_ordered_ones) {
  // Each measurement arrives 0 to 90 ms after its own time, so they overtake each other; the reference gets all of
  // them in the order of their own times, with steps cut there.
  std::mt19937 random{7};
  std::normal_distribution<double> normal;
  struct Late {
    Duration captured, arrives;
    PositionMeasurement z;
  };
  std::vector<Late> all;
  for (int i = 1; i <= 30; ++i) {
    const Duration captured = 13ms * i + std::chrono::microseconds{random() % 1000};
    const Duration delay = std::chrono::microseconds{random() % 90000};
    all.push_back({captured, captured + delay, {.x = 0.01 * normal(random), .y = 0.01 * normal(random), .sd_m = 0.01}});
  }
  TranslationFilter reference = started();
  Rollback<TranslationFilter> rollback{started()};
  const auto input = [](int step) { return FieldAcceleration{.x = std::cos(0.2 * step), .y = -0.5}; };

  std::size_t next = 0;
  Duration now{};
  for (int step = 0; step < 120; ++step) {
    const Duration end = 5ms * (step + 1);
    while (next < all.size() && all[next].captured <= end) {
      reference.predict(input(step), all[next].captured - now);
      reference.correct(all[next].z);
      now = all[next].captured;
      ++next;
    }
    reference.predict(input(step), end - now);
    now = end;
  }
  for (int step = 0; step < 120; ++step) {
    rollback.predict(input(step), 5ms);
    const Duration end = 5ms * (step + 1);
    for (const Late& late : all) {
      if (late.arrives > end - 5ms && late.arrives <= end) rollback.correct(late.z, end - late.captured);
    }
  }
  ASSERT_EQ(rollback.too_old(), 0u);
  EXPECT_EQ(rollback.filter().state().position.taken, reference.state().position.taken);
  EXPECT_EQ(rollback.filter().state().position.refused, reference.state().position.refused);
  EXPECT_TRUE(rollback.filter().state().kalman.x.isApprox(reference.state().kalman.x, 1e-11));
  EXPECT_TRUE(rollback.filter().state().kalman.p.isApprox(reference.state().kalman.p, 1e-11));
}

TEST(Rollback, without_late_measurements_is_the_filter_itself) {
  OrientationFilter plain;
  Rollback<OrientationFilter, 16> rollback{OrientationFilter{}};
  for (int i = 0; i < 1000; ++i) {
    if (i % 7 == 0) {
      const HeadingMeasurement z{.heading_rad = 0.02 * i, .sd_rad = 0.01};
      EXPECT_EQ(plain.correct(z).verdict, rollback.correct(z).verdict);
    }
    plain.predict(2, 10ms);
    rollback.predict(2, 10ms);
  }
  EXPECT_EQ(plain.state().kalman.x, rollback.filter().state().kalman.x);
  EXPECT_EQ(plain.state().kalman.p, rollback.filter().state().kalman.p);
}

TEST(Rollback, two_measurements_of_one_time_both_count) {
  PoseEkf ekf;
  ekf.reset({}, 1, 1);
  Rollback<PoseEkf> rollback{ekf};
  for (int i = 0; i < 20; ++i) rollback.predict({}, 10ms);
  // A camera sees position and heading at once.
  rollback.correct(PositionMeasurement{.x = 0.1, .sd_m = 0.01}, 55ms);
  rollback.correct(HeadingMeasurement{.heading_rad = 0.1, .sd_rad = 0.01}, 55ms);
  EXPECT_EQ(rollback.filter().state().position.taken, 1u);
  EXPECT_EQ(rollback.filter().state().heading.taken, 1u);
  EXPECT_NEAR(rollback.filter().estimate().pose.x, 0.1, 0.01);
  EXPECT_NEAR(rollback.filter().estimate().pose.heading, 0.1, 0.01);
}

TEST(Rollback, refuses_and_counts_what_is_older_than_its_history_or_from_the_future) {
  Rollback<TranslationFilter, 16> rollback{started()};
  for (int i = 0; i < 100; ++i) rollback.predict({}, 10ms);
  EXPECT_EQ(rollback.reach(), 150ms);
  const auto before = rollback.filter().state().kalman.x;
  EXPECT_EQ(rollback.correct(at(0.001), 151ms).verdict, Verdict::too_old);
  EXPECT_EQ(rollback.correct(at(0.001), -1ns).verdict, Verdict::too_old);
  EXPECT_EQ(rollback.correct(at(0.001), Duration::max()).verdict, Verdict::too_old);
  EXPECT_EQ(rollback.correct(at(0.001), Duration::min()).verdict, Verdict::too_old);
  EXPECT_EQ(rollback.too_old(), 4u);
  EXPECT_EQ(rollback.filter().state().kalman.x, before);
}

TEST(Rollback, works_at_both_ends_of_a_full_history) {
  Rollback<TranslationFilter, 16> rollback{started()};
  TranslationFilter reference = started();
  for (int i = 0; i < 100; ++i) {
    rollback.predict({}, 10ms);
    reference.predict({}, 10ms);
    if (i == 84) reference.correct(at(0.01));
  }
  EXPECT_EQ(rollback.correct(at(0.01), 150ms).verdict, Verdict::fused);
  EXPECT_TRUE(rollback.filter().state().kalman.x.isApprox(reference.state().kalman.x, 1e-13));
  EXPECT_EQ(rollback.correct(at(0.01), 150ms).verdict, Verdict::fused);  // the oldest has one already
  reference.correct(at(0.02));
  EXPECT_EQ(rollback.correct(at(0.02), 0ms).verdict, Verdict::fused);
  EXPECT_EQ(rollback.filter().state().position.taken, 4u);
}

TEST(Rollback, repeats_the_gates_in_the_order_of_the_measurements) {
  // Seen alone, the later position is an outlier; the earlier one, arriving late, makes it plausible.
  TranslationFilter filter{{.acceleration_density = 0.1, .initial_speed_sd_mps = 0.01}};
  filter.correct(PositionMeasurement{.sd_m = 0.004});
  Rollback<TranslationFilter> rollback{filter};
  for (int i = 0; i < 50; ++i) rollback.predict({}, 10ms);
  EXPECT_EQ(rollback.correct(PositionMeasurement{.x = 0.28, .sd_m = 0.004}, 0ms).verdict, Verdict::outlier);
  EXPECT_EQ(rollback.correct(PositionMeasurement{.x = 0.07, .sd_m = 0.004}, 250ms).verdict, Verdict::fused);
  EXPECT_EQ(rollback.filter().state().position.refused, 0u);
  EXPECT_EQ(rollback.filter().state().position.taken, 3u);
}

TEST(Rollback, forgets_the_past_when_the_filter_is_replaced) {
  Rollback<PoseEkf, 16> rollback{PoseEkf{}};
  for (int i = 0; i < 10; ++i) rollback.predict({}, 10ms);
  PoseEkf known = rollback.filter();
  known.reset({.x = 5}, 0.1, 0.1);
  rollback.replace(known);
  EXPECT_EQ(rollback.reach(), 0ms);
  EXPECT_EQ(rollback.correct(PositionMeasurement{.x = 5, .sd_m = 1}, 10ms).verdict, Verdict::too_old);
  EXPECT_EQ(rollback.filter().estimate().pose.x, 5);
}

TEST(Rollback, removes_the_error_that_the_delay_of_vision_causes) {
  // A robot swings at 1 m/s² and 1 Hz class speeds; vision at 60 Hz shows where it was 40 ms ago.
  TranslationFilter naive = started();
  Rollback<TranslationFilter> rollback{started()};
  double naive_error = 0, error = 0;
  const auto truth = [](double t) { return 0.1 * (1 - std::cos(5 * t)); };
  for (int i = 1; i <= 3000; ++i) {
    const double t = 0.001 * i;
    const FieldAcceleration a{.x = 2.5 * std::cos(5 * (t - 0.0005)), .y = 0};
    naive.predict(a, 1ms);
    rollback.predict(a, 1ms);
    if (i % 16 == 0 && i > 40) {
      const PositionMeasurement z{.x = truth(t - 0.040), .sd_m = 0.004};
      naive.correct(z);
      rollback.correct(z, 40ms);
    }
    naive_error = std::max(naive_error, std::abs(naive.estimate().x - truth(t)));
    error = std::max(error, std::abs(rollback.filter().estimate().x - truth(t)));
  }
  EXPECT_GT(naive_error, 0.005);
  EXPECT_LT(error, 1e-4);
}

static_assert(Restorable<ComplementaryFilter>);

}  // namespace
}  // namespace regista::control
