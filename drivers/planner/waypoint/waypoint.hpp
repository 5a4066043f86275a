// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/control/obedience.hpp>
#include <regista/control/waypoint_mission.hpp>
#include <regista/device/driver.hpp>

#include "relay_bank.hpp"

namespace regista {

/// Drives a base that cannot move sideways through way-points, parks at each and works there: control::WaypointMission,
/// after Park and Kuipers 2011 and Lien 2013.
///
/// `requires ["position2d:0" "position2d:1"]`: the base, which is driven by velocities, and whatever knows the pose,
/// such as a `localizer`; with one alone, its odometry is the pose. With relays also a `dio`. Here or on other servers.
/// `provides ["planner:0"]`: SET_MISSION uploads a list, RUN drives it, or goes on with it; GOAL drives to one pose;
/// ENABLE 0 pauses and ENABLE 1 goes on, after a failure too; GET_MISSION tells how far it is and why it stands; GO_ON
/// answers a point that asks. Points reached, questions and failures are also events.
///
/// RUN and GOAL follow the rules of motion: a mission stands when its owner is gone, silent or stopped, and goes on
/// with the next RUN. With `outlives_owner yes alwayson yes` it survives its owner. The base is commanded at each beat
/// while the mission is under way and left alone while it is paused: when this driver or its server dies, the base's
/// own lease stops it. When somebody else drives the base, the mission fails and does not go on by itself.
///
/// A point is worked at action by action. A relay counts as switched when the dio's driver has taken it; with
/// `relay_feedback yes` when the dio's data say so, as those of `can_motor` do, whose drives may refuse later what it
/// has taken. When that driver refuses, or nothing happens for 2 s, the mission fails with the reason, and ENABLE 1
/// tries it again. When the robot is moved from there, the mission fails, with the relays as they are; with ENABLE 1
/// they go back to what they were when it came, it drives there again and begins anew. A stop and a pause leave the
/// relays as they are, too; another mission or goal puts them back, and does not drive before the dio has taken that:
/// it fails as above, and RUN or ENABLE 1 tries again.
///
/// | Key                 | Value                                                                     | Default       |
/// |---------------------|---------------------------------------------------------------------------|---------------|
/// | `speed`             | [length/s] on the straight                                                | 0.5 m/s       |
/// | `turn_speed`        | [angle/s] at most                                                         | 0.8 rad/s     |
/// | `k1`, `k2`, `k3`    | gains of the law: swing out, turn, slow down near the goal [1/s]          | 1, 3, 0.5     |
/// | `beta`, `lambda`    | how much it slows down in curves, and how suddenly                        | 0.4, 2        |
/// | `park`              | [length] from the point at which it is parked …                           | 0.3 m         |
/// | `estimates`         | … in so many poses in a row                                               | 10            |
/// | `leave`             | [length] beyond which it is no longer parked                              | twice `park`  |
/// | `jump`              | [length] by which a pose may be off where the wheels led                  | 1 m           |
/// | `believe_after`     | poses in a row that agree elsewhere: it has jumped                        | 50            |
/// | `pose_timeout`      | [s] without a pose that can be believed: the mission fails                | 2             |
/// | `drive_timeout`     | [s] from one point to the next                                            | 300           |
/// | `obey_timeout`      | [s] for which the base may do something else than it is told              | 3             |
/// | `relays`            | outputs of the dio, from 0, that are ours                                 | 8             |
/// | `relay_feedback`    | the dio's data are how its outputs stand, not inputs                      | no            |
class Waypoint final : public Driver {
 public:
  explicit Waypoint(Setup& setup);

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override;

 private:
  using Phase = control::WaypointMission::Phase;

  [[nodiscard]] Result<> check(const planner::SetMission& list) const;
  Result<Empty> set_mission(const planner::SetMission& list);
  Result<> load(planner::SetMission list);
  Result<> run(const planner::RunCommand& command);
  Result<> go_to(const planner::GoalCommand& goal);
  Result<Empty> enable(bool on);
  Result<Empty> go_on(const planner::GoOn& answer);
  void begin();
  void hold(planner::MissionState state, const std::string& reason);
  void work(Duration dt);
  void do_actions(Duration dt);
  void fail_relays(const std::string& why);
  void tell_progress(const control::WaypointMission::Output& before);
  [[nodiscard]] planner::Mission mission() const;
  [[nodiscard]] bool under_way() const { return commanded_ && output_.phase != Phase::finished; }
  [[nodiscard]] bool drives() const;

  Port<Planner> port_;
  Required<Position2d> base_;
  std::optional<Required<Position2d>> poses_;
  std::optional<RelayBank> relays_;

  // As configured.
  control::WaypointMissionConfig config_;
  std::uint32_t relay_count_ = 0;

  // The mission.
  planner::SetMission list_;
  std::vector<std::vector<planner::Action>> actions_;  ///< by point
  std::optional<control::WaypointMission> mission_;    ///< once it was begun
  control::WaypointMission::Output output_;
  bool commanded_ = false;        ///< by RUN or GOAL, and not halted since
  planner::MissionState held_{};  ///< paused or failed, though commanded; none: it is not held
  std::string reason_;            ///< why it is held
  control::Obedience obedience_;

  // At work.
  control::ToolReport report_;
  std::size_t action_ = 0;  ///< of this point
  Duration waited_{};
  bool asked_ = false;
  bool answered_ = false;
  std::uint32_t relays_before_ = 0;  ///< at the start of the work at this point
  bool restoring_ = false;           ///< other work was broken off: they have to be as before it, first

  // What the devices said.
  std::optional<Pose2d> new_pose_;  ///< since the last beat
  std::optional<Pose2d> pose_;
  BodyVelocity wheels_;
  std::optional<Time> wheels_seen_;
};

}  // namespace regista
