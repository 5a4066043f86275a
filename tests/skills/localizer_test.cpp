// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <numbers>

#include "plant.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;

/// A base in a field with a localizer on it.
struct Robot {
  explicit Robot(const std::string& localizer = localizer_section, Pose2d start = {.x = 3, .y = -2, .heading = 1},
                 double fix_sd_m = 0.1)
      : field{.fix_sd_m = fix_sd_m, .truth = start}, rig{plant_section + localizer, drivers_in(field)} {}

  void drive(const BodyVelocity& velocity, Duration duration) {
    for (const Time end = rig.now() + duration; rig.now() < end;) {
      rig.send(position2d::VelocityCommand{.velocity = velocity});
      rig.run(100ms);
    }
  }
  [[nodiscard]] bool silent() {
    rig.forget();
    rig.run(200ms);
    return rig.latest<position2d::State>(1) == nullptr && rig.latest<localize::State>(1) == nullptr;
  }
  [[nodiscard]] double off_m() const { return distance(rig.latest<position2d::State>(1)->pose, field.truth); }
  std::string property(std::string_view key) { return rig.text(Position2d::code, 1, key); }

  World field;
  testing::Rig rig;
};

TEST(Localizer, knows_where_it_is_and_how_well) {
  Robot robot;
  robot.drive({.x = 0.8, .w = 0.3}, 30s);
  const auto pose = *robot.rig.latest<position2d::State>(1);
  EXPECT_LT(robot.off_m(), 0.1);
  EXPECT_NEAR(angle_between(pose.pose.heading, robot.field.truth.heading), 0, 0.02);
  EXPECT_NEAR(pose.velocity.x, 0.8, 0.03);
  EXPECT_NEAR(pose.velocity.w, 0.3, 0.03);
  const auto hypothesis = robot.rig.latest<localize::State>(1)->hypotheses.at(0);
  EXPECT_EQ(hypothesis.mean, pose.pose);
  EXPECT_EQ(hypothesis.weight, 1);
  const auto [xx, yy, aa, xy, ya, xa] = hypothesis.covariance;
  for (const double variance : {xx, yy}) EXPECT_NEAR(std::sqrt(variance), 0.03, 0.03);
  EXPECT_LT(std::sqrt(aa), 0.02);
  EXPECT_LT(std::abs(xy), std::sqrt(xx * yy));
  EXPECT_LT(std::abs(ya), std::sqrt(yy * aa));
  EXPECT_LT(std::abs(xa), std::sqrt(xx * aa));
  EXPECT_EQ(robot.property("status"), "tracking");
}

TEST(Localizer, errs_as_much_as_its_covariance_says) {
  Robot robot;
  double sum = 0;
  int count = 0;
  for (int i = 0; i < 60; ++i) {
    robot.drive({.x = 0.8, .w = i % 2 == 0 ? 0.5 : -0.5}, 2s);
    const auto& hypothesis = robot.rig.latest<localize::State>(1)->hypotheses.at(0);
    const double dx = hypothesis.mean.x - robot.field.truth.x;
    const double dy = hypothesis.mean.y - robot.field.truth.y;
    const auto& c = hypothesis.covariance;
    sum += (c[1] * dx * dx - 2 * c[3] * dx * dy + c[0] * dy * dy) / (c[0] * c[1] - c[3] * c[3]);
    ++count;
  }
  // Mean of chi-square with two degrees of freedom: 2. It may be cautious, never bold.
  EXPECT_LT(sum / count, 3);
  EXPECT_GT(sum / count, 0.2);
}

TEST(Localizer, finds_the_heading_from_the_way_where_no_sensor_gives_it) {
  Robot robot{
      R"(driver ( name "localizer" provides ["position2d:1" "localize:1"] requires ["position2d:0" "localize:0"] ) )"};
  robot.drive({.x = 1}, 3s);
  EXPECT_TRUE(robot.silent());
  EXPECT_NE(robot.property("explain").find("waiting for a heading"), std::string::npos) << robot.property("explain");
  robot.drive({.x = 1}, 20s);
  EXPECT_LT(robot.off_m(), 0.2);
  EXPECT_NEAR(robot.rig.latest<position2d::State>(1)->pose.heading, 1, 0.05);
}

TEST(Localizer, is_no_base_and_keeps_no_wheels_alive) {
  Robot robot;
  robot.drive({.x = 0.8}, 5s);
  robot.rig.run(2s);  // nobody commands, while it goes on to measure
  EXPECT_EQ(robot.field.commanded, BodyVelocity{});
  EXPECT_FALSE(robot.silent());
  (void)robot.rig.events();
  robot.rig.send(position2d::VelocityCommand{.velocity = {.x = 1}}, 1);
  EXPECT_NE(robot.rig.events().find("position2d:1 refused"), std::string::npos);
  EXPECT_EQ(robot.field.commanded, BodyVelocity{});
}

TEST(Localizer, takes_late_fixes_for_what_they_were) {
  Robot robot;
  robot.field.gps_late = 400ms;
  robot.drive({.x = 0.8}, 30s);
  EXPECT_LT(robot.off_m(), 0.1);  // taken for news they would drag it 0.3 m behind
}

TEST(Localizer, falls_silent_without_wheels_and_comes_back) {
  Robot robot;
  robot.drive({.x = 0.8}, 5s);
  robot.field.wheels = false;
  robot.drive({.x = 0.8}, 1s);
  EXPECT_TRUE(robot.silent());
  EXPECT_EQ(robot.property("status"), "no wheels");
  EXPECT_NE(robot.rig.events().find("the pose is now: no wheels"), std::string::npos);
  EXPECT_NE(robot.property("explain").find("base: connected, spoke 1."), std::string::npos);
  robot.field.wheels = true;
  robot.drive({.x = 0.8}, 10s);
  EXPECT_LT(robot.off_m(), 0.15);
}

TEST(Localizer, reckons_through_a_loss_of_gps_and_is_lost_when_it_lasts) {
  Robot robot{R"(driver ( name "localizer" provides ["position2d:1" "localize:1"]
                 requires ["position2d:0" "imu:0" "localize:0"] imu_heading yes heading_sd 2 lost 1
                 slip_density 0.01 ) )"};
  robot.drive({.x = 0.8}, 5s);
  robot.field.gps = false;
  robot.drive({.x = 0.8}, 10s);
  EXPECT_LT(robot.off_m(), 0.5);
  robot.drive({.x = 0.8}, 60s);
  EXPECT_TRUE(robot.silent());
  EXPECT_EQ(robot.property("status"), "lost");
  robot.field.gps = true;
  robot.drive({.x = 0.8}, 5s);
  EXPECT_LT(robot.off_m(), 0.2);
}

TEST(Localizer, refuses_fixes_that_jump_until_they_persist) {
  Robot robot;
  robot.drive({.x = 0.8}, 10s);
  robot.field.gps_jump_m = 5;
  robot.drive({.x = 0.8}, 1s);  // five fixes
  EXPECT_LT(robot.off_m(), 0.2);
  EXPECT_NE(robot.property("explain").find("refused: outlier"), std::string::npos) << robot.property("explain");
  robot.drive({.x = 0.8}, 3s);
  EXPECT_GT(robot.off_m(), 4);
  EXPECT_NE(robot.rig.events().find("it starts anew"), std::string::npos);
}

TEST(Localizer, refuses_numbers_that_are_none) {
  Robot robot;
  robot.drive({.x = 0.8}, 5s);
  robot.field.gyro_radps = std::nan("");
  robot.field.wheels_mps = std::nan("");
  robot.drive({.x = 0.8}, 600ms);
  EXPECT_NE(robot.property("explain").find("refused: invalid"), std::string::npos);
  robot.field.gyro_radps = robot.field.wheels_mps = 0;
  robot.drive({.x = 0.8}, 5s);
  EXPECT_LT(robot.off_m(), 0.2);
}

TEST(Localizer, believes_a_fix_as_far_as_its_covariance_goes) {
  Robot sure;
  sure.drive({.x = 0.8}, 5s);
  EXPECT_LT(std::sqrt(sure.rig.latest<localize::State>(1)->hypotheses[0].covariance[0]), 0.05);
  Robot unsure{localizer_section, {}, 3};
  unsure.drive({.x = 0.8}, 5s);
  EXPECT_NEAR(std::sqrt(unsure.rig.latest<localize::State>(1)->hypotheses[0].covariance[0]), 3 / std::sqrt(26), 0.05);
  Robot broken{localizer_section, {}, std::nan("")};
  broken.drive({.x = 0.8}, 5s);
  EXPECT_TRUE(broken.silent());
  EXPECT_NE(broken.property("explain").find("position: 0 taken"), std::string::npos) << broken.property("explain");
}

TEST(Localizer, is_put_where_somebody_says) {
  Robot robot{R"(driver ( name "localizer" provides ["position2d:1" "localize:1"] requires ["position2d:0"] ) )", {}};
  robot.rig.run(1s);
  EXPECT_TRUE(robot.silent());
  ASSERT_TRUE(robot.rig.ask(
      localize::SetPose{.mean = {.x = 10, .heading = std::numbers::pi / 2}, .covariance = {0.01, 0.01, 0.001, 0, 0, 0}},
      1));
  robot.drive({.x = 1}, 2s);
  const Pose2d pose = robot.rig.latest<position2d::State>(1)->pose;
  EXPECT_NEAR(pose.x, 10, 0.05);
  EXPECT_NEAR(pose.y, robot.field.truth.x, 0.1);
  EXPECT_FALSE(robot.rig.ask(localize::SetPose{.covariance = {-1, 0, 0, 0, 0, 0}}, 1));
  EXPECT_FALSE(robot.rig.ask(localize::SetPose{.mean = {.x = std::nan("")}}, 1));
  ASSERT_TRUE(robot.rig.ask(position2d::SetOdometry{.pose = {.x = -7}}, 1));
  robot.rig.run(100ms);
  EXPECT_NEAR(robot.rig.latest<position2d::State>(1)->pose.x, -7, 0.1);
}

TEST(Localizer, says_what_is_wrong_with_its_configuration) {
  for (const auto& [keys, complaint] :
       std::map<std::string, std::string>{{"compass [1 2]", "'compass' must be five angles"},
                                          {"start [1 2]", "'start' must be x, y and a heading"},
                                          {"fix_sd 0", "'fix_sd' is 0"},
                                          {"fixsd 1", "unknown key 'fixsd'"}}) {
    try {
      const Robot robot{R"(driver ( name "localizer" provides ["position2d:1"] requires ["position2d:0"] )" + keys +
                        ")"};
      ADD_FAILURE() << keys;
    } catch (const ConfigError& error) {
      EXPECT_NE(std::string{error.what()}.find(complaint), std::string::npos) << error.what();
    }
  }
}

}  // namespace
}  // namespace regista
