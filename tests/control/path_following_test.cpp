// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/control/path_following.hpp>

#include <random>
#include <stdexcept>

namespace regista::control {
namespace {

constexpr double pi = std::numbers::pi;
constexpr PathFollowingConfig config{.k1 = 4, .k2 = 4, .turn_rate_limit_radps = 3};
constexpr PathFollowingConfig unlimited{.k1 = 4, .k2 = 4, .turn_rate_limit_radps = 1e6};

Pose2d driven(const Pose2d& pose, const BodyVelocity& command, double dt_s) {
  const double half_turn = 0.5 * command.w * dt_s;
  return {.x = pose.x + command.x * dt_s * std::cos(pose.heading + half_turn),
          .y = pose.y + command.x * dt_s * std::sin(pose.heading + half_turn),
          .heading = wrap_angle(pose.heading + 2 * half_turn)};
}

Path path(std::vector<PathSegment> segments, const Pose2d& start = {}) { return {start, segments}; }

TEST(Path, measures_from_a_line) {
  std::size_t segment = 0;
  const auto place = path({{.length_m = 5}}, {.x = 1, .y = 1, .heading = pi / 2}).place({.x = 0.5, .y = 3}, segment);
  EXPECT_NEAR(place.offset_m, 0.5, 1e-12);
  EXPECT_NEAR(place.to_go_m, 3, 1e-12);
  EXPECT_NEAR(place.pose.x, 1, 1e-12);
  EXPECT_NEAR(place.pose.y, 3, 1e-12);
}

TEST(Path, measures_from_arcs_to_either_side) {
  for (const double side : {1.0, -1.0}) {
    std::size_t segment = 0;
    // A quarter circle around (0, 2 side), seen from a robot half a metre inside its middle.
    const double inside = 1.5 * std::sqrt(0.5);
    const auto place =
        path({{.length_m = pi, .curvature_radpm = 0.5 * side}}).place({.x = inside, .y = side * (2 - inside)}, segment);
    EXPECT_NEAR(place.offset_m, 0.5 * side, 1e-12);
    EXPECT_NEAR(place.to_go_m, pi / 2, 1e-12);
    EXPECT_NEAR(place.pose.heading, side * pi / 4, 1e-12);
  }
}

TEST(Path, goes_on_from_segment_to_segment_only_forward) {
  const Path cross = path({{.length_m = 4}, {.length_m = 1.5 * pi * 2, .curvature_radpm = 0.5}, {.length_m = 4}});
  std::size_t segment = 0;
  EXPECT_NEAR(cross.place({.x = 2}, segment).to_go_m, 2 + 3 * pi + 4, 1e-12);
  EXPECT_EQ(segment, 0U);
  (void)cross.place({.x = 4.1, .y = 0.01}, segment);
  EXPECT_EQ(segment, 1U);
  (void)cross.place({.x = 1.9, .y = 2.1}, segment);
  EXPECT_EQ(segment, 1U);
  EXPECT_NEAR(cross.place({.x = 2, .y = 1}, segment).to_go_m, 3, 1e-12);
  EXPECT_EQ(segment, 2U);
}

TEST(PathFollowing, turns_back_to_the_path) {
  PathFollowing left{config, path({{.length_m = 10}})};
  EXPECT_LT(left.step({.x = 1, .y = 0.5}, 1).command.w, 0);
  EXPECT_GT(left.step({.x = 1, .y = -0.5}, 1).command.w, 0);
  EXPECT_LT(left.step({.x = 1, .heading = 0.3}, 1).command.w, 0);
}

TEST(PathFollowing, on_the_path_follows_its_curve) {
  PathFollowing following{config, path({{.length_m = 3, .curvature_radpm = -0.5}})};
  EXPECT_NEAR(following.step({}, 0.8).command.w, -0.4, 1e-12);
}

// V = (k1 e² + ψ²) / 2, V' = -k2 |v| ψ², against the difference quotient along the motion of the base.
TEST(PathFollowing, makes_the_lyapunov_function_fall_as_derived) {
  std::mt19937 random{1};
  std::uniform_real_distribution<double> unit{-1, 1};
  for (int i = 0; i < 20'000; ++i) {
    const double curvature = i % 4 == 0 ? 0 : unit(random);
    const Path curve = path({{.length_m = 3, .curvature_radpm = curvature}});
    const Pose2d pose{.x = 1 + 0.3 * unit(random), .y = 0.6 * unit(random), .heading = 3 * unit(random)};
    const double speed = 0.2 + std::abs(unit(random));
    const auto at = [&](const Pose2d& there) { return PathFollowing{unlimited, curve}.step(there, speed); };
    const auto value = [](const PathFollowing::Output& output) {
      return 0.5 * (unlimited.k1 * output.offset_m * output.offset_m + output.heading_rad * output.heading_rad);
    };
    const auto here = at(pose);
    ASSERT_FALSE(here.refused);
    if (std::abs(here.heading_rad) > 3.1) continue;
    constexpr double h = 1e-6;
    const double rate =
        (value(at(driven(pose, here.command, h))) - value(at(driven(pose, here.command, -h)))) / (2 * h);
    ASSERT_NEAR(rate, -unlimited.k2 * speed * here.heading_rad * here.heading_rad, 1e-5);
  }
}

TEST(PathFollowing, takes_a_robot_beside_the_path_onto_it_and_to_its_end) {
  for (const double offset : {-0.8, 0.8}) {
    PathFollowing following{config, path({{.length_m = 4},
                                          {.length_m = pi, .curvature_radpm = 0.5},
                                          {.length_m = pi, .curvature_radpm = -0.5},
                                          {.length_m = 2}})};
    Pose2d pose{.y = offset, .heading = 1};
    auto output = following.step(pose, 0.5);
    for (int i = 0; i < 3000 && !output.finished; ++i) {
      pose = driven(pose, output.command, 0.01);
      output = following.step(pose, 0.5);
      ASSERT_LE(std::abs(output.command.w), config.turn_rate_limit_radps + 1e-12);
      if (output.to_go_m < 8) {
        ASSERT_LT(std::abs(output.offset_m), 0.01);
      }
    }
    EXPECT_TRUE(output.finished);
    EXPECT_EQ(output.command, BodyVelocity{});
    EXPECT_NEAR(pose.x, 4 + 2 + 2 + 2, 0.02);
    EXPECT_NEAR(pose.y, 2 + 2, 0.02);
  }
}

TEST(PathFollowing, stands_when_it_is_told_no_numbers_or_is_at_the_centre_of_the_curve) {
  PathFollowing following{config, path({{.length_m = 3, .curvature_radpm = 1}})};
  EXPECT_TRUE(following.step({.x = std::nan("")}, 1).refused);
  EXPECT_EQ(following.step({}, INFINITY).command, BodyVelocity{});
  EXPECT_TRUE(following.step({.y = 1}, 1).refused);
  EXPECT_EQ(following.refused(), 3U);
}

TEST(PathFollowing, names_the_value_that_it_refuses) {
  EXPECT_THROW(path({}), std::invalid_argument);
  EXPECT_THROW(path({{.length_m = 0}}), std::invalid_argument);
  EXPECT_THROW(path({{.length_m = 7, .curvature_radpm = 1}}), std::invalid_argument);
  EXPECT_THROW(PathFollowing({.k1 = 1, .k2 = 0, .turn_rate_limit_radps = 1}, path({{.length_m = 1}})),
               std::invalid_argument);
}

}  // namespace
}  // namespace regista::control
