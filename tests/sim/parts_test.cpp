// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/sim/ball.hpp>
#include <regista/sim/battery.hpp>
#include <regista/sim/cia402_drive.hpp>

#include <chrono>
#include <cmath>
#include <stdexcept>

namespace regista::sim {
namespace {

using namespace std::chrono_literals;

TEST(Battery, an_hour_at_its_capacity_empties_it) {
  Battery battery{{.full_v = 12, .empty_v = 10, .capacity_ah = 2, .resistance_ohm = 0.1}};
  EXPECT_EQ(battery.voltage_v(), 12);
  battery.draw(2, 30min);
  EXPECT_NEAR(battery.charge_ratio(), 0.5, 1e-12);
  EXPECT_NEAR(battery.voltage_v(), 11 - 0.2, 1e-12);
  battery.draw(2, 40min);
  EXPECT_EQ(battery.charge_ratio(), 0);
  battery.draw(-2, 30min);
  EXPECT_NEAR(battery.charge_ratio(), 0.5, 1e-12);
}

TEST(Ball, stops_where_the_two_phase_model_says_whatever_the_step) {
  const BallParameters p{.slide_decel_mps2 = 3, .roll_decel_mps2 = 0.3, .roll_share = 0.6};
  const double roll = 0.6 * 4;
  const double way = (16 - roll * roll) / (2 * 3) + roll * roll / (2 * 0.3);
  for (const Duration dt : {Duration{1ms}, Duration{30s}}) {
    Ball ball{p};
    ball.kick({.x = 0, .y = -4});
    for (Duration t{}; t < 30s; t += dt) ball.step(dt);
    EXPECT_NEAR(ball.y_m(), -way, 1e-9);
    EXPECT_EQ(ball.speed_mps(), 0);
  }
}

TEST(Kicker, kicks_the_ball_ahead_and_pays_with_its_charge) {
  Kicker kicker{{.max_speed_mps = 8, .charge_s = 1}};
  Ball ball{{}};
  ball.place(0, 0.1);
  const Pose2d facing_left{.heading = std::numbers::pi / 2};
  EXPECT_EQ(kicker.kick(ball, facing_left, {}, 8), 0);  // not charged
  kicker.step(60s);
  EXPECT_NEAR(kicker.kick(ball, facing_left, {.x = 0.5}, 4), 4.5, 1e-9);
  EXPECT_NEAR(kicker.charge_ratio(), 0.75, 1e-9);  // (4/8)² of the energy
  ball.step(100ms);
  EXPECT_GT(ball.y_m(), 0.4);
  EXPECT_NEAR(ball.x_m(), 0, 1e-9);
}

TEST(Kicker, kicks_into_the_air_when_the_ball_is_elsewhere) {
  Kicker kicker{{}};
  kicker.step(60s);
  Ball ball{{}};
  ball.place(-0.1, 0);
  EXPECT_FALSE(kicker.reaches(ball, {}));
  EXPECT_EQ(kicker.kick(ball, {}, {}, 8), 0);
  EXPECT_LT(kicker.charge_ratio(), 1e-6);
}

Cia402Drive ready_drive() {
  Cia402Drive drive{{.accel_rpm_per_s = 1000, .decel_rpm_per_s = 2000, .quick_stop_rpm_per_s = 10000}};
  drive.step(100ms);
  return drive;
}

TEST(Cia402Drive, climbs_the_state_machine_and_says_so_in_its_statusword) {
  Cia402Drive drive{{}};
  EXPECT_EQ(drive.statusword() & 0x4F, 0x00);
  drive.write(0x000F, 0);
  EXPECT_EQ(drive.state(), Cia402State::not_ready_to_switch_on);
  drive.step(100ms);
  EXPECT_EQ(drive.statusword() & 0x4F, 0x40);
  drive.write(0x000F, 0);  // not from switch on disabled
  EXPECT_EQ(drive.state(), Cia402State::switch_on_disabled);
  drive.write(0x0006, 0);
  EXPECT_EQ(drive.statusword() & 0x6F, 0x21);
  drive.write(0x0007, 0);
  EXPECT_EQ(drive.statusword() & 0x6F, 0x23);
  drive.write(0x000F, 0);
  EXPECT_EQ(drive.statusword() & 0x6F, 0x27);
  drive.write(0x0007, 0);
  EXPECT_EQ(drive.statusword() & 0x6F, 0x23);
  drive.write(0x0000, 0);
  EXPECT_EQ(drive.statusword() & 0x4F, 0x40);
}

TEST(Cia402Drive, ramps_up_down_and_halts) {
  Cia402Drive drive = ready_drive();
  drive.write(0x0006, 0);
  drive.write(0x000F, 1500);
  drive.step(500ms);
  EXPECT_NEAR(drive.speed_rpm(), 500, 1e-9);
  drive.step(2s);
  EXPECT_EQ(drive.speed_rpm(), 1500);
  EXPECT_TRUE(drive.statusword() & 0x0400);
  drive.write(0x010F, 1500);
  drive.step(500ms);
  EXPECT_NEAR(drive.speed_rpm(), 500, 1e-9);
  drive.step(1s);
  EXPECT_EQ(drive.speed_rpm(), 0);
  EXPECT_EQ(drive.state(), Cia402State::operation_enabled);
}

TEST(Cia402Drive, a_quick_stop_brakes_hard_and_ends_disabled) {
  Cia402Drive drive = ready_drive();
  drive.write(0x0006, 0);
  drive.write(0x000F, 2000);
  drive.step(3s);
  drive.write(0x0002, 2000);
  EXPECT_EQ(drive.statusword() & 0x6F, 0x07);
  drive.step(100ms);
  EXPECT_NEAR(drive.speed_rpm(), 1000, 1e-9);
  drive.write(0x000F, 2000);  // no way back
  EXPECT_EQ(drive.state(), Cia402State::quick_stop_active);
  drive.step(200ms);
  EXPECT_EQ(drive.state(), Cia402State::switch_on_disabled);
  EXPECT_EQ(drive.speed_rpm(), 0);
}

TEST(Cia402Drive, leaves_a_fault_only_on_the_rising_edge_of_bit_7) {
  Cia402Drive drive = ready_drive();
  drive.write(0x0006, 0);
  drive.write(0x008F, 1000);
  drive.step(2s);
  drive.fail(0x8130);
  EXPECT_EQ(drive.statusword() & 0x4F, 0x0F);
  drive.step(1s);
  EXPECT_EQ(drive.statusword() & 0x4F, 0x08);
  drive.write(0x0080, 0);  // high before and after: no edge
  EXPECT_EQ(drive.state(), Cia402State::fault);
  drive.write(0x0000, 0);
  drive.write(0x0080, 0);
  EXPECT_EQ(drive.state(), Cia402State::switch_on_disabled);
  EXPECT_EQ(drive.error_code(), 0);
}

TEST(Cia402Drive, coasts_when_its_voltage_is_taken_away) {
  Cia402Drive drive = ready_drive();
  drive.write(0x0006, 0);
  drive.write(0x000F, 2000);
  drive.step(3s);
  drive.write(0x0000, 2000);
  drive.step(1s);
  EXPECT_NEAR(drive.speed_rpm(), 1500, 1e-9);
}

TEST(Parts, refuse_absurd_parameters) {
  EXPECT_THROW(Battery({.full_v = 9, .empty_v = 10}), std::invalid_argument);
  EXPECT_THROW(Ball({.roll_share = 2}), std::invalid_argument);
  EXPECT_THROW(Kicker({.charge_s = 0}), std::invalid_argument);
  EXPECT_THROW(Cia402Drive({.accel_rpm_per_s = -1}), std::invalid_argument);
}

}  // namespace
}  // namespace regista::sim
