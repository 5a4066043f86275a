// SPDX-License-Identifier: Apache-2.0
// A battery that is critical stops the base.
#include "battery.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "plant.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

class BatteryOfARobot : public ::testing::Test {
 protected:
  BatteryOfARobot() : root_{fs::path{::testing::TempDir()} / ("battery-" + std::to_string(::getpid()))} {
    fs::create_directories(supply());
    set(50, "Discharging");
    auto drivers = drivers_in(world_);
    drivers["battery"] = [](regista::Setup& setup) { return std::make_unique<BatteryDriver>(setup); };
    rig_.emplace(plant_section + (R"(driver ( name "battery" provides ["power:0"] requires ["position2d:0"] rate 1
                                     alwayson yes root ")" +
                                  root_.string() + "\" )"),
                 drivers);
    rig_->run(1s);
  }
  ~BatteryOfARobot() override { fs::remove_all(root_); }

  void set(int percent, const std::string& status) {
    const std::map<std::string, std::string> files{
        {"type", "Battery"}, {"status", status}, {"present", "1"}, {"capacity", std::to_string(percent)}};
    for (const auto& [name, text] : files) std::ofstream{supply() / name} << text << '\n';
  }
  /// A client that goes on commanding, for so long; how far it came [m].
  double drive(Duration duration) {
    const Pose2d before = world_.truth;
    for (Duration time{}; time < duration; time += 50ms) {
      rig_->send(position2d::VelocityCommand{.velocity = {.x = 1}});
      rig_->run(50ms);
    }
    return distance(before, world_.truth);
  }

  World world_;
  std::optional<testing::Rig> rig_;

 private:
  [[nodiscard]] fs::path supply() const { return root_ / "class/power_supply/BAT0"; }
  fs::path root_;
};

TEST_F(BatteryOfARobot, stops_it_when_it_is_critical_and_says_why) {
  EXPECT_GT(drive(3s), 2);
  rig_->events();
  set(9, "Discharging");
  drive(2s);
  const std::string events = rig_->events();
  EXPECT_NE(events.find("power:0: battery critical: 9 %: the robot is stopped until it is charged"), std::string::npos)
      << events;
  EXPECT_NE(events.find("position2d:0 stopped: \"battery\" asked for a stop"), std::string::npos) << events;
  EXPECT_LT(drive(10s), 0.01) << "who goes on is refused";
  EXPECT_EQ(world_.commanded, BodyVelocity{});
}

TEST_F(BatteryOfARobot, stops_those_again_who_begin_anew) {
  set(9, "Discharging");
  rig_->run(2s);
  const Pose2d before = world_.truth;
  for (int i = 0; i < 10; ++i) {
    rig_->run(800ms);
    rig_->send(position2d::VelocityCommand{.velocity = {.x = 1}});
  }
  rig_->run(1s);
  EXPECT_LT(distance(before, world_.truth), 10 * 0.02);
}

TEST_F(BatteryOfARobot, lets_it_go_when_it_is_charged) {
  set(9, "Discharging");
  EXPECT_LT(drive(3s), 1.5);
  set(9, "Charging");
  rig_->run(2s);
  EXPECT_GT(drive(3s), 2) << "from the charger it may drive away";
  set(9, "Discharging");
  drive(2s);
  EXPECT_LT(drive(1s), 0.01);
  set(40, "Discharging");
  rig_->run(2s);
  EXPECT_GT(drive(3s), 2);
}

}  // namespace
}  // namespace regista
