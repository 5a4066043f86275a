// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <regista/device/config_file.hpp>
#include <regista/vision/config.hpp>

namespace regista::vision {

namespace {

ssl::Group read_group(const Section& section, const std::string& prefix, const ssl::Group& usual) {
  return {.address = section.text(prefix + "group", usual.address),
          .port = static_cast<std::uint16_t>(section.integer(prefix + "port", usual.port, {.min = 1, .max = 65535}))};
}

void read_vision(const Section& section, BridgeConfig& config) {
  const std::string input = section.text("input", "vision");
  if (input != "vision" && input != "tracked") throw section.error("input", "must be \"vision\" or \"tracked\"");
  config.input = input == "vision" ? BridgeConfig::Input::vision : BridgeConfig::Input::tracked;
  config.vision = read_group(section, "", ssl::vision_group);
  config.tracked = read_group(section, "tracked_", ssl::tracker_group);
  config.tracker = section.text("tracker", "");
  config.interfaces = section.texts("interfaces", {});
  config.publish = section.texts("publish", {});
  if (section.boolean("referee", true)) {
    config.referee = read_group(section, "referee_", ssl::referee_group);
  } else {
    config.referee.reset();
  }
  if (section.has("status_port"))
    config.status_port = static_cast<std::uint16_t>(section.integer("status_port", {.min = 0, .max = 65535}));
  config.learn_delay = !section.has("delay");
  config.tracking.delay = section.duration("delay", config.tracking.delay, {.max = 0.5});
  config.tracking.frames_to_show =
      static_cast<int>(section.integer("frames_to_show", config.tracking.frames_to_show, {.min = 2, .max = 100}));
  config.tracking.field_margin_m = section.length("field_margin", config.tracking.field_margin_m, {.min = 0});
  section.check_unused();
}

RobotAddress read_robot(const Section& section) {
  RobotAddress robot;
  const std::string team = section.text("team");
  if (team != "yellow" && team != "blue") throw section.error("team", "must be \"yellow\" or \"blue\"");
  robot.id.team = team == "yellow" ? ssl::Team::yellow : ssl::Team::blue;
  robot.id.number = static_cast<std::uint8_t>(section.integer("id", {.min = 0, .max = ssl::robots_per_team - 1}));
  robot.host = section.text("host");
  robot.port = static_cast<std::uint16_t>(section.integer("port", robot.port, {.min = 1, .max = 65535}));
  robot.index = static_cast<std::uint16_t>(section.integer("index", robot.index, {.min = 0, .max = 65535}));
  // A robot with one position2d for all does not tell how it turns.
  if (robot.index == 0) robot.motion.reset();
  if (section.has("motion"))
    robot.motion = static_cast<std::uint16_t>(section.integer("motion", {.min = 0, .max = 65535}));
  if (robot.motion == robot.index) throw section.error("motion", "must be another position2d than 'index'");
  section.check_unused();
  return robot;
}

}  // namespace

BridgeConfig read_bridge_config(const std::filesystem::path& file) {
  constexpr std::array<std::string_view, 2> types{"vision", "robot"};
  BridgeConfig config;
  std::optional<Place> vision;
  for (const Section& section : read_sections(file, types)) {
    if (section.type() == "vision") {
      if (vision)
        throw ConfigError{section.place(), "a second section 'vision'; the first is at " + to_string(*vision)};
      vision = section.place();
      read_vision(section, config);
      continue;
    }
    const RobotAddress robot = read_robot(section);
    if (std::ranges::find(config.robots, robot.id, &RobotAddress::id) != config.robots.end())
      throw ConfigError{section.place(), "a second robot " + to_string(robot.id)};
    config.robots.push_back(robot);
  }
  return config;
}

}  // namespace regista::vision
