// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <cmath>
#include <regista/soccer/team.hpp>
#include <stdexcept>
#include <utility>

namespace regista::soccer {

namespace {

using namespace std::chrono_literals;

constexpr Duration steer_period = 10ms;
constexpr Duration dribble_period = 50ms;  ///< less than the shortest lease
constexpr Duration vision_silent = 500ms;  ///< then nothing is known of the field, and another tracker may be believed
constexpr Duration vision_late = 200ms;    ///< then nobody is steered by it
constexpr Duration retry_margin = 100ms;   ///< on the lease for which somebody who was stopped has to pause
constexpr double robot_radius_m = 0.09;
constexpr double braking = 0.7;  ///< share of the acceleration that is counted on before the destination

control::AvoidanceConfig avoidance_config(const TeamOptions& options) {
  const double braking_s = options.speed_mps / options.acceleration_mps2;
  return {.speed_mps = options.speed_mps,
          .acceleration_mps2 = options.acceleration_mps2,
          .horizon = from_seconds(std::isfinite(braking_s) ? std::max(braking_s, 1.0) : 1.0)};
}

void require_finite(double a, double b, double c) {
  if (!std::isfinite(a + b + c)) throw std::invalid_argument{"a robot was told a number that is not finite"};
}

}  // namespace

// -- One robot

TeamRobot::TeamRobot(ssl::RobotId id, client::Robot& robot, std::string owner)
    : id_{id}, robot_{robot}, base_{robot.position2d()}, owner_{std::move(owner)} {}

void TeamRobot::drive_to(const Pose2d& goal) {
  require_finite(goal.x, goal.y, goal.heading);
  wish_ = DriveTo{goal};
}

void TeamRobot::set_velocity(const FieldVelocity& velocity) {
  require_finite(velocity.x, velocity.y, velocity.w);
  wish_ = velocity;
}

void TeamRobot::go_to(const Pose2d& goal) {
  require_finite(goal.x, goal.y, goal.heading);
  const auto* known = std::get_if<GoTo>(&wish_);
  if (known != nullptr && known->goal == goal) return;
  wish_ = GoTo{goal};
  if (!connected()) return;
  base_.go_to(goal);
  tried_ = Clock::now();
}

/// Of a destination that somebody's stop has ended. A stock server would not have told.
void TeamRobot::remind(const Pose2d& goal, Time now) {
  const player::Motion* motion = base_.told_motion();
  const bool drives = motion != nullptr && motion->state == player::MotionState::driving;
  if (drives || !robot_.connection().extended() || !may_command(now)) return;
  try {
    base_.go_to(goal);
  } catch (const client::Error&) {
    ++unsent_;
  }
}

std::string TeamRobot::stopped_because() const {
  const player::Motion* motion = base_.told_motion();
  if (motion == nullptr || motion->state == player::MotionState::driving) return {};
  return std::string{motion->reason.view()};
}

/// While it drives for us, always. Else one attempt in a while: who was stopped must pause for a lease, and by HALT
/// nobody gets round.
bool TeamRobot::may_command(const client::ProxyBase& device, std::string_view group, Time& tried, Time now) const {
  if (!connected()) return false;
  if (!robot_.connection().extended()) return true;
  const player::Motion* motion = device.told_motion(group);
  if (motion != nullptr && motion->state == player::MotionState::driving && motion->owner.view() == owner_) return true;
  const Duration pause = (motion != nullptr ? from_seconds(motion->lease_s) : vision_silent) + retry_margin;
  if (now - tried < pause) return false;
  tried = now;
  return true;
}

void TeamRobot::dribble(double speed_radps) {
  require_finite(speed_radps, 0, 0);
  kicker().dribble(static_cast<float>(speed_radps));
  dribble_radps_ = speed_radps;
  dribbled_ = tried_to_dribble_ = Clock::now();
}

/// Its lease ends like that of a velocity.
void TeamRobot::keep_dribbling(Time now) {
  if (dribble_radps_ == 0 || now - dribbled_ < dribble_period || !connected()) return;
  client::KickerProxy& device = kicker();
  if (!may_command(device, "dribbler", tried_to_dribble_, now)) return;
  dribbled_ = now;
  try {
    device.dribble(static_cast<float>(dribble_radps_));
  } catch (const client::Error&) {
    ++unsent_;
  }
}

// -- All of them

Team::Team(const std::filesystem::path& config, ssl::Team team, const TeamOptions& options)
    : options_{options}, avoidance_{avoidance_config(options)} {
  if (!(options.turn_rate_radps > 0) || !(options.gain > 0))
    throw std::invalid_argument{"turn_rate_radps and gain must be above 0"};
  if (options_.name.empty()) options_.name = team == ssl::Team::yellow ? "yellow team" : "blue team";
  const vision::BridgeConfig file = vision::read_bridge_config(config);
  const bool tracked = file.input == vision::BridgeConfig::Input::tracked;
  if (tracked || !file.publish.empty()) vision_.emplace(file.tracked, tracked ? file.interfaces : file.publish);
  tracker_ = tracked ? file.tracker : vision::bridge_name;
  for (const vision::RobotAddress& address : file.robots) {
    if (address.id.team != team) continue;
    client::Robot& robot =
        connections_.add(address.host, address.port,
                         client::Options{.name = options_.name, .priority = options_.priority, .reconnect = true});
    robots_.push_back(TeamRobot{address.id, robot, options_.name});
  }
}

TeamRobot& Team::operator[](int number) {
  const auto found =
      std::ranges::find_if(robots_, [&](const TeamRobot& robot) { return std::cmp_equal(robot.id_.number, number); });
  if (found == robots_.end())
    throw std::out_of_range{"no robot " + std::to_string(number) + " of this team in the configuration"};
  return *found;
}

bool Team::read(Duration timeout) {
  const Time until = Clock::now() + std::min<Duration>(timeout, 24h);
  for (;;) {
    const bool heard = hear();
    const Time now = Clock::now();
    if (now - steered_ >= steer_period) steer(now);
    const Time wake = std::min(until, steered_ + steer_period);
    const bool any = connections_.read(heard ? 0ms : std::max(wake - Clock::now(), Duration{})) || heard;
    if (any || Clock::now() >= until) return any;
  }
}

/// The newest frame of the tracker to believe; of several of that name, of the one that was heard first.
bool Team::hear() {
  if (!vision_) return false;
  bool any = false;
  while (const auto datagram = vision_->receive()) {
    auto frame = ssl::decode_tracked(datagram->bytes);
    if (!frame || (!tracker_.empty() && frame->source_name != tracker_)) continue;
    if (frame->uuid != frame_.uuid && seen_age() < vision_silent) continue;
    frame_ = *std::move(frame);
    heard_ = Clock::now();
    any = true;
  }
  return any;
}

Duration Team::seen_age() const { return heard_ ? Clock::now() - *heard_ : Duration::max(); }

std::span<const ssl::TrackedRobot> Team::seen() const {
  return seen_age() < vision_silent ? std::span{frame_.robots} : std::span<const ssl::TrackedRobot>{};
}

std::optional<ssl::TrackedRobot> Team::seen(ssl::RobotId id) const {
  const auto robots = seen();
  const auto found = std::ranges::find(robots, id, &ssl::TrackedRobot::id);
  return found == robots.end() ? std::nullopt : std::optional{*found};
}

std::optional<ssl::TrackedBall> Team::ball() const {
  return seen_age() < vision_silent && !frame_.balls.empty() ? std::optional{frame_.balls.front()} : std::nullopt;
}

/// What the robot would like, had it the field for itself. Towards a destination: no faster than it can brake, and at
/// last in proportion to the way that is left.
FieldVelocity Team::preferred(const TeamRobot& robot, const Pose2d& here) const {
  if (const auto* velocity = std::get_if<FieldVelocity>(&robot.wish_)) return *velocity;
  const Pose2d& goal = std::get<TeamRobot::DriveTo>(robot.wish_).goal;
  const double left_m = distance(here, goal);
  const double speed = std::min(
      {options_.speed_mps, options_.gain * left_m, std::sqrt(2 * braking * options_.acceleration_mps2 * left_m)});
  const double share = left_m > 0 ? speed / left_m : 0;
  const double turn = options_.gain * angle_between(here.heading, goal.heading);
  return {.x = share * (goal.x - here.x),
          .y = share * (goal.y - here.y),
          .w = std::clamp(turn, -options_.turn_rate_radps, options_.turn_rate_radps)};
}

void Team::steer(Time now) {
  const Duration dt = std::min<Duration>(now - steered_, 5 * steer_period);
  steered_ = now;
  const bool fresh = seen_age() < vision_late;
  const double ahead_s = fresh ? seconds(seen_age()) : 0;

  struct Steered {
    TeamRobot* robot;
    Pose2d here;
    FieldVelocity velocity;
  };
  std::vector<Steered> steered;
  std::vector<control::Disc> discs;  // of all that vision shows; those of `steered` come first, in its order
  std::vector<control::Disc> others;
  for (const ssl::TrackedRobot& seen : this->seen()) {
    const FieldVelocity velocity = seen.velocity.value_or(FieldVelocity{});
    const Pose2d here{.x = seen.pose.x + ahead_s * velocity.x,
                      .y = seen.pose.y + ahead_s * velocity.y,
                      .heading = wrap_angle(seen.pose.heading + ahead_s * velocity.w)};
    control::Disc disc{.x = here.x, .y = here.y, .velocity = velocity, .radius_m = robot_radius_m};
    const auto ours = std::ranges::find(robots_, seen.id, &TeamRobot::id_);
    const bool is_steered = fresh && ours != robots_.end() && ours->wish_.index() != 0 &&
                            !std::holds_alternative<TeamRobot::GoTo>(ours->wish_);
    if (!is_steered) {
      others.push_back(disc);
      continue;
    }
    // Where it is commanded to go: its measured velocity lags behind, and would slow it down.
    disc.velocity = ours->commanded_;
    disc.cooperates = true;
    discs.push_back(disc);
    steered.push_back({.robot = &*ours, .here = here, .velocity = velocity});
  }
  const std::size_t count = steered.size();
  discs.insert(discs.end(), others.begin(), others.end());

  // All decide on what was before, and then all move.
  for (std::size_t i = 0; i < count; ++i) {
    std::swap(discs[0], discs[i]);
    const auto output =
        avoidance_.step(discs[0], preferred(*steered[i].robot, steered[i].here),
                        std::span{discs}.subspan(1).first(std::min(discs.size() - 1, avoidance_.capacity)), dt);
    std::swap(discs[0], discs[i]);
    steered[i].velocity = output.velocity;
  }
  for (auto& [robot, here, velocity] : steered) {
    robot->commanded_ = {};
    if (!robot->may_command(now)) continue;
    try {
      robot->base_.set_velocity(to_body(velocity, here.heading));
      robot->commanded_ = velocity;
    } catch (const client::Error&) {  // it takes no bytes: the others go on, and its lease stops it
      ++robot->unsent_;
    }
  }
  for (TeamRobot& robot : robots_) {
    if (const auto* own = std::get_if<TeamRobot::GoTo>(&robot.wish_)) robot.remind(own->goal, now);
    robot.keep_dribbling(now);
  }
}

}  // namespace regista::soccer
