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
  static constexpr auto fields = Fields{Field<&State::valid>{"valid", "", "1: there is a plan"},
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
  static constexpr auto fields = Fields{Field<&GoalCommand::goal>{"goal"}};
  friend bool operator==(const GoalCommand&, const GoalCommand&) = default;
};

/// Go from here, as a GoalCommand to the pose given.
struct StartCommand {
  Pose2d start{};

  static constexpr Message message{code, Kind::command, 2, "START", Flow::set_point, "mission"};
  static constexpr auto fields = Fields{Field<&StartCommand::start>{"goal"}};
  friend bool operator==(const StartCommand&, const StartCommand&) = default;
};

struct Waypoints {
  double length_m = 0;
  std::vector<Pose2d> waypoints{};

  static constexpr auto fields = Fields{Field<&Waypoints::length_m>{"waypoints_distance", "m", "of the path"},
                                        Field<&Waypoints::waypoints>{"waypoints"}};
  friend bool operator==(const Waypoints&, const Waypoints&) = default;
};

struct GetWaypoints {
  using Reply = Waypoints;
  static constexpr Message message{code, Kind::request, 1, "GET_WAYPOINTS"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const GetWaypoints&, const GetWaypoints&) = default;
};

struct Enable {
  std::uint8_t on = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 2, "ENABLE"};
  static constexpr auto fields = Fields{Field<&Enable::on>{"state", "", "1: drive, 0: pause"}};
  friend bool operator==(const Enable&, const Enable&) = default;
};

// Missions: our own, no stock peer sends or gets them. Upload one, then drive it by RunCommand.

enum class Act : std::uint8_t { wait = 0, relay = 1, ask = 2 };

/// What to do when the robot stands at a way-point. Those of one point are done in their order.
struct Action {
  std::uint32_t point = 0;
  Act act{};
  double duration_s = 0;
  std::uint32_t output = 0;
  std::uint8_t on = 0;

  static constexpr auto fields =
      Fields{Field<&Action::point>{"point", "", "from 0"},
             Field<&Action::act>{"act", "", "0 wait, 1 set a relay, 2 ask: go on when somebody answers by GO_ON"},
             Field<&Action::duration_s>{"duration", "s", "of a wait"},
             Field<&Action::output>{"output", "", "of the relay"}, Field<&Action::on>{"on", "", "1: relay on"}};
  friend bool operator==(const Action&, const Action&) = default;
};

/// Upload a mission; it moves nothing. While one is under way, only that one again, which changes nothing.
struct SetMission {
  Text id{};
  std::vector<Pose2d> points{};
  std::vector<Action> actions{};

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 100, "SET_MISSION"};
  static constexpr auto fields = Fields{Field<&SetMission::id>{"id", "", "a name and a version, say"},
                                        Field<&SetMission::points>{"points", "", "10 000 at most"},
                                        Field<&SetMission::actions>{"actions", "", "100 000 at most"}};
  friend bool operator==(const SetMission&, const SetMission&) = default;
};

/// Drive the uploaded mission, or go on where it was stopped. Again: no change. Of a finished one: nothing.
struct RunCommand {
  Text id{};

  static constexpr Message message{code, Kind::command, 100, "RUN", Flow::set_point, "mission"};
  static constexpr auto fields = Fields{Field<&RunCommand::id>{"id", "", "of the mission that is meant"}};
  friend bool operator==(const RunCommand&, const RunCommand&) = default;
};

enum class MissionState : std::uint8_t {
  none = 0,
  ready = 1,
  driving = 2,
  working = 3,
  asking = 4,
  paused = 5,
  failed = 6,
  finished = 7
};

/// How far the mission is.
struct Mission {
  Text id{};
  MissionState state{};
  std::uint32_t point = 0;
  std::uint32_t count = 0;
  std::uint32_t action = 0;
  double distance_m = 0;
  Text reason{};

  static constexpr auto fields =
      Fields{Field<&Mission::id>{"id"},
             Field<&Mission::state>{"state", "",
                                    "0 none, 1 uploaded, 2 driving, 3 at work, 4 asks, 5 paused, 6 failed, 7 finished"},
             Field<&Mission::point>{"point", "", "from 0; their count when finished"},
             Field<&Mission::count>{"count", "", "of points"},
             Field<&Mission::action>{"action", "", "from 0, of this point"},
             Field<&Mission::distance_m>{"distance", "m", "still to go to this point, as the crow flies"},
             Field<&Mission::reason>{"reason", "", "why it is paused or failed, or what it asks"}};
  friend bool operator==(const Mission&, const Mission&) = default;
};

struct GetMission {
  using Reply = Mission;
  static constexpr Message message{code, Kind::request, 101, "GET_MISSION"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const GetMission&, const GetMission&) = default;
};

/// The answer to what this action of this point asks; refused when that is not what it asks.
struct GoOn {
  std::uint32_t point = 0;
  std::uint32_t action = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 102, "GO_ON"};
  static constexpr auto fields = Fields{Field<&GoOn::point>{"point"}, Field<&GoOn::action>{"action"}};
  friend bool operator==(const GoOn&, const GoOn&) = default;
};

}  // namespace regista::planner

namespace regista {

struct Planner {
  static constexpr std::uint16_t code = planner::code;
  static constexpr std::string_view name = "planner";
  using Messages =
      TypeList<planner::State, planner::GoalCommand, planner::StartCommand, planner::GetWaypoints, planner::Enable,
               planner::SetMission, planner::RunCommand, planner::GetMission, planner::GoOn>;
};

}  // namespace regista
