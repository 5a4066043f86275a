// SPDX-License-Identifier: Apache-2.0
#include "waypoint.hpp"

#include <algorithm>
#include <cmath>

namespace regista {

namespace {

using namespace std::chrono_literals;
using control::ToolAction;

constexpr Range positive{.min = 1e-6};
constexpr Range not_negative{.min = 0};
constexpr std::size_t most_points = 10'000;
constexpr std::size_t most_actions = 100'000;
constexpr double longest_wait_s = 1e6;
constexpr Duration base_timeout = 500ms;  // without its data it is not known to do anything

control::WaypointMissionConfig read_mission(const Section& config) {
  control::WaypointMissionConfig mission;
  auto& law = mission.law;
  law.k1 = config.number("k1", law.k1, not_negative);
  law.k2 = config.number("k2", law.k2, positive);
  law.k3 = config.number("k3", law.k3, positive);
  law.beta = config.number("beta", law.beta, not_negative);
  law.lambda = config.number("lambda", law.lambda, positive);
  law.speed_mps = config.length("speed", 0.5, positive);
  law.turn_rate_limit_radps = config.angle("turn_speed", 0.8, positive);
  auto& parking = mission.parking;
  parking.radius_m = config.length("park", parking.radius_m, positive);
  parking.leave_radius_m = config.length("leave", 2 * parking.radius_m, {.min = parking.radius_m});
  parking.estimates = static_cast<int>(config.integer("estimates", parking.estimates, {.min = 1, .max = 10'000}));
  parking.jump_m = config.length("jump", parking.jump_m, positive);
  parking.believe_after =
      static_cast<int>(config.integer("believe_after", parking.believe_after, {.min = 1, .max = 10'000}));
  mission.estimate_timeout = config.duration("pose_timeout", mission.estimate_timeout, {.min = 0.05, .max = 60});
  mission.drive_timeout = config.duration("drive_timeout", mission.drive_timeout, {.min = 1, .max = 86'400});
  mission.tool_timeout = std::chrono::hours{24 * 365};  // what it does at a point ends by itself, or asks somebody
  return mission;
}

std::size_t count_of(const Section& config, std::uint16_t interface) {
  const auto names = config.device_names("requires");
  return static_cast<std::size_t>(
      std::ranges::count_if(names, [&](const PlacedName& p) { return p.name.interface == interface; }));
}

bool is_place(const Pose2d& pose) {
  constexpr double earth_m = 1e8;
  return std::abs(pose.x) < earth_m && std::abs(pose.y) < earth_m && std::abs(pose.heading) < earth_m;
}

Error invalid(const std::string& what) { return {std::errc::invalid_argument, what}; }

}  // namespace

Waypoint::Waypoint(Setup& setup)
    : port_{setup.provide<Planner>()},
      base_{setup.require<Position2d>()},
      poses_{count_of(setup.config, Position2d::code) > 1 ? std::optional{setup.require<Position2d>()} : std::nullopt},
      config_{read_mission(setup.config)},
      obedience_{{.patience = setup.config.duration("obey_timeout", 3s, {.min = 0.1, .max = 60})}} {
  if (setup.config.boolean("outlives_owner", false) && !setup.config.boolean("alwayson", false)) {
    throw setup.config.error("outlives_owner", "needs `alwayson yes`: nobody else keeps this driver open");
  }
  if (count_of(setup.config, Dio::code) > 0) {
    relay_count_ = static_cast<std::uint32_t>(setup.config.integer("relays", 8, {.min = 1, .max = 32}));
    relays_.emplace(
        setup.require<Dio>(),
        RelayBank::Options{.count = relay_count_, .feedback = setup.config.boolean("relay_feedback", false)},
        [this](const std::string& why) { fail_relays(why); });
  }
  base_.on_data<position2d::State>([this](const position2d::State& state, Time) {
    wheels_ = state.velocity;
    wheels_seen_ = port_.now();
    if (!poses_) pose_ = new_pose_ = state.pose;
  });
  if (poses_) {
    poses_->on_data<position2d::State>(
        [this](const position2d::State& state, Time) { pose_ = new_pose_ = state.pose; });
  }
  port_.on<planner::GoalCommand>([this](const planner::GoalCommand& goal) { return go_to(goal); });
  port_.on<planner::RunCommand>([this](const planner::RunCommand& command) { return run(command); });
  port_.on<planner::SetMission>([this](const planner::SetMission& list) { return set_mission(list); });
  port_.on<planner::Enable>([this](const planner::Enable& request) { return enable(request.on != 0); });
  port_.on<planner::GoOn>([this](const planner::GoOn& answer) { return go_on(answer); });
  port_.on<planner::GetMission>([this](const auto&) -> Result<planner::Mission> { return mission(); });
  port_.on<planner::GetWaypoints>([this](const auto&) -> Result<planner::Waypoints> {
    planner::Waypoints path{.waypoints = list_.points};
    for (std::size_t i = 1; i < list_.points.size(); ++i) {
      path.length_m += distance(list_.points[i - 1], list_.points[i]);
    }
    return path;
  });
}

Result<> Waypoint::open() {
  new_pose_.reset();
  pose_.reset();
  wheels_seen_.reset();
  if (mission_) mission_->forget_pose();
  return {};
}

// -- What it is told

Result<> Waypoint::check(const planner::SetMission& list) const {
  const auto number = [](std::size_t i) { return std::to_string(i); };
  if (list.id.view().empty()) return invalid("the mission has no id");
  if (list.points.empty()) return invalid("the mission has no points");
  if (list.points.size() > most_points || list.actions.size() > most_actions) {
    return invalid(number(list.points.size()) + " points with " + number(list.actions.size()) + " actions: at most " +
                   number(most_points) + " with " + number(most_actions));
  }
  for (std::size_t i = 0; i < list.points.size(); ++i) {
    if (!is_place(list.points[i])) return invalid("point " + number(i) + " is no place");
  }
  for (std::size_t i = 0; i < list.actions.size(); ++i) {
    const planner::Action& action = list.actions[i];
    const std::string name = "action " + number(i);
    if (action.point >= list.points.size()) {
      return invalid(name + ": point " + number(action.point) + " of " + number(list.points.size()));
    }
    switch (action.act) {
      case planner::Act::wait:
        if (!(action.duration_s >= 0 && action.duration_s <= longest_wait_s)) {
          return invalid(name + ": a wait must be within [0, 1e6] s");
        }
        break;
      case planner::Act::relay:
        if (action.output >= relay_count_) {
          return invalid(name + ": relay " + number(action.output) + ", of " + number(relay_count_) +
                         (relays_ ? " (key `relays`)" : ": the driver requires no dio"));
        }
        break;
      case planner::Act::ask:
        break;
      default:
        return invalid(name + ": there is no such action");
    }
  }
  return {};
}

Result<Empty> Waypoint::set_mission(const planner::SetMission& list) {
  if (Result<> checked = check(list); !checked) return checked.error();
  if (under_way()) {
    if (list == list_) return Empty{};
    return Error{std::errc::device_or_resource_busy,
                 "mission \"" + std::string{list_.id.view()} + "\" is under way: stop it first"};
  }
  if (Result<> loaded = load(list); !loaded) return loaded.error();
  return Empty{};
}

Result<> Waypoint::load(planner::SetMission list) {
  // Work that was broken off: nobody comes back to it.
  if (relays_ && (restoring_ || !relays_->stand(relays_before_))) {
    if (!relays_->tell(relays_before_)) {
      return Error{std::errc::not_connected, "the relays of the work that was broken off are not connected"};
    }
    restoring_ = true;
  }
  list_ = std::move(list);
  actions_.assign(list_.points.size(), {});
  for (const planner::Action& action : list_.actions) actions_[action.point].push_back(action);
  mission_.reset();
  output_ = {};
  commanded_ = false;
  reason_.clear();
  return {};
}

Result<> Waypoint::run(const planner::RunCommand& command) {
  if (list_.points.empty() || command.id != list_.id) {
    return invalid("mission \"" + std::string{command.id.view()} + "\" was not uploaded");
  }
  if (!commanded_) begin();
  return {};
}

Result<> Waypoint::go_to(const planner::GoalCommand& goal) {
  if (!is_place(goal.goal)) return invalid("the goal is no place");
  if (commanded_ && list_.id.view().empty() && list_.points.front() == goal.goal) return {};
  if (Result<> loaded = load({.points = {goal.goal}}); !loaded) return loaded;
  begin();
  return {};
}

/// Drive it, or go on where it was held or halted.
void Waypoint::begin() {
  if (!mission_) {
    std::vector<control::Waypoint> points;
    points.reserve(list_.points.size());
    for (std::size_t i = 0; i < list_.points.size(); ++i) {
      points.push_back(
          {.pose = list_.points[i], .work = actions_[i].empty() ? control::Work::none : control::Work::measure});
    }
    mission_.emplace(config_, std::move(points));
    output_ = {};
    report_ = {};
  }
  mission_->resume();
  if (output_.phase == Phase::failed) output_.phase = Phase::driving;  // until the next beat says
  obedience_.forgive();
  commanded_ = true;
  held_ = planner::MissionState::none;
  reason_.clear();
}

void Waypoint::hold(planner::MissionState state, const std::string& reason) {
  if (drives()) (void)base_.send(position2d::VelocityCommand{});  // once: then the base is free for others
  mission_->pause();
  held_ = state;
  reason_ = reason;
}

Result<Empty> Waypoint::enable(bool on) {
  if (!commanded_) return Error{std::errc::operation_not_permitted, "no mission is under way: send RUN"};
  if (on) {
    if (held_ != planner::MissionState::none || output_.phase == Phase::failed) begin();
  } else if (drives()) {
    hold(planner::MissionState::paused, "paused by ENABLE");
  }
  return Empty{};
}

Result<Empty> Waypoint::go_on(const planner::GoOn& answer) {
  const planner::Mission now = mission();
  if (now.state != planner::MissionState::asking || answer.point != now.point || answer.action != now.action) {
    return Error{std::errc::operation_not_permitted, "action " + std::to_string(answer.action) + " of point " +
                                                         std::to_string(answer.point) + " does not ask"};
  }
  answered_ = true;
  return Empty{};
}

// -- What it does

bool Waypoint::drives() const {
  return commanded_ && held_ == planner::MissionState::none && output_.phase != Phase::finished &&
         output_.phase != Phase::failed;
}

Result<> Waypoint::read(const Tick& tick) {
  if (restoring_ && (relays_->switching() || drives())) restoring_ = !relays_->step(relays_before_, tick.dt);
  if (restoring_ || !mission_) return {};  // nobody drives with what other work left on
  const bool speaks = wheels_seen_ && tick.now - *wheels_seen_ <= base_timeout;
  const bool drove = drives();
  const BodyVelocity commanded = output_.command;
  const auto before = std::exchange(output_, mission_->step({.estimate = std::exchange(new_pose_, std::nullopt),
                                                             .wheels = speaks ? wheels_ : BodyVelocity{},
                                                             .tool = report_},
                                                            tick.dt));
  if (!drove) return {};
  tell_progress(before);
  (void)base_.send(position2d::VelocityCommand{.velocity = output_.command});
  if (!drives()) return {};
  if (!obedience_.step(commanded, speaks ? std::optional{wheels_} : std::nullopt, tick.dt)) {
    hold(planner::MissionState::failed,
         "the base does not do what it is told: blocked, stopped, without power, or driven by somebody else");
    port_.tell(1, reason_);
    return {};
  }
  work(tick.dt);
  return {};
}

void Waypoint::work(Duration dt) {
  const bool begins = output_.tool != report_.finished;
  if (output_.tool == ToolAction::lower && begins) {
    if (relays_) relays_before_ = relays_->bits();
    action_ = 0;
    waited_ = {};
    asked_ = answered_ = false;
  }
  if (output_.tool == ToolAction::measure) {
    do_actions(dt);
    if (action_ < actions_[output_.waypoint].size()) return;
  }
  const bool interrupted = output_.tool == ToolAction::raise && action_ < actions_[output_.waypoint].size();
  if (interrupted && relays_ && !relays_->step(relays_before_, dt)) return;
  if (output_.tool == ToolAction::raise && relays_) relays_before_ = relays_->bits();  // what was done here stays
  report_ = {.finished = output_.tool};
}

void Waypoint::do_actions(Duration dt) {
  const auto& actions = actions_[output_.waypoint];
  waited_ += dt;
  for (; action_ < actions.size(); ++action_) {
    const planner::Action& action = actions[action_];
    if (action.act == planner::Act::wait && seconds(waited_) < action.duration_s) return;
    if (action.act == planner::Act::ask && !answered_) {
      if (!std::exchange(asked_, true)) {
        port_.tell(0, "action " + std::to_string(action_) + " of point " + std::to_string(output_.waypoint) + " asks");
      }
      return;
    }
    if (action.act == planner::Act::relay) {
      const std::uint32_t bit = 1U << action.output;
      const std::uint32_t now = relays_->bits();
      if (!relays_->step(action.on != 0 ? now | bit : now & ~bit, dt)) return;
    }
    waited_ = {};
    asked_ = answered_ = false;
  }
}

void Waypoint::fail_relays(const std::string& why) {
  if (drives()) hold(planner::MissionState::failed, why);
  port_.tell(1, why);
}

void Waypoint::halt() noexcept {
  if (!commanded_) return;
  if (drives()) (void)base_.send(position2d::VelocityCommand{});
  mission_->pause();
  commanded_ = false;
  held_ = planner::MissionState::none;
  reason_.clear();
}

// -- What it says

void Waypoint::tell_progress(const control::WaypointMission::Output& before) {
  const std::string of = " of " + std::to_string(list_.points.size());
  if (output_.waypoint != before.waypoint) port_.tell(0, "point " + std::to_string(before.waypoint) + of + " is done");
  if (output_.phase == before.phase) return;
  if (output_.phase == Phase::finished) port_.tell(0, "the mission is finished");
  if (output_.phase == Phase::failed) {
    port_.tell(1, "point " + std::to_string(output_.waypoint) + of + " failed: " + std::string{output_.failure});
  }
}

planner::Mission Waypoint::mission() const {
  using planner::MissionState;
  planner::Mission mission{.id = list_.id,
                           .state = list_.points.empty() ? MissionState::none : MissionState::ready,
                           .point = static_cast<std::uint32_t>(output_.waypoint),
                           .count = static_cast<std::uint32_t>(list_.points.size()),
                           .action = 0,
                           .distance_m = output_.distance_m,
                           .reason = reason_};
  if (!mission_) return mission;
  const bool working = output_.phase == Phase::lowering || output_.phase == Phase::working;
  if (working) mission.action = static_cast<std::uint32_t>(action_);
  if (output_.phase == Phase::finished) {
    mission.state = MissionState::finished;
  } else if (held_ != MissionState::none) {
    mission.state = held_;
  } else if (!commanded_) {
    mission.state = MissionState::paused;
    mission.reason = "stopped: RUN goes on";
  } else if (output_.phase == Phase::failed) {
    mission.state = MissionState::failed;
    mission.reason = std::string{output_.failure};
  } else if (output_.phase == Phase::driving) {
    mission.state = MissionState::driving;
  } else {
    const auto& actions = actions_[output_.waypoint];
    const bool asks = working && action_ < actions.size() && actions[action_].act == planner::Act::ask && !answered_;
    mission.state = asks ? MissionState::asking : MissionState::working;
  }
  return mission;
}

void Waypoint::publish() {
  planner::State state{.valid = pose_ && !list_.points.empty(),
                       .done = mission_ && output_.phase == Phase::finished,
                       .pose = pose_.value_or(Pose2d{}),
                       .waypoint_index = -1,
                       .waypoint_count = static_cast<std::uint32_t>(list_.points.size())};
  if (!list_.points.empty()) {
    state.goal = list_.points.back();
    state.waypoint = list_.points[std::min(output_.waypoint, list_.points.size() - 1)];
    if (state.done == 0) state.waypoint_index = static_cast<std::int32_t>(output_.waypoint);
  }
  port_.send(state);
}

}  // namespace regista
