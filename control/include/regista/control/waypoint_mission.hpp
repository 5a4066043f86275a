// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/control/waypoint_law.hpp>
#include <regista/control/waypoint_parking.hpp>
#include <string_view>
#include <vector>

namespace regista::control {

/// What to do at a way-point. Before working the tool is lowered, and afterwards raised.
enum class Work { none, wait, measure };

struct Waypoint {
  Pose2d pose;
  Work work = Work::none;
  Duration wait{};  ///< with Work::wait
};

enum class ToolAction { none, lower, measure, raise };

/// What the tool says. An action is finished when it is named here; one that nobody asked for is ignored.
struct ToolReport {
  ToolAction finished = ToolAction::none;
  bool failed = false;
};

struct WaypointMissionConfig {
  WaypointLawConfig law;
  ParkingConfig parking;
  Duration estimate_timeout = std::chrono::seconds{2};  ///< without an estimate that can be believed
  Duration drive_timeout = std::chrono::minutes{5};     ///< from one way-point to the next
  Duration tool_timeout = std::chrono::seconds{30};     ///< for each action of the tool
};

/// Visits way-points: drive, park, lower, wait or measure, raise, go on. A passive state machine: it asks for movement
/// and tool actions, and is told what happened.
class WaypointMission {
 public:
  enum class Phase { driving, lowering, working, raising, finished, failed };

  struct Input {
    std::optional<Pose2d> estimate;  ///< if one came since the last step
    BodyVelocity wheels;             ///< as measured
    ToolReport tool;
  };

  struct Output {
    BodyVelocity command;                ///< zero unless driving
    ToolAction tool = ToolAction::none;  ///< to be done, until reported finished
    Phase phase = Phase::driving;
    bool paused = false;
    std::size_t waypoint = 0;       ///< under way or worked at; their number when finished
    double distance_m = 0;          ///< still to go to it
    std::string_view failure = {};  ///< why it failed; empty otherwise
  };

  /// Throws std::invalid_argument that names what cannot be: no way-point, one that is no place, a time that is not
  /// positive, or what law and parking refuse.
  WaypointMission(const WaypointMissionConfig& config, std::vector<Waypoint> waypoints);

  [[nodiscard]] Output step(const Input& input, Duration dt);

  /// Stand still and ask for nothing; timeouts wait as well.
  void pause() { paused_ = true; }

  /// The robot may have been moved meanwhile: the next estimate is believed.
  void forget_pose() { parking_.forget(); }

  /// Go on after a pause. After a failure: try again what failed.
  void resume();

 private:
  void enter(Phase phase);
  void fail(std::string_view reason);
  void advance(const ToolReport& tool);

  WaypointMissionConfig config_;
  std::vector<Waypoint> waypoints_;
  WaypointLaw law_;
  ParkingDetector parking_;
  std::size_t current_ = 0;
  Phase phase_ = Phase::driving;
  Phase failed_phase_ = Phase::driving;
  std::string_view failure_;
  bool paused_ = false;
  bool work_done_ = false;  ///< at the current way-point
  Duration in_phase_{};
  Duration unseen_{};
};

}  // namespace regista::control
