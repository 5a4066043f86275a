// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// Drives a base through way-points to a goal.
namespace regista::planner {

inline constexpr std::uint16_t code = 44;

struct State {
  std::uint8_t valid = 0;
  std::uint8_t done = 0;
  Pose2d pose{};
  Pose2d goal{};
  Pose2d waypoint{};
  std::int32_t waypoint_index = 0;
  std::uint32_t waypoint_count = 0;

  static constexpr Message message{code, Kind::data, 1, "STATE"};
  static constexpr auto fields = std::tuple{Field<&State::valid>{"valid", "", "1: there is a plan"},
                                            Field<&State::done>{"done", "", "1: the goal is reached"},
                                            Field<&State::pose>{"pos", "", "where the robot is"},
                                            Field<&State::goal>{"goal"},
                                            Field<&State::waypoint>{"waypoint", "", "the one being driven to"},
                                            Field<&State::waypoint_index>{"waypoint_idx", "", "-1: none, or done"},
                                            Field<&State::waypoint_count>{"waypoints_count"}};
  friend bool operator==(const State&, const State&) = default;
};

struct GoalCommand {
  Pose2d goal{};

  static constexpr Message message{code, Kind::command, 1, "GOAL", Flow::set_point, "mission"};
  static constexpr auto fields = std::tuple{Field<&GoalCommand::goal>{"goal"}};
  friend bool operator==(const GoalCommand&, const GoalCommand&) = default;
};

/// Go from here, as a GoalCommand to the pose given.
struct StartCommand {
  Pose2d start{};

  static constexpr Message message{code, Kind::command, 2, "START", Flow::set_point, "mission"};
  static constexpr auto fields = std::tuple{Field<&StartCommand::start>{"goal"}};
  friend bool operator==(const StartCommand&, const StartCommand&) = default;
};

struct Waypoints {
  double length_m = 0;
  std::vector<Pose2d> waypoints{};

  static constexpr auto fields = std::tuple{Field<&Waypoints::length_m>{"waypoints_distance", "m", "of the path"},
                                            Field<&Waypoints::waypoints>{"waypoints"}};
  friend bool operator==(const Waypoints&, const Waypoints&) = default;
};

struct GetWaypoints {
  using Reply = Waypoints;
  static constexpr Message message{code, Kind::request, 1, "GET_WAYPOINTS"};
  static constexpr auto fields = std::tuple{};
  friend bool operator==(const GetWaypoints&, const GetWaypoints&) = default;
};

struct Enable {
  std::uint8_t on = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 2, "ENABLE"};
  static constexpr auto fields = std::tuple{Field<&Enable::on>{"state", "", "1: drive, 0: pause"}};
  friend bool operator==(const Enable&, const Enable&) = default;
};

}  // namespace regista::planner

namespace regista {

struct Planner {
  static constexpr std::uint16_t code = planner::code;
  static constexpr std::string_view name = "planner";
  using Messages =
      TypeList<planner::State, planner::GoalCommand, planner::StartCommand, planner::GetWaypoints, planner::Enable>;
};

}  // namespace regista
