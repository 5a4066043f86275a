// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// A simulated world.
namespace regista::simulation {

inline constexpr std::uint16_t code = 31;

struct PauseCommand {
  static constexpr Message message{code, Kind::command, 1, "PAUSE", Flow::edge, "simulation"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const PauseCommand&, const PauseCommand&) = default;
};

struct ResetCommand {
  static constexpr Message message{code, Kind::command, 2, "RESET", Flow::edge, "simulation"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const ResetCommand&, const ResetCommand&) = default;
};

struct SaveCommand {
  static constexpr Message message{code, Kind::command, 3, "SAVE", Flow::edge, "simulation"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const SaveCommand&, const SaveCommand&) = default;
};

struct GetPose2d {
  Text object{};
  Pose2d pose{};

  using Reply = GetPose2d;
  static constexpr Message message{code, Kind::request, 1, "GET_POSE2D"};
  static constexpr auto fields =
      Fields{Field<&GetPose2d::object>{"name"}, Field<&GetPose2d::pose>{"pose", "", "of the answer"}};
  friend bool operator==(const GetPose2d&, const GetPose2d&) = default;
};

struct SetPose2d {
  Text object{};
  Pose2d pose{};

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 2, "SET_POSE2D"};
  static constexpr auto fields = Fields{Field<&SetPose2d::object>{"name"}, Field<&SetPose2d::pose>{"pose"}};
  friend bool operator==(const SetPose2d&, const SetPose2d&) = default;
};

struct GetPose3d {
  Text object{};
  Pose3d pose{};
  double time_s = 0;

  using Reply = GetPose3d;
  static constexpr Message message{code, Kind::request, 3, "GET_POSE3D"};
  static constexpr auto fields =
      Fields{Field<&GetPose3d::object>{"name"}, Field<&GetPose3d::pose>{"pose", "", "of the answer"},
             Field<&GetPose3d::time_s>{"simtime", "s", "simulated, of the answer"}};
  friend bool operator==(const GetPose3d&, const GetPose3d&) = default;
};

struct SetPose3d {
  Text object{};
  Pose3d pose{};
  double time_s = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 4, "SET_POSE3D"};
  static constexpr auto fields = Fields{Field<&SetPose3d::object>{"name"}, Field<&SetPose3d::pose>{"pose"},
                                        Field<&SetPose3d::time_s>{"simtime", "s"}};
  friend bool operator==(const SetPose3d&, const SetPose3d&) = default;
};

struct GetProperty {
  Text object{};
  Text property{};
  std::uint32_t index = 0;
  Text value{};

  using Reply = GetProperty;
  static constexpr Message message{code, Kind::request, 5, "GET_PROPERTY"};
  static constexpr auto fields =
      Fields{Field<&GetProperty::object>{"name"}, Field<&GetProperty::property>{"prop"},
             Field<&GetProperty::index>{"index"}, Field<&GetProperty::value>{"value", "", "of the answer"}};
  friend bool operator==(const GetProperty&, const GetProperty&) = default;
};

struct SetProperty {
  Text object{};
  Text property{};
  std::uint32_t index = 0;
  Text value{};

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 6, "SET_PROPERTY"};
  static constexpr auto fields = Fields{Field<&SetProperty::object>{"name"}, Field<&SetProperty::property>{"prop"},
                                        Field<&SetProperty::index>{"index"}, Field<&SetProperty::value>{"value"}};
  friend bool operator==(const SetProperty&, const SetProperty&) = default;
};

}  // namespace regista::simulation

namespace regista {

struct Simulation {
  static constexpr std::uint16_t code = simulation::code;
  static constexpr std::string_view name = "simulation";
  using Messages = TypeList<simulation::PauseCommand, simulation::ResetCommand, simulation::SaveCommand,
                            simulation::GetPose2d, simulation::SetPose2d, simulation::GetPose3d, simulation::SetPose3d,
                            simulation::GetProperty, simulation::SetProperty>;
};

}  // namespace regista
