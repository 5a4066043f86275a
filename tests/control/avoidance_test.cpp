// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/control/avoidance.hpp>

#include <algorithm>
#include <random>
#include <stdexcept>
#include <vector>

namespace regista::control {
namespace {

using namespace std::chrono_literals;

constexpr double robot_radius_m = 0.09;
constexpr AvoidanceConfig config{.speed_mps = 2, .acceleration_mps2 = 3, .horizon = 1500ms};

struct Robot {
  Disc disc;
  Pose2d goal;
};

/// Robots that want to go straight to their goals, braking in time; obstacles that go straight on.
class Field {
 public:
  void add_robot(double x, double y, double goal_x, double goal_y) {
    robots_.push_back(
        {.disc = {.x = x, .y = y, .radius_m = robot_radius_m, .cooperates = true}, .goal = {.x = goal_x, .y = goal_y}});
  }
  void add_obstacle(const Disc& disc) { obstacles_.push_back(disc); }

  /// Until all are at their goals or the time is over.
  void run(double for_s) {
    constexpr Duration dt = 10ms;
    Avoidance avoidance{config};
    for (time_s_ = 0; time_s_ < for_s && !all_there(); time_s_ += seconds(dt)) {
      std::vector<FieldVelocity> commands;
      for (const Robot& robot : robots_) {
        std::vector<Disc> others = obstacles_;
        for (const Robot& other : robots_) {
          if (&other != &robot) others.push_back(other.disc);
        }
        const auto output = avoidance.step(robot.disc, wish(robot), others, dt);
        EXPECT_FALSE(output.refused);
        const double change =
            std::hypot(output.velocity.x - robot.disc.velocity.x, output.velocity.y - robot.disc.velocity.y);
        EXPECT_LE(change, config.acceleration_mps2 * seconds(dt) + 1e-9);
        EXPECT_LE(std::hypot(output.velocity.x, output.velocity.y), config.speed_mps + 1e-9);
        commands.push_back(output.velocity);
      }
      for (std::size_t i = 0; i < robots_.size(); ++i) {
        robots_[i].disc.velocity = commands[i];
        move(robots_[i].disc, seconds(dt));
      }
      for (Disc& obstacle : obstacles_) move(obstacle, seconds(dt));
      measure();
    }
  }

  /// Between hulls, the least ever; negative is a collision.
  [[nodiscard]] double closest_m() const { return closest_m_; }
  [[nodiscard]] double time_s() const { return time_s_; }
  [[nodiscard]] bool all_there() const {
    return std::all_of(robots_.begin(), robots_.end(), [](const Robot& robot) {
      return std::hypot(robot.goal.x - robot.disc.x, robot.goal.y - robot.disc.y) < 0.02;
    });
  }

 private:
  static void move(Disc& disc, double dt_s) {
    disc.x += disc.velocity.x * dt_s;
    disc.y += disc.velocity.y * dt_s;
  }

  static FieldVelocity wish(const Robot& robot) {
    const double dx = robot.goal.x - robot.disc.x;
    const double dy = robot.goal.y - robot.disc.y;
    const double far = std::hypot(dx, dy);
    if (far < 1e-6) return {};
    const double speed = std::min({config.speed_mps, std::sqrt(2 * 0.8 * config.acceleration_mps2 * far), 4 * far});
    return {.x = speed * dx / far, .y = speed * dy / far};
  }

  void measure() {
    std::vector<Disc> all = obstacles_;
    for (const Robot& robot : robots_) all.push_back(robot.disc);
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      const Disc& robot = robots_[i].disc;
      for (std::size_t j = 0; j < all.size(); ++j) {
        if (j == obstacles_.size() + i) continue;
        const double gap = std::hypot(all[j].x - robot.x, all[j].y - robot.y) - robot.radius_m - all[j].radius_m;
        closest_m_ = std::min(closest_m_, gap);
      }
    }
  }

  std::vector<Robot> robots_;
  std::vector<Disc> obstacles_;
  double closest_m_ = 1e9;
  double time_s_ = 0;
};

TEST(Avoidance, alone_takes_the_preferred_velocity) {
  Avoidance avoidance{config};
  const auto output =
      avoidance.step({.velocity = {.x = 1}, .radius_m = 0.09}, {.x = 1.01, .y = 0.01, .w = 2}, {}, 10ms);
  EXPECT_NEAR(output.velocity.x, 1.01, 1e-12);
  EXPECT_NEAR(output.velocity.y, 0.01, 1e-12);
  EXPECT_EQ(output.velocity.w, 2);
  EXPECT_TRUE(output.clear);
}

TEST(Avoidance, names_what_it_refuses) {
  const auto with = [](auto change) {
    AvoidanceConfig bad = config;
    change(bad);
    return bad;
  };
  EXPECT_THROW(Avoidance(with([](auto& c) { c.speed_mps = 0; })), std::invalid_argument);
  EXPECT_THROW(Avoidance(with([](auto& c) { c.acceleration_mps2 = -1; })), std::invalid_argument);
  EXPECT_THROW(Avoidance(with([](auto& c) { c.horizon = 500ms; })), std::invalid_argument);
  EXPECT_THROW(Avoidance(with([](auto& c) { c.margin_m = std::nan(""); })), std::invalid_argument);
}

TEST(Avoidance, brakes_when_it_is_told_no_numbers_or_too_much) {
  Avoidance avoidance{config};
  const Disc self{.velocity = {.x = 1}, .radius_m = 0.09};
  const std::vector<Disc> crowd(Avoidance::capacity + 1, Disc{.x = 5, .radius_m = 0.09});
  const std::vector<Disc> nowhere{{.x = std::nan(""), .radius_m = 0.09}};
  for (const auto& output : {avoidance.step(self, {.x = 1}, crowd, 10ms), avoidance.step(self, {.x = 1}, nowhere, 10ms),
                             avoidance.step(self, {.x = std::nan("")}, {}, 10ms)}) {
    EXPECT_TRUE(output.refused);
    EXPECT_NEAR(output.velocity.x, 0.97, 1e-12);
  }
  EXPECT_EQ(avoidance.refused(), 3U);
}

TEST(Avoidance, two_robots_head_on_pass_each_other) {
  Field field;
  field.add_robot(-2, 0, 2, 0);
  field.add_robot(2, 0, -2, 0);
  field.run(6);
  EXPECT_TRUE(field.all_there()) << field.time_s();
  EXPECT_GT(field.closest_m(), 0);
}

TEST(Avoidance, goes_around_a_disc_that_stands_in_the_way) {
  Field field;
  field.add_robot(-2, 0, 2, 0);
  field.add_obstacle({.x = 0, .y = 0, .radius_m = 0.5});
  field.run(6);
  EXPECT_TRUE(field.all_there()) << field.time_s();
  EXPECT_GT(field.closest_m(), 0);
}

TEST(Avoidance, gets_out_of_the_way_of_who_does_not_care) {
  Field field;
  field.add_robot(0, 0, 0, 0.5);
  field.add_obstacle({.x = 2.5, .y = 0.2, .velocity = {.x = -1.5}, .radius_m = robot_radius_m});
  field.run(6);
  EXPECT_TRUE(field.all_there()) << field.time_s();
  EXPECT_GT(field.closest_m(), 0);
}

TEST(Avoidance, twelve_robots_swap_places_across_a_circle) {
  Field field;
  for (int i = 0; i < 12; ++i) {
    const double angle = i * std::numbers::pi / 6;
    field.add_robot(2 * std::cos(angle), 2 * std::sin(angle), -2 * std::cos(angle), -2 * std::sin(angle));
  }
  field.run(20);
  EXPECT_TRUE(field.all_there()) << field.time_s();
  EXPECT_GT(field.closest_m(), 0);
}

TEST(Avoidance, sixteen_robots_cross_among_sixteen_obstacles_without_a_collision) {
  std::mt19937 random{1};
  std::uniform_real_distribution<double> unit{-1, 1};
  int arrived = 0;
  for (int run = 0; run < 10; ++run) {
    Field field;
    std::vector<std::pair<double, double>> taken;
    const auto free_place = [&](double apart) {
      for (;;) {
        const double x = 4 * unit(random);
        const double y = 3 * unit(random);
        const bool is_free = std::all_of(taken.begin(), taken.end(), [&](const auto& place) {
          return std::hypot(place.first - x, place.second - y) > apart;
        });
        if (is_free) return taken.emplace_back(x, y);
      }
    };
    for (int i = 0; i < 16; ++i) {
      const auto [x, y] = free_place(0.8);
      field.add_obstacle({.x = x, .y = y, .radius_m = robot_radius_m});
    }
    for (int i = 0; i < 16; ++i) {
      const auto [x, y] = free_place(0.4);
      const auto [goal_x, goal_y] = free_place(0.4);
      field.add_robot(x, y, goal_x, goal_y);
    }
    field.run(15);
    EXPECT_GT(field.closest_m(), 0) << "run " << run;
    arrived += field.all_there();
  }
  EXPECT_GE(arrived, 9);  // a local method may stand before a dead end
}

}  // namespace
}  // namespace regista::control
