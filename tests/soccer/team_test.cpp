// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <regista/client/robot.hpp>
#include <regista/device/plugin.hpp>
#include <regista/soccer/team.hpp>
#include <regista/testing/test_server.hpp>
#include <string>

#include "simulated_base.hpp"
#include "simulated_kicker.hpp"

namespace regista::soccer {
namespace {

using namespace std::chrono_literals;

const Plugin simulated_base{
    .name = "simulated_base", .summary = "", .rate_hz = 100, .create = [](Setup& setup) -> std::unique_ptr<Driver> {
      return std::make_unique<SimulatedBase>(setup);
    }};
const Plugin simulated_kicker{
    .name = "simulated_kicker", .summary = "", .rate_hz = 100, .create = [](Setup& setup) -> std::unique_ptr<Driver> {
      return std::make_unique<SimulatedKicker>(setup);
    }};

/// Robot 3 of the yellow team: its server, and a tracker that shows it where it is, on lo.
class SoccerTeam : public ::testing::Test {
 protected:
  SoccerTeam()
      : server_{
            "driver ( name \"simulated_base\" provides [\"position2d:0\"] lease 0.3 )"
            "driver ( name \"simulated_kicker\" provides [\"kicker:0\"] lease 0.3 )",
            {&simulated_base, &simulated_kicker}},
        folder_{std::filesystem::temp_directory_path() / ("team_test." + std::to_string(::getpid()))},
        // Of this process, so that tests that run beside it are not heard.
        group_{.address = "224.5.23.2", .port = static_cast<std::uint16_t>(20'000 + ::getpid() % 10'000)},
        tracker_{group_, "lo"} {
    std::filesystem::create_directories(folder_);
    std::ofstream{folder_ / "team.cfg"} << "vision ( publish [\"lo\"] tracked_port " << group_.port << " )\n"
                                        << "robot ( team \"yellow\" id 3 host \"127.0.0.1\" port " << server_.port()
                                        << " )\n";
    team_ = std::make_unique<Team>(folder_ / "team.cfg", ssl::Team::yellow);
  }
  ~SoccerTeam() override { std::filesystem::remove_all(folder_); }

  Team& team() { return *team_; }
  TeamRobot& robot() { return team()[3]; }

  void show() {
    ssl::TrackedFrame frame;
    frame.uuid = "1";
    frame.source_name = vision::bridge_name;
    frame.frame_number = ++frames_;
    frame.robots.push_back({.id = {ssl::Team::yellow, 3}, .pose = robot().pose()});
    frame.balls.push_back({.position = {.x = 1, .y = 2, .z = 0}});
    ASSERT_TRUE(tracker_.send(ssl::encode(frame)));
  }
  /// Read, with vision, until it is so. False: it was not within 10 s.
  template <typename Condition>
  bool reads_until(const Condition& condition) {
    for (const Time end = Clock::now() + 10s; Clock::now() < end;) {
      show();
      (void)team().read(10ms);
      if (condition()) return true;
    }
    return false;
  }
  void read_for(Duration duration) {
    const Time end = Clock::now() + duration;
    (void)reads_until([&] { return Clock::now() >= end; });
  }

  testing::TestServer server_;
  std::filesystem::path folder_;
  ssl::Group group_;
  ssl::MulticastSender tracker_;
  std::uint32_t frames_ = 0;
  std::unique_ptr<Team> team_;
};

TEST_F(SoccerTeam, steers_a_robot_to_where_it_shall_be) {
  const Pose2d goal{.x = 0.4, .y = 0.3, .heading = 1};
  robot().drive_to(goal);
  EXPECT_TRUE(reads_until([&] { return robot().is_at(goal, {.distance_m = 0.02, .heading_rad = 0.05}); }));
  EXPECT_EQ(robot().stopped_because(), "");
}

TEST_F(SoccerTeam, steers_nobody_whom_vision_does_not_show) {
  robot().drive_to({.x = 1});
  for (const Time end = Clock::now() + 300ms; Clock::now() < end;) (void)team().read(10ms);
  EXPECT_EQ(robot().pose(), Pose2d{});
  EXPECT_EQ(team().seen_age(), Duration::max());
  EXPECT_TRUE(team().seen().empty());
  EXPECT_FALSE(team().ball());
}

TEST_F(SoccerTeam, shows_what_the_tracker_says_of_the_field) {
  EXPECT_TRUE(reads_until([&] { return team().ball().has_value(); }));
  EXPECT_EQ(team().ball()->position.y, 2);
  EXPECT_TRUE(team().seen({ssl::Team::yellow, 3}));
  EXPECT_FALSE(team().seen({ssl::Team::blue, 3}));
}

TEST_F(SoccerTeam, goes_on_to_a_destination_that_somebody_has_stopped) {
  const Pose2d goal{.x = 0.5};
  robot().go_to(goal);
  EXPECT_TRUE(reads_until([&] { return robot().pose().x > 0.05; }));
  client::Robot referee{"127.0.0.1", server_.port(), {.name = "referee"}};
  referee.position2d().stop();
  EXPECT_TRUE(reads_until([&] { return robot().stopped_because() == "\"referee\" asked for a stop"; }));
  EXPECT_TRUE(reads_until([&] { return robot().is_at(goal); }));
}

TEST_F(SoccerTeam, dribbles_for_longer_than_a_lease_and_until_told_otherwise) {
  robot().dribble(100);
  EXPECT_TRUE(reads_until([&] { return robot().kicker_state().dribbler_radps > 95; }));
  read_for(700ms);
  EXPECT_GT(robot().kicker_state().dribbler_radps, 95);
  robot().dribble(0);
  EXPECT_TRUE(reads_until([&] { return robot().kicker_state().dribbler_radps < 5; }));
  read_for(200ms);
  EXPECT_LT(robot().kicker_state().dribbler_radps, 5);
}

TEST_F(SoccerTeam, dribbles_again_after_somebody_stopped_it) {
  robot().dribble(100);
  EXPECT_TRUE(reads_until([&] { return robot().kicker_state().dribbler_radps > 95; }));
  client::Robot referee{"127.0.0.1", server_.port(), {.name = "referee"}};
  referee.stop();
  EXPECT_TRUE(reads_until([&] { return robot().kicker_state().dribbler_radps < 50; }));
  EXPECT_TRUE(reads_until([&] { return robot().kicker_state().dribbler_radps > 95; }));
}

TEST_F(SoccerTeam, refuses_numbers_that_are_none_and_robots_that_it_has_not) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(robot().drive_to({.x = nan}), std::invalid_argument);
  EXPECT_THROW(robot().set_velocity({.w = nan}), std::invalid_argument);
  EXPECT_THROW(robot().go_to({.heading = nan}), std::invalid_argument);
  EXPECT_THROW(robot().dribble(nan), std::invalid_argument);
  EXPECT_THROW((void)team()[4], std::out_of_range);
  EXPECT_EQ(team().size(), 1U);
}

}  // namespace
}  // namespace regista::soccer
