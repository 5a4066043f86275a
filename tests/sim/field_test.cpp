// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <numbers>
#include <regista/sim/field.hpp>

namespace regista::sim {
namespace {

using namespace std::chrono_literals;

/// A field, and the computers of its robots: each sends its command every 10 ms.
struct Bench {
  Field field;
  std::vector<MotorBoardCommand> commands;

  explicit Bench(std::initializer_list<Pose2d> poses) {
    for (const Pose2d& pose : poses) {
      (void)field.add({}, pose);
      commands.push_back({});
    }
  }

  void run(Duration duration) {
    for (Duration t{}; t < duration; t += 10ms) {
      for (std::size_t i = 0; i < commands.size(); ++i) {
        ++commands[i].sequence;
        std::array<std::uint8_t, motor_board_command_size> frame{};
        motor_board_pack_command(&commands[i], frame.data());
        field.board(i).receive(frame);
      }
      field.step(10ms);
    }
  }
  /// The wheels at 45° + k 90° that push a robot ahead: the left two backwards.
  void drive_ahead(std::size_t robot, std::int32_t wheel_mradps) {
    commands[robot].flags |= motor_board_drive;
    const std::array<std::int32_t, 4> signs{-1, -1, 1, 1};
    for (std::size_t i = 0; i < 4; ++i) commands[robot].wheel_mradps[i] = signs[i] * wheel_mradps;
  }
  [[nodiscard]] bool sees_ball(std::size_t robot) {
    return (field.board(robot).firmware().telemetry.status & motor_board_ball) != 0;
  }
};

constexpr Pose2d origin{};

TEST(Field, a_kick_sends_the_ball_where_the_robot_looks) {
  Bench bench{{.x = 1, .y = 1, .heading = std::numbers::pi / 2}};
  bench.field.place_ball(1, 1.105);
  bench.commands[0].flags = motor_board_charge;
  bench.run(2500ms);
  EXPECT_TRUE(bench.sees_ball(0));
  bench.commands[0].kick_id = 1;
  bench.commands[0].kick_speed_mmps = 3000;
  bench.run(50ms);
  EXPECT_NEAR(bench.field.ball().velocity().x, 0, 1e-9);
  EXPECT_NEAR(bench.field.ball().velocity().y, 3 - 3.4 * 0.05, 0.1);
  EXPECT_FALSE(bench.sees_ball(0));
}

TEST(Field, a_kick_without_the_ball_moves_nothing) {
  Bench bench{origin};
  bench.field.place_ball(-0.2, 0);
  bench.commands[0].flags = motor_board_charge;
  bench.run(2500ms);
  bench.commands[0].kick_id = 1;
  bench.commands[0].kick_speed_mmps = 3000;
  bench.run(50ms);
  EXPECT_EQ(bench.field.board(0).firmware().telemetry.kicks, 1);
  EXPECT_EQ(bench.field.ball().x_m(), -0.2);
}

TEST(Field, a_robot_pushes_the_ball_and_never_stands_on_it) {
  Bench bench{origin};
  bench.field.place_ball(0.4, 0.01);
  bench.drive_ahead(0, 20'000);
  for (int i = 0; i < 200; ++i) {
    bench.run(10ms);
    ASSERT_GE(bench.field.ball().x_m(), bench.field.pose(0).x + 0.1);
  }
  EXPECT_GT(bench.field.ball().x_m(), 0.6);
}

TEST(Field, a_dribbler_holds_the_ball_backwards_too_until_it_stops) {
  Bench bench{origin};
  bench.field.place_ball(0.1, 0);
  bench.commands[0].dribbler_radps = 100;
  bench.drive_ahead(0, -10'000);
  bench.run(1s);
  EXPECT_LT(bench.field.pose(0).x, -0.1);
  EXPECT_NEAR(bench.field.ball().x_m(), bench.field.pose(0).x + 0.1015, 0.005);
  bench.commands[0].dribbler_radps = 0;
  bench.drive_ahead(0, -20'000);
  bench.run(1s);
  EXPECT_GT(bench.field.ball().x_m(), bench.field.pose(0).x + 0.2);
}

TEST(Field, boards_around_it_send_the_ball_back) {
  Bench bench{Pose2d{.x = 4, .y = 0}};
  bench.field.place_ball(4.105, 0);
  bench.commands[0].flags = motor_board_charge;
  bench.run(2500ms);
  bench.commands[0].kick_id = 1;
  bench.commands[0].kick_speed_mmps = 4000;
  double farthest = 0;
  for (int i = 0; i < 100; ++i) {
    bench.run(10ms);
    farthest = std::max(farthest, bench.field.ball().x_m());
  }
  EXPECT_LE(farthest, 4.8 - Field::ball_radius_m);
  EXPECT_GT(farthest, 4.7);
  EXPECT_LT(bench.field.ball().x_m(), farthest - 0.1);
}

TEST(Field, robots_that_meet_are_kept_apart_and_counted) {
  Bench bench{{.x = 0, .y = 0, .heading = 0}, {.x = 0.6, .y = 0, .heading = std::numbers::pi}};
  bench.drive_ahead(0, 10'000);
  bench.drive_ahead(1, 10'000);
  for (int i = 0; i < 200; ++i) {
    bench.run(10ms);
    ASSERT_GT(distance(bench.field.pose(0), bench.field.pose(1)), 2 * Field::robot_radius_m - 1e-6);
  }
  EXPECT_GE(bench.field.collisions(), 1);
}

}  // namespace
}  // namespace regista::sim
