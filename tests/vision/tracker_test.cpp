// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "counting_new.hpp"
#include "synthetic_field.hpp"

namespace regista::vision {
namespace {

using namespace std::chrono_literals;
using ssl::RobotId;
using ssl::Team;

constexpr RobotId yellow(std::uint8_t number) { return {Team::yellow, number}; }
constexpr RobotId blue(std::uint8_t number) { return {Team::blue, number}; }

SyntheticField::Truth standing(const Pose2d& pose) {
  return [pose](double) { return pose; };
}

/// Eleven a side, on a grid.
void line_up(SyntheticField& field) {
  for (std::uint8_t number = 0; number < 11; ++number) {
    field.robots[yellow(number)] =
        standing({.x = -3 + 0.5 * number, .y = 1.0 + 0.1 * number, .heading = 0.6 * number - 3});
    field.robots[blue(number)] =
        standing({.x = 3.2 - 0.5 * number, .y = -0.8 - 0.1 * number, .heading = 3 - 0.6 * number});
  }
}

double position_error(const SyntheticField& field, RobotId id, double t) {
  const auto robot = field.tracker.predict(id, SyntheticField::at(t));
  return robot ? distance(robot->pose, field.robots.at(id)(t)) : 1e9;
}

double heading_error(const SyntheticField& field, RobotId id, double t) {
  const auto robot = field.tracker.predict(id, SyntheticField::at(t));
  return robot ? std::abs(angle_between(robot->pose.heading, field.robots.at(id)(t).heading)) : 1e9;
}

struct Deviation {
  double m = 0;
  double rad = 0;
};

/// The largest of all robots, of what is told in `seconds`.
Deviation worst_at_rest(SyntheticField& field, double seconds) {
  struct Sums {
    double n = 0, x = 0, xx = 0, y = 0, yy = 0, h = 0, hh = 0;
  };
  std::map<RobotId, Sums> all;
  field.run(seconds, [&] {
    for (const RobotId id : field.tracker.corrected()) {
      const auto robot = field.tracker.robot(id);
      const Pose2d truth = field.robots.at(id)(field.t);
      Sums& s = all[id];
      const double x = robot->pose.x - truth.x;
      const double y = robot->pose.y - truth.y;
      const double h = angle_between(truth.heading, robot->pose.heading);
      s.n += 1, s.x += x, s.xx += x * x, s.y += y, s.yy += y * y, s.h += h, s.hh += h * h;
    }
  });
  Deviation worst;
  for (const auto& [id, s] : all) {
    worst.m = std::max(
        {worst.m, std::sqrt(s.xx / s.n - s.x * s.x / s.n / s.n), std::sqrt(s.yy / s.n - s.y * s.y / s.n / s.n)});
    worst.rad = std::max(worst.rad, std::sqrt(s.hh / s.n - s.h * s.h / s.n / s.n));
  }
  EXPECT_EQ(all.size(), field.robots.size());
  return worst;
}

TEST(Tracker, keeps_robots_at_rest_within_a_millimetre_whatever_the_noise) {
  struct Case {
    const char* name;
    double m, rad;
  };
  for (const auto& [name, m, rad] :
       {Case{"none", 0, 0}, Case{"league simulators", 0.0013, 0.010}, Case{"well calibrated", 0.002, 0.006},
        Case{"vibrating", 0.004, 0.010}, Case{"grSim", 0.003, 2 * std::numbers::pi / 180}}) {
    SyntheticField field{.noise_m = m, .noise_rad = rad};
    line_up(field);
    field.run(1);
    const Deviation worst = worst_at_rest(field, 10);
    std::printf("%-20s %.2f mm %.1f mrad: worst of 22 at rest %.2f mm %.2f mrad\n", name, 1e3 * m, 1e3 * rad,
                1e3 * worst.m, 1e3 * worst.rad);
    EXPECT_LT(worst.m, 0.001) << name;
    EXPECT_LT(worst.rad, 0.005) << name;
  }
}

TEST(Tracker, learns_how_noisy_a_camera_is) {
  SyntheticField field{.noise_m = 0.004, .noise_rad = 0.02};
  line_up(field);
  field.robots[yellow(0)] = [](double t) { return Pose2d{.x = std::cos(t), .y = std::sin(t), .heading = 2 * t}; };
  field.run(5);
  const CameraReport camera = field.tracker.cameras(SyntheticField::at(field.t)).at(0);
  EXPECT_NEAR(camera.noise_m, 0.004, 0.0005);
  EXPECT_NEAR(camera.noise_rad, 0.02, 0.002);
  EXPECT_NEAR(camera.rate_hz, 75, 1);
}

TEST(Tracker, follows_a_robot_that_drives_and_turns) {
  SyntheticField field;
  // 2 m/s on a circle of 1 m: 4 m/s² across, and 6 rad/s.
  field.robots[blue(3)] = [](double t) {
    return Pose2d{.x = std::cos(2 * t), .y = std::sin(2 * t), .heading = wrap_angle(6 * t)};
  };
  field.run(1);
  double worst_m = 0;
  double worst_rad = 0;
  field.run(5, [&] {
    worst_m = std::max(worst_m, position_error(field, blue(3), field.t));
    worst_rad = std::max(worst_rad, heading_error(field, blue(3), field.t));
  });
  std::printf("driving: worst %.1f mm %.1f mrad\n", 1e3 * worst_m, 1e3 * worst_rad);
  EXPECT_LT(worst_m, 0.012);
  EXPECT_LT(worst_rad, 0.05);
  const auto robot = field.now(blue(3));
  ASSERT_TRUE(robot);
  EXPECT_NEAR(std::hypot(robot->velocity.x, robot->velocity.y), 2, 0.3);
  EXPECT_NEAR(robot->velocity.w, 6, 0.6);
}

TEST(Tracker, notices_soon_that_a_robot_starts) {
  SyntheticField field;
  field.robots[blue(3)] = [](double t) {
    const double driven = std::max(0.0, t - 3);
    return Pose2d{.x = 1.5 * driven * driven, .y = 0, .heading = 0};  // 3 m/s²
  };
  field.run(3);
  ASSERT_TRUE(field.now(blue(3))->resting);
  double worst = 0;
  field.run(0.7, [&] { worst = std::max(worst, position_error(field, blue(3), field.t)); });
  std::printf("starting: worst %.1f mm\n", 1e3 * worst);
  EXPECT_LT(worst, 0.015);
  EXPECT_LT(position_error(field, blue(3), field.t), 0.006);
}

TEST(Tracker, hands_a_robot_from_camera_to_camera_without_a_step) {
  SyntheticField field{.cameras = {{.to_x = 0.4, .offset_x = -0.02}, {.from_x = -0.4, .offset_x = 0.02}}};
  field.robots[yellow(1)] = [](double t) { return Pose2d{.x = -2 + t, .y = 0, .heading = 0}; };
  field.run(0.5);
  std::optional<double> before;
  double worst_step = 0;
  double worst = 0;
  field.run(3, [&] {
    const auto robot = field.now(yellow(1));
    ASSERT_TRUE(robot);
    const double error = robot->pose.x - (-2 + field.t);
    if (before) worst_step = std::max(worst_step, std::abs(error - *before));
    before = error;
    worst = std::max(worst, std::abs(error));
  });
  std::printf("between cameras 40 mm apart: steps up to %.1f mm\n", 1e3 * worst_step);
  EXPECT_LT(worst_step, 0.01);
  EXPECT_LT(worst, 0.027);
}

TEST(Tracker, keeps_robots_at_rest_between_cameras_that_disagree) {
  SyntheticField field{.cameras = {{.offset_x = -0.02}, {.offset_x = 0.02}, {.offset_y = 0.02}, {.offset_y = -0.02}}};
  line_up(field);
  field.run(1.5);
  const Deviation worst = worst_at_rest(field, 5);
  EXPECT_LT(worst.m, 0.001);
  EXPECT_LT(worst.rad, 0.005);
  EXPECT_LT(position_error(field, blue(3), field.t), 0.003);  // the mean of the four
  const CameraReport camera = field.tracker.cameras(SyntheticField::at(field.t)).at(0);
  EXPECT_NEAR(camera.overlap_m, 0.04, 0.005);
}

TEST(Tracker, is_not_turned_by_misread_patterns) {
  SyntheticField field{.flips = 0.2};
  line_up(field);
  field.robots[yellow(0)] = [](double t) { return Pose2d{.x = 0, .y = 0, .heading = wrap_angle(8 * t)}; };
  field.run(1);
  double worst = 0;
  field.run(10, [&] {
    for (const auto& [id, truth] : field.robots) worst = std::max(worst, heading_error(field, id, field.t));
  });
  std::printf("every fifth heading a quarter off: worst %.0f mrad\n", 1e3 * worst);
  EXPECT_LT(worst, 0.2);
  EXPECT_GT(field.tracker.counters().flips, 1000U);
}

TEST(Tracker, drops_frames_that_show_the_field_turned_or_reflected) {
  for (const auto& [sx, sy] : {std::pair{-1, -1}, std::pair{-1, 1}, std::pair{1, -1}}) {
    SyntheticField field;
    line_up(field);
    field.run(1);
    int spoilt = 0;
    field.spoil = [&, sx = sx, sy = sy](ssl::Detection& seen, double t) {
      if (std::fmod(t, 1.0) > 0.25) return;  // 19 frames in a row
      ++spoilt;
      for (auto& robot : seen.robots) {
        robot.x_m *= sx;
        robot.y_m *= sy;
        robot.heading_rad = wrap_angle(*robot.heading_rad + std::numbers::pi);
      }
    };
    double worst = 0;
    field.run(5, [&] {
      for (const auto& [id, truth] : field.robots) worst = std::max(worst, position_error(field, id, field.t));
    });
    EXPECT_LT(worst, 0.01);
    EXPECT_EQ(field.tracker.cameras(SyntheticField::at(field.t)).at(0).mirrored, static_cast<std::uint64_t>(spoilt));
  }
}

TEST(Tracker, believes_a_field_that_stays_turned) {
  SyntheticField field;
  line_up(field);
  field.run(1);
  for (auto& [id, truth] : field.robots) {
    const Pose2d pose = truth(0);
    truth = standing({.x = -pose.x, .y = -pose.y, .heading = wrap_angle(pose.heading + std::numbers::pi)});
  }
  field.run(1.5);
  for (const auto& [id, truth] : field.robots) EXPECT_LT(position_error(field, id, field.t), 0.01) << to_string(id);
}

TEST(Tracker, finds_a_robot_that_was_put_elsewhere_within_200_ms) {
  for (const double rate : {60.0, 75.0, 100.0}) {
    SyntheticField field{.rate_hz = rate};
    line_up(field);
    field.run(2);
    for (int i = 0; i < 20; ++i) {
      const RobotId id = i % 2 == 0 ? yellow(4) : blue(7);
      // Also into places that are taken at first, and only turned.
      const Pose2d was = field.robots[id](0);
      field.robots[id] = standing(i % 5 == 4 ? Pose2d{.x = was.x, .y = was.y, .heading = wrap_angle(was.heading + 1.7)}
                                             : Pose2d{.x = 4.0 - 0.37 * i, .y = 2.5, .heading = wrap_angle(1.1 * i)});
      double found = 0;
      const double moved = field.t;
      field.run(0.5, [&] {
        if (found == 0 && position_error(field, id, field.t) < 0.02 && heading_error(field, id, field.t) < 0.05)
          found = field.t - moved;
      });
      EXPECT_GT(found, 0);
      EXPECT_LT(found, 0.2) << rate << " Hz, " << i;
    }
    EXPECT_EQ(field.tracker.counters().reacquired, 20U);
  }
}

TEST(Tracker, finds_two_robots_that_swapped_their_places) {
  SyntheticField field;
  line_up(field);
  field.run(2);
  std::swap(field.robots[yellow(2)], field.robots[blue(5)]);
  field.run(0.2);
  EXPECT_LT(position_error(field, yellow(2), field.t), 0.02);
  EXPECT_LT(position_error(field, blue(5), field.t), 0.02);
}

TEST(Tracker, shows_no_ghosts) {
  SyntheticField field;
  line_up(field);
  std::mt19937_64 random{2};
  std::uniform_real_distribution<double> x{-4, 4};
  std::uniform_int_distribution<int> number{0, 15};
  std::uniform_int_distribution<int> coin{0, 1};
  // In every frame three robots that are not there, under names that are and that are not on the field.
  field.spoil = [&](ssl::Detection& seen, double) {
    for (int i = 0; i < 3; ++i) {
      const RobotId id{coin(random) != 0 ? Team::blue : Team::yellow, static_cast<std::uint8_t>(number(random))};
      seen.robots.push_back({.id = id, .x_m = x(random), .y_m = x(random) / 2, .heading_rad = x(random) * 0.7});
    }
  };
  field.run(1);
  double worst = 0;
  field.run(60, [&] {
    for (const RobotId id : field.tracker.corrected()) {
      EXPECT_TRUE(field.robots.contains(id)) << to_string(id);
      if (field.robots.contains(id)) worst = std::max(worst, position_error(field, id, field.t));
    }
  });
  EXPECT_LT(worst, 0.03);
}

TEST(Tracker, is_not_fooled_by_a_pattern_misread_as_another_robots) {
  SyntheticField field;
  line_up(field);
  field.run(1);
  // For a second yellow 3 is read as blue 9, which itself is seen; and then as yellow 15, which is not on the field,
  // in turn with its right name.
  int beat = 0;
  field.spoil = [&](ssl::Detection& seen, double t) {
    ++beat;
    for (auto& robot : seen.robots) {
      if (robot.id != yellow(3)) continue;
      if (t < 2) {
        robot.id = blue(9);
      } else if (beat % 2 == 0) {
        robot.id = yellow(15);
      }
    }
  };
  double worst = 0;
  field.run(3, [&] {
    worst = std::max(worst, position_error(field, blue(9), field.t));
    EXPECT_FALSE(field.now(yellow(15)));
  });
  EXPECT_LT(worst, 0.02);
}

TEST(Tracker, keeps_two_robots_apart_that_swap_names_while_they_touch) {
  SyntheticField field;
  field.robots[yellow(1)] = [](double t) { return Pose2d{.x = 0.5 * std::sin(t), .y = 0, .heading = 0}; };
  field.robots[yellow(2)] = [](double t) { return Pose2d{.x = 0.5 * std::sin(t), .y = 0.19, .heading = 1}; };
  field.run(1);
  field.spoil = [](ssl::Detection& seen, double t) {
    if (std::fmod(t, 0.5) > 0.08) return;  // six frames in a row
    for (auto& robot : seen.robots) robot.id.number = robot.id.number == 1 ? 2 : 1;
  };
  double worst = 0;
  field.run(5, [&] {
    for (const auto& [id, truth] : field.robots) worst = std::max(worst, position_error(field, id, field.t));
  });
  EXPECT_LT(worst, 0.05);
}

TEST(Tracker, counts_duplicates_and_does_not_believe_them_twice) {
  SyntheticField field{.noise_m = 0};
  line_up(field);
  field.run(1);
  const ssl::Detection again{.camera = 0,
                             .frame_number = field.frame,
                             .t_capture_s = field.t,
                             .t_sent_s = field.t + field.processing_s,
                             .robots = {{.id = yellow(0), .x_m = 3, .y_m = 3, .heading_rad = 0}}};
  for (int i = 0; i < 10; ++i)
    EXPECT_EQ(field.tracker.take(again, 1, SyntheticField::at(field.t + 0.01)), Verdict::duplicate);
  EXPECT_LT(position_error(field, yellow(0), field.t), 0.001);
  EXPECT_EQ(field.tracker.cameras(SyntheticField::at(field.t)).at(0).duplicates, 10U);
}

TEST(Tracker, believes_one_of_two_computers_that_send_the_same_camera) {
  SyntheticField field;
  line_up(field);
  field.run(1);
  const ssl::Detection other{.camera = 0, .frame_number = 1, .t_capture_s = 7, .t_sent_s = 7};
  EXPECT_EQ(field.tracker.take(other, 2, SyntheticField::at(field.t + 0.01)), Verdict::foreign);
  EXPECT_EQ(field.tracker.take(other, 2, SyntheticField::at(field.t + 0.5)), Verdict::taken) << "the first is silent";
}

TEST(Tracker, needs_no_clock_but_its_own) {
  struct Case {
    const char* name;
    double offset_s, rate;
  };
  for (const auto& [name, offset, rate] :
       {Case{"grSim", 0, 0.98}, Case{"fast", 100, 1.02}, Case{"Unix", 1.8e9, 1}, Case{"behind", -1e6, 1}}) {
    SyntheticField field{.missing = 0, .clock_offset_s = offset, .clock_rate = rate, .jitter_s = 0.001};
    field.robots[blue(3)] = [](double t) { return Pose2d{.x = 2 * std::sin(t), .y = 0, .heading = 0}; };
    field.run(2);
    double worst_s = 0;
    field.run(5, [&] {
      const auto robot = field.tracker.robot(blue(3));
      ASSERT_TRUE(robot);
      worst_s = std::max(worst_s, std::abs(seconds(robot->time - SyntheticField::at(field.t))));
    });
    std::printf("%-8s capture time off by up to %.2f ms\n", name, 1e3 * worst_s);
    EXPECT_LT(worst_s, 0.004) << name;
  }
}

TEST(Tracker, goes_on_when_the_vision_computer_sets_its_clock) {
  SyntheticField field;
  line_up(field);
  for (const double offset : {3600.0, -3600.0}) {
    field.run(1);
    field.clock_offset_s += offset;
    field.run(0.2);
    const auto robot = field.tracker.robot(blue(3));
    ASSERT_TRUE(robot);
    EXPECT_LT(seconds(SyntheticField::at(field.t) - robot->time), 0.03);
  }
}

TEST(Tracker, predicts_over_a_gap_and_forgets_after_a_second) {
  SyntheticField field;
  field.robots[blue(3)] = [](double t) { return Pose2d{.x = 1.5 * t, .y = 0, .heading = 0}; };
  field.run(1);
  field.missing = 1;
  field.run(0.2);
  EXPECT_LT(position_error(field, blue(3), field.t), 0.05);
  field.run(1);
  EXPECT_FALSE(field.now(blue(3)));
}

TEST(Tracker, believes_nothing_outside_of_the_field) {
  SyntheticField field;
  field.tracker.take(ssl::Geometry{.length_m = 9, .width_m = 6, .boundary_m = 0.3, .cameras = {}, .rolling_mps2 = {}});
  field.robots[blue(3)] = standing({.x = 5.5, .y = 0, .heading = 0});
  field.robots[blue(4)] = standing({.x = 5.2, .y = 0, .heading = 0});
  field.run(1);
  EXPECT_FALSE(field.now(blue(3)));
  EXPECT_TRUE(field.now(blue(4)));
}

TEST(Tracker, follows_a_ball_that_rests_is_kicked_and_rolls_out) {
  SyntheticField field;
  const auto truth = [](double t) {
    const double rolled = std::clamp(t - 3, 0.0, 3.0 / 0.35);
    return 3 * rolled - 0.175 * rolled * rolled;  // 3 m/s, loses 0.35 m/s²
  };
  std::mt19937_64 random{3};
  std::normal_distribution<double> noise{0, 0.0014};
  std::bernoulli_distribution is_missing{0.05};
  field.spoil = [&](ssl::Detection& seen, double t) {
    if (!is_missing(random)) seen.balls.push_back({.x_m = truth(t) - 3 + noise(random), .y_m = noise(random)});
    seen.balls.push_back({.x_m = 2 * std::sin(100 * t), .y_m = 1.7});  // reflections
  };
  field.run(2.9);
  auto ball = field.tracker.predict_ball(SyntheticField::at(field.t));
  ASSERT_TRUE(ball);
  EXPECT_NEAR(ball->position.x, -3, 0.001);
  field.run(0.25);
  double worst = 0;
  field.run(2, [&] {
    ball = field.tracker.predict_ball(SyntheticField::at(field.t));
    ASSERT_TRUE(ball);
    worst = std::max(worst, std::hypot(ball->position.x - truth(field.t) + 3, ball->position.y));
  });
  std::printf("rolling ball: worst %.1f mm\n", 1e3 * worst);
  EXPECT_LT(worst, 0.015);
  EXPECT_NEAR(ball->vx, 3 - 0.35 * (field.t - 3), 0.15);
}

TEST(Tracker, does_not_allocate) {
  SyntheticField field;
  line_up(field);
  field.run(1);
  ssl::Detection seen{.camera = 0};
  for (const auto& [id, truth] : field.robots)
    seen.robots.push_back({.id = id, .x_m = truth(0).x, .y_m = truth(0).y, .heading_rad = truth(0).heading});
  const std::size_t before = allocations().count;
  for (int i = 0; i < 100; ++i) {
    ++seen.frame_number;
    seen.t_capture_s = seen.t_sent_s = field.t + 0.01 * i;
    (void)field.tracker.take(seen, 1, SyntheticField::at(field.t + 0.01 + 0.01 * i));
  }
  EXPECT_EQ(allocations().count, before);
}

TEST(Tracker, loses_no_frame_when_the_delay_changes) {
  SyntheticField field;
  field.cameras = {{}, {.offset_x = 0.004}, {.offset_y = 0.004}};
  field.missing = 0;
  field.robots[yellow(1)] = [](double t) {
    return Pose2d{.x = std::cos(2 * t), .y = std::sin(2 * t), .heading = wrap_angle(2 * t)};
  };
  field.run(2);
  double worst_m = 0;
  for (const Duration delay : {150ms, 0ms, 20ms}) {
    field.tracker.set_delay(delay);
    Time before = field.tracker.captured();
    Duration age_before = field.tracker.delay();
    field.run(4, [&] {
      EXPECT_GT(field.tracker.captured(), before - 1ms);  // of another camera: as the network's delays differ
      before = field.tracker.captured();
      EXPECT_LT(std::abs(seconds(field.tracker.delay() - age_before)), 0.001);
      age_before = field.tracker.delay();
      ASSERT_EQ(field.tracker.corrected().size(), 1U);
      worst_m = std::max(worst_m, distance(field.tracker.robot(yellow(1))->pose, field.robots[yellow(1)](field.t)));
    });
    EXPECT_EQ(field.tracker.delay(), delay);
  }
  for (const CameraReport& camera : field.tracker.cameras(SyntheticField::at(field.t))) EXPECT_EQ(camera.late, 0U);
  std::printf("while the delay changes, off by %.1f mm at worst\n", 1e3 * worst_m);
  EXPECT_LT(worst_m, 0.02);
}

}  // namespace
}  // namespace regista::vision
