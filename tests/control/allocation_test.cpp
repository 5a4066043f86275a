// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "counting_new.hpp"
#include "regista/control/complementary_filter.hpp"
#include "regista/control/kinematics.hpp"
#include "regista/control/odometry.hpp"
#include "regista/control/orientation_filter.hpp"
#include "regista/control/pose_ekf.hpp"
#include "regista/control/rollback.hpp"
#include "regista/control/translation_filter.hpp"

#ifndef EIGEN_RUNTIME_NO_MALLOC
#error "tests/CMakeLists.txt defines it, so that Eigen asserts when it allocates where it must not"
#endif

namespace regista::control {
namespace {

using namespace std::chrono_literals;

/// How often `steps` allocated.
template <typename Steps>
std::size_t allocations_of(Steps steps) {
  Eigen::internal::set_is_malloc_allowed(false);
  const std::size_t before = allocations().count;
  steps();
  const std::size_t after = allocations().count;
  Eigen::internal::set_is_malloc_allowed(true);
  return after - before;
}

TEST(Allocation, is_counted_at_all) {
  std::vector<double> memory;
  EXPECT_EQ(allocations_of([&] { memory.resize(100); }), 1u);
}

TEST(Allocation, never_happens_in_kinematics_and_odometry) {
  const Kinematics base = Kinematics::omni({0.8, 2.4, -2.4, -0.8}, 0.08);
  Odometry odometry;
  EXPECT_EQ(allocations_of([&] {
              for (int i = 0; i < 100; ++i) {
                const WheelSpeeds wheels = saturated(base.wheels({.x = 1, .y = 0.3, .w = 2}), 1);
                odometry.step(base.body(wheels), 10ms);
                if (base.slip(wheels) > 1) odometry.reset({});
              }
            }),
            0u);
}

TEST(Allocation, never_happens_in_a_step_of_a_filter_even_when_it_rolls_back_refuses_or_restarts) {
  auto translation = std::make_unique<Rollback<TranslationFilter>>(TranslationFilter{});
  auto orientation = std::make_unique<Rollback<OrientationFilter>>(OrientationFilter{});
  auto complementary = std::make_unique<Rollback<ComplementaryFilter>>(ComplementaryFilter{});
  auto pose = std::make_unique<Rollback<PoseEkf>>(PoseEkf{});
  PoseEkf::Explanation explanation;
  EXPECT_EQ(allocations_of([&] {
              for (int i = 0; i < 600; ++i) {
                translation->predict({.x = 0.1, .y = 0}, 2ms);
                orientation->predict(0.1, 2ms);
                complementary->predict(0.1, 2ms);
                pose->predict({}, 2ms);
                pose->correct(WheelMeasurement{.speed_sd_mps = 0.1, .w_sd_radps = 0.1});
                pose->correct(GyroMeasurement{.sd_radps = 0.1});
                if (i % 8 == 0 && i > 20) {
                  const double jump = i < 300 ? 0 : 2;
                  const PositionMeasurement position{.x = jump, .sd_m = 0.004};
                  const HeadingMeasurement heading{.heading_rad = jump, .sd_rad = 0.01};
                  translation->correct(position, 35ms);
                  orientation->correct(heading, 35ms);
                  complementary->correct(heading, 35ms);
                  pose->correct(position, 35ms);
                  pose->correct(heading, 35ms);
                }
                explanation = pose->filter().explain();
              }
            }),
            0u);
  EXPECT_EQ(translation->filter().state().position.restarts, 1u);
  EXPECT_EQ(explanation.position.restarts, 1u);
  EXPECT_EQ(explanation.heading.restarts, 1u);
}

}  // namespace
}  // namespace regista::control
