// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/control/waypoint_parking.hpp>

#include <random>
#include <stdexcept>

namespace regista::control {
namespace {

using namespace std::chrono_literals;

constexpr ParkingConfig config{
    .radius_m = 0.3, .leave_radius_m = 0.6, .estimates = 10, .jump_m = 1, .believe_after = 50};
constexpr Duration dt = 200ms;  // a GPS at 5 Hz
const Pose2d goal{.x = 10};

void see(ParkingDetector& parking, const Pose2d& estimate, int times) {
  for (int i = 0; i < times; ++i) parking.step(estimate, {}, goal, dt);
}

TEST(ParkingDetector, parks_after_enough_estimates_in_a_row) {
  ParkingDetector parking{config};
  see(parking, {.x = 9.8}, 9);
  EXPECT_FALSE(parking.parked());
  see(parking, {.x = 9.8}, 1);
  EXPECT_TRUE(parking.parked());
}

TEST(ParkingDetector, starts_counting_again_after_one_outside) {
  ParkingDetector parking{config};
  see(parking, {.x = 9.8}, 9);
  see(parking, {.x = 9.6}, 1);
  see(parking, {.x = 9.8}, 9);
  EXPECT_FALSE(parking.parked());
}

TEST(ParkingDetector, is_not_fooled_by_a_jump_onto_the_goal) {
  ParkingDetector parking{config};
  see(parking, {.x = 5}, 20);
  see(parking, goal, 49);
  EXPECT_FALSE(parking.parked());
  EXPECT_EQ(parking.jumps(), 49U);
  EXPECT_EQ(parking.pose()->x, 5);
  EXPECT_EQ(parking.age(), 49 * dt);
  see(parking, {.x = 5}, 1);
  EXPECT_EQ(parking.age(), Duration{});
}

TEST(ParkingDetector, is_not_fooled_while_it_drives_either) {
  ParkingDetector parking{config};
  double x = 0;
  for (int i = 0; x < 8; ++i) {
    x += 0.5 * seconds(dt);
    parking.step(i % 3 == 2 ? goal : Pose2d{.x = x}, {.x = 0.5}, goal, dt);
    ASSERT_FALSE(parking.parked());
    ASSERT_NEAR(parking.pose()->x, x, 1e-9);
  }
}

TEST(ParkingDetector, believes_a_jump_that_persists) {
  ParkingDetector parking{config};
  see(parking, {.x = 5}, 20);
  see(parking, goal, 50);
  EXPECT_EQ(*parking.pose(), goal);
  see(parking, goal, 9);
  EXPECT_TRUE(parking.parked());
}

TEST(ParkingDetector, does_not_believe_jumps_here_and_there) {
  ParkingDetector parking{config};
  see(parking, {.x = 5}, 20);
  for (int i = 0; i < 200; ++i) see(parking, {.x = i % 2 == 0 ? 10.0 : 20.0}, 1);
  EXPECT_EQ(parking.pose()->x, 5);
}

TEST(ParkingDetector, stays_parked_through_noise_and_jumps_until_it_has_really_left) {
  ParkingDetector parking{config};
  see(parking, goal, 10);
  std::mt19937 random{1};
  std::uniform_real_distribution<double> noise{-0.5, 0.5};
  for (int i = 0; i < 200; ++i) {
    see(parking, i % 7 == 0 ? Pose2d{.x = 13} : Pose2d{.x = 10 + noise(random)}, 1);
    ASSERT_TRUE(parking.parked());
  }
  see(parking, {.x = 10.7}, 9);
  EXPECT_TRUE(parking.parked());
  see(parking, {.x = 10.7}, 1);
  EXPECT_FALSE(parking.parked());
}

TEST(ParkingDetector, counts_what_is_no_number_like_a_jump) {
  ParkingDetector parking{config};
  see(parking, {.x = 9.8}, 9);
  see(parking, {.x = std::nan("")}, 1);
  see(parking, {.x = 9.8}, 1);
  EXPECT_FALSE(parking.parked());
  EXPECT_EQ(parking.jumps(), 1U);
  parking.step(std::nullopt, {.x = std::nan("")}, goal, dt);
  EXPECT_EQ(parking.pose()->x, 9.8);
}

TEST(ParkingDetector, names_the_value_that_it_refuses) {
  EXPECT_THROW(ParkingDetector({.radius_m = 0}), std::invalid_argument);
  EXPECT_THROW(ParkingDetector({.radius_m = 0.3, .leave_radius_m = 0.2}), std::invalid_argument);
  EXPECT_THROW(ParkingDetector({.estimates = 0}), std::invalid_argument);
}

}  // namespace
}  // namespace regista::control
