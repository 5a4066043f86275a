// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include "counting_new.hpp"

#include "rendered_field.hpp"

namespace regista::camera {
namespace {

using rendered::Ball;
using rendered::Look;
using rendered::Robot;

/// How well robots were seen.
struct Score {
  int seen = 0;
  int missed = 0;
  int ghosts = 0;  ///< that are nowhere, or twice, or have another's id
  double worst_mm = 0;
  double worst_mrad = 0;
  double squares_mm2 = 0;
  double squares_mrad2 = 0;

  [[nodiscard]] double rms_mm() const { return std::sqrt(squares_mm2 / std::max(seen, 1)); }
  [[nodiscard]] double rms_mrad() const { return std::sqrt(squares_mrad2 / std::max(seen, 1)); }

  void add(const std::vector<Robot>& truth, const std::vector<ssl::DetectedRobot>& found) {
    ghosts += static_cast<int>(found.size());
    for (const Robot& robot : truth) {
      const auto same = std::ranges::find(found, robot.id, &ssl::DetectedRobot::id);
      const double far_mm =
          same == found.end() ? 1e9 : 1000 * std::hypot(same->x_m - robot.pose.x, same->y_m - robot.pose.y);
      if (far_mm > 50) {
        ++missed;
        continue;
      }
      ++seen;
      --ghosts;
      const double turn_mrad = 1000 * std::abs(wrap_angle(*same->heading_rad - robot.pose.heading));
      worst_mm = std::max(worst_mm, far_mm);
      worst_mrad = std::max(worst_mrad, turn_mrad);
      squares_mm2 += far_mm * far_mm;
      squares_mrad2 += turn_mrad * turn_mrad;
    }
  }
};

std::ostream& operator<<(std::ostream& out, const Score& score) {
  return out << score.seen << " seen, " << score.missed << " missed, " << score.ghosts << " ghosts; rms "
             << score.rms_mm() << " mm, " << score.rms_mrad() << " mrad; at worst " << score.worst_mm << " mm, "
             << score.worst_mrad << " mrad";
}

rendered::Camera overhead() { return rendered::Camera::above(0.1, 0.05, 4); }

/// All 32 robots on a grid, each turned differently.
std::vector<Robot> everybody(unsigned seed) {
  std::mt19937 random{seed};
  std::uniform_real_distribution<double> shift{-0.12, 0.12};
  std::uniform_real_distribution<double> turn{-rendered::pi, rendered::pi};
  std::vector<Robot> robots;
  for (int i = 0; i < 32; ++i) {
    robots.push_back(
        {.id = {i < 16 ? ssl::Team::yellow : ssl::Team::blue, static_cast<std::uint8_t>(i % 16)},
         .pose = {-2.1 + 0.6 * (i % 8) + shift(random), -1.3 + 0.85 * (i / 8) + shift(random), turn(random)}});
  }
  return robots;
}

ssl::Detection detect(const cv::Mat& picture, const DetectorOptions& options = {}) {
  Detector detector{overhead().calibration(), options};
  ssl::Detection out;
  const Result<> result = detector.detect(rendered::view(picture), out);
  EXPECT_TRUE(result) << result.error().message();
  return out;
}

TEST(Detector, knows_all_sixteen_robots_of_both_teams_and_where_they_are) {
  Score score;
  for (unsigned seed = 0; seed < 4; ++seed) {
    const auto robots = everybody(seed);
    score.add(robots, detect(render(overhead(), robots, {})).robots);
  }
  EXPECT_EQ(score.missed, 0) << score;
  EXPECT_EQ(score.ghosts, 0) << score;
  EXPECT_LT(score.rms_mm(), 0.3) << score;
  EXPECT_LT(score.rms_mrad(), 4) << score;
  EXPECT_LT(score.worst_mm, 1.0) << score;
  EXPECT_LT(score.worst_mrad, 12) << score;
  std::cout << score << '\n';
}

TEST(Detector, works_in_uneven_light_with_noise) {
  Score score;
  for (unsigned seed = 0; seed < 4; ++seed) {
    const auto robots = everybody(seed);
    const Look look{.gradient = 0.4, .cast = {0.9, 1, 1.05}, .noise = 5, .seed = seed + 1};
    score.add(robots, detect(render(overhead(), robots, {}, look)).robots);
  }
  EXPECT_EQ(score.missed, 0) << score;
  EXPECT_EQ(score.ghosts, 0) << score;
  EXPECT_LT(score.rms_mm(), 1.0) << score;
  EXPECT_LT(score.rms_mrad(), 10) << score;
  std::cout << score << '\n';
}

TEST(Detector, follows_robots_at_three_metres_a_second) {
  Score score;
  for (unsigned seed = 0; seed < 2; ++seed) {
    auto robots = everybody(seed);
    for (std::size_t i = 0; i < robots.size(); ++i)
      robots[i].velocity = {.x = 3 * std::cos(1.0 * static_cast<double>(i)),
                            .y = 3 * std::sin(1.0 * static_cast<double>(i)),
                            .w = i % 2 ? 8.0 : -8.0};
    const Look look{.gradient = 0.2, .noise = 3, .exposure_s = 0.005, .seed = seed + 1};
    score.add(robots, detect(render(overhead(), robots, {}, look)).robots);
  }
  EXPECT_EQ(score.missed, 0) << score;
  EXPECT_EQ(score.ghosts, 0) << score;
  EXPECT_LT(score.worst_mm, 3.0) << score;
  EXPECT_LT(score.worst_mrad, 40) << score;
  std::cout << score << '\n';
}

TEST(Detector, sees_nothing_on_an_empty_field) {
  for (unsigned seed = 0; seed < 3; ++seed) {
    const ssl::Detection found = detect(render(overhead(), {}, {}, {.gradient = 0.5, .noise = 6, .seed = seed + 1}));
    EXPECT_TRUE(found.robots.empty());
    EXPECT_TRUE(found.balls.empty());
  }
}

TEST(Detector, takes_no_confetti_for_robots) {
  std::mt19937 random{11};
  std::uniform_real_distribution<double> x{-2.5, 2.5};
  std::uniform_real_distribution<double> y{-1.8, 1.8};
  for (int round = 0; round < 3; ++round) {
    rendered::Canvas canvas{overhead()};
    rendered::draw_field(canvas);
    const std::array<cv::Scalar, 4> inks{rendered::yellow, rendered::blue, rendered::green, rendered::magenta};
    for (std::size_t i = 0; i < 400; ++i) canvas.disc({x(random), y(random), 0.15}, 0.022, inks[i % 4]);
    EXPECT_TRUE(detect(rendered::finish(canvas.coarse(), {.noise = 4})).robots.empty());
  }
}

TEST(Detector, sees_a_robot_once_whose_middle_is_broken_by_glare) {
  const Robot robot{.id = {ssl::Team::blue, 5}, .pose = {0.4, 0.3, 0.3}};
  cv::Mat picture = render(overhead(), {robot}, {});
  const cv::Point2d middle = overhead().see({0.4, 0.3, 0.15});
  cv::line(picture, middle - cv::Point2d{0, 4}, middle + cv::Point2d{0, 4}, {250, 250, 250}, 1);
  EXPECT_EQ(detect(picture).robots.size(), 1U);
}

TEST(Detector, sees_the_ball_at_rest_and_kicked) {
  const std::vector<Ball> balls{{1.5, 0.8}, {-1.7, -1.0}, {0.6, -0.7, {.x = 4, .y = -4}}};
  const ssl::Detection found =
      detect(render(overhead(), everybody(1), balls, {.gradient = 0.3, .noise = 4, .exposure_s = 0.005}));
  for (const Ball& ball : balls) {
    const auto near = std::ranges::find_if(found.balls, [&](const ssl::DetectedBall& seen) {
      return std::hypot(seen.x_m - ball.x, seen.y_m - ball.y) < 0.003;
    });
    EXPECT_NE(near, found.balls.end()) << ball.x << ' ' << ball.y;
  }
  EXPECT_EQ(found.balls.size(), balls.size());
}

TEST(Detector, takes_the_height_of_the_patterns_into_account) {
  const std::vector<Robot> robots{{.id = {ssl::Team::blue, 4}, .pose = {2, 1.3, 1}}};
  const cv::Mat picture = render(overhead(), robots, {}, {}, 0.12);
  const auto at = [&](double height) {
    const auto found = detect(picture, {.blue_height_m = height}).robots;
    return found.size() == 1 ? std::hypot(found[0].x_m - 2, found[0].y_m - 1.3) : 1e9;
  };
  EXPECT_LT(at(0.12), 0.001);
  EXPECT_NEAR(at(0.15), 0.03 * std::hypot(1.9, 1.25) / 3.88, 0.003);
}

TEST(Detector, takes_teams_of_different_heights) {
  const std::vector<Robot> high{{.id = {ssl::Team::yellow, 9}, .pose = {-1.8, 1, 1}}};
  cv::Mat picture = render(overhead(), high, {}, {}, 0.15);
  const cv::Mat low = render(overhead(), {{.id = {ssl::Team::blue, 6}, .pose = {1.8, -1, 2}}}, {}, {}, 0.1);
  const cv::Rect right_half{picture.cols / 2, 0, picture.cols - picture.cols / 2, picture.rows};
  low(right_half).copyTo(picture(right_half));
  const auto found = detect(picture, {.yellow_height_m = 0.15, .blue_height_m = 0.1}).robots;
  ASSERT_EQ(found.size(), 2U);
  for (const ssl::DetectedRobot& robot : found)
    EXPECT_LT(std::hypot(std::abs(robot.x_m) - 1.8, std::abs(robot.y_m) - 1), 0.001) << to_string(robot.id);
}

TEST(Detector, refuses_a_picture_of_another_size) {
  Detector detector{overhead().calibration(), {}};
  ssl::Detection out;
  const cv::Mat small{100, 100, CV_8UC3, cv::Scalar{}};
  EXPECT_EQ(detector.detect(rendered::view(small), out).error().code, std::errc::invalid_argument);
}

TEST(Detector, does_not_allocate_from_the_second_picture_on) {
  const cv::Mat picture = render(overhead(), everybody(1), {{0.5, 0.5}}, {.noise = 5});
  Detector detector{overhead().calibration(), {}};
  ssl::Detection out;
  ASSERT_TRUE(detector.detect(rendered::view(picture), out));
  const auto before = allocations().count;
  ASSERT_TRUE(detector.detect(rendered::view(picture), out));
  EXPECT_EQ(allocations().count, before);
}

}  // namespace
}  // namespace regista::camera
