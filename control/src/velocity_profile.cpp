// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <regista/control/velocity_profile.hpp>

#include "parameter.hpp"

namespace regista::control {
namespace {

/// One quickest move, seen so that its goal lies ahead: mirrored when the way from the start velocity to the final one
/// at full acceleration would already lead too far.
struct Move {
  double distance;
  double v0;
  double v1;
  double sign;
};

/// What it covers to change from one velocity to another.
double ramp_distance(double from, double to, double acceleration) {
  return 0.5 * (from + to) * std::abs(to - from) / acceleration;
}

Move mirrored(const AxisState& start, const AxisState& goal, double acceleration) {
  const double distance = goal.position - start.position;
  const double sign = distance < ramp_distance(start.velocity, goal.velocity, acceleration) ? -1 : 1;
  return {.distance = sign * distance, .v0 = sign * start.velocity, .v1 = sign * goal.velocity, .sign = sign};
}

struct Cruise {
  double velocity;
  double duration_s;  ///< of the whole move
};

// Up (or down from above the limit) to the cruising velocity u and down to v1. Without a limit the two ramps meet at
// u² = a d + (v0² + v1²)/2. The five cases of Holtzhausen (away from the goal; speed up; cruise; slow down; too fast)
// are the signs and zeros of the phases that come out.
Cruise quickest_cruise(const Move& move, const AxisLimits& limits) {
  const auto& [distance, v0, v1, sign] = move;
  const double a = limits.acceleration;
  const double peak_squared = a * distance + 0.5 * (v0 * v0 + v1 * v1);
  if (peak_squared <= limits.speed * limits.speed) {
    const double peak = std::max({std::sqrt(std::max(peak_squared, 0.0)), v0, v1});
    return {.velocity = peak, .duration_s = (2 * peak - v0 - v1) / a};
  }
  const double u = limits.speed;
  const double rest = distance - ramp_distance(v0, u, a) - ramp_distance(u, v1, a);
  return {.velocity = u, .duration_s = (std::abs(u - v0) + std::abs(v1 - u)) / a + std::max(rest, 0.0) / u};
}

double quickest_duration(const AxisState& start, const AxisState& goal, const AxisLimits& limits) {
  return quickest_cruise(mirrored(start, goal, limits.acceleration), limits).duration_s;
}

/// Nothing to do, for as long as one likes.
bool rests(const AxisState& start, const AxisState& goal) {
  return start.position == goal.position && start.velocity == 0 && goal.velocity == 0;
}

}  // namespace

AxisProfile::AxisProfile(const AxisState& start, double cruise_velocity, double final_velocity, double acceleration,
                         double duration_s)
    : start_position_{start.position},
      start_velocity_{start.velocity},
      acceleration_{std::copysign(acceleration, cruise_velocity - start.velocity)},
      cruise_from_s_{std::abs(cruise_velocity - start.velocity) / acceleration},
      cruise_velocity_{cruise_velocity},
      cruise_until_s_{std::max(duration_s - std::abs(final_velocity - cruise_velocity) / acceleration, cruise_from_s_)},
      final_acceleration_{std::copysign(acceleration, final_velocity - cruise_velocity)},
      end_s_{duration_s},
      final_velocity_{final_velocity} {}

AxisProfile AxisProfile::quickest(const AxisState& start, const AxisState& goal, const AxisLimits& limits) {
  if (rests(start, goal)) return AxisProfile{start.position};
  const Move move = mirrored(start, goal, limits.acceleration);
  const Cruise cruise = quickest_cruise(move, limits);
  return {start, move.sign * cruise.velocity, goal.velocity, limits.acceleration, cruise.duration_s};
}

std::optional<AxisProfile> AxisProfile::lasting(double duration_s, const AxisState& start, const AxisState& goal,
                                                const AxisLimits& limits) {
  if (rests(start, goal)) {
    AxisProfile profile{start.position};
    profile.end_s_ = duration_s;
    return profile;
  }
  const double a = limits.acceleration;
  const auto [distance, v0, v1, sign] = mirrored(start, goal, a);
  // distance = ramps(u) + u (duration - time of ramps(u)), solved for the cruising velocity u
  const double reach = a * distance + 0.5 * (v0 * v0 + v1 * v1);
  const double sum = a * duration_s + v0 + v1;
  // above both velocities: u² - sum u + reach = 0, the smaller root
  const double above = 2 * reach / (sum + std::sqrt(std::max(sum * sum - 4 * reach, 0.0)));
  // between them: linear
  const double between = (distance - ramp_distance(v0, v1, a)) / (duration_s - std::abs(v1 - v0) / a);
  // below both, even backwards: u² + difference u - dip = 0; a negative discriminant is a duration out of reach
  const double difference = a * duration_s - v0 - v1;
  const double dip = a * distance - 0.5 * (v0 * v0 + v1 * v1);
  const double below = 0.5 * (std::sqrt(difference * difference + 4 * dip) - difference);
  for (const double u : {above, between, below}) {
    const double ramps_s = (std::abs(u - v0) + std::abs(v1 - u)) / a;
    const double covered = ramp_distance(v0, u, a) + ramp_distance(u, v1, a) + u * (duration_s - ramps_s);
    if (std::abs(u) <= limits.speed * (1 + 1e-12) && ramps_s <= duration_s * (1 + 1e-12) &&
        std::abs(covered - distance) <= 1e-12 * (1 + std::abs(distance))) {
      return AxisProfile{start, sign * u, goal.velocity, a, duration_s};
    }
  }
  return std::nullopt;
}

MotionPlan::MotionPlan(const Pose2d& pose)
    : start_x_{.position = pose.x},
      start_y_{.position = pose.y},
      x_{pose.x},
      y_{pose.y},
      heading_{wrap_angle(pose.heading)} {}

namespace {

AxisState after(const AxisState& start, double acceleration, double time_s) {
  return {.position = start.position + (start.velocity + 0.5 * acceleration * time_s) * time_s,
          .velocity = start.velocity + acceleration * time_s};
}

}  // namespace

MotionState MotionPlan::at(Duration since_start) const {
  const double time_s = std::max(seconds(since_start), 0.0);
  const double led_s = brake_.duration_s + turn_in_.duration_s;
  AxisState x;
  AxisState y;
  if (time_s >= led_s) {
    x = x_.at(time_s - led_s);
    y = y_.at(time_s - led_s);
  } else {
    const double braked_s = std::min(time_s, brake_.duration_s);
    x = after(after(start_x_, brake_.acceleration_x, braked_s), turn_in_.acceleration_x, time_s - braked_s);
    y = after(after(start_y_, brake_.acceleration_y, braked_s), turn_in_.acceleration_y, time_s - braked_s);
  }
  const AxisState turn = heading_.at(time_s);
  const bool wrapped = turn.position > -std::numbers::pi && turn.position <= std::numbers::pi;
  return {.pose = {.x = x.position, .y = y.position, .heading = wrapped ? turn.position : wrap_angle(turn.position)},
          .velocity = {.x = x.velocity, .y = y.velocity, .w = turn.velocity}};
}

double MotionPlan::duration_s() const {
  return std::max(brake_.duration_s + turn_in_.duration_s + std::max(x_.duration_s(), y_.duration_s()),
                  heading_.duration_s());
}

std::array<double, 8> MotionPlan::switches_s() const {
  const double led_s = brake_.duration_s + turn_in_.duration_s;
  std::array<double, 8> all{brake_.duration_s, led_s};
  for (std::size_t i = 0; i < 3; ++i) {
    all[2 + i] = led_s + x_.switches_s()[i];
    all[5 + i] = led_s + y_.switches_s()[i];
  }
  return all;
}

namespace {

/// x and y of a move on the field.
struct Plane {
  AxisState x;
  AxisState y;
};

/// Where the velocity is taken in a straight line, before the axes go their ways.
enum class LeadTo { nowhere, split, rest };

/// One way to divide the limits between the axes, and how long they then take.
struct Division {
  double lead_s = 0;
  double lead_acceleration_x = 0;
  double lead_acceleration_y = 0;
  Plane start;  ///< after the lead
  AxisLimits x_limits;
  AxisLimits y_limits;
  double x_s = 0;
  double y_s = 0;

  [[nodiscard]] double duration_s() const { return lead_s + std::max(x_s, y_s); }
};

class SplitSearch {
 public:
  SplitSearch(const Plane& start, const Plane& goal, const MotionLimits& limits, LeadTo lead_to)
      : start_{start}, goal_{goal}, speed_{limits.speed_mps}, acceleration_{limits.acceleration_mps2}, to_{lead_to} {}

  /// The quickest division. The duration of x grows with α and that of y falls, so where they are equal the later of
  /// the two is least. The unknown is log tan α, in which log(x_s / y_s) is nearly a line of slope 1/2 to 1, so that a
  /// secant takes four steps where bisection takes thirty.
  [[nodiscard]] Division best() const {
    if (rests(start_.y, goal_.y)) return divide(1, 0);
    if (rests(start_.x, goal_.x)) return divide(0, 1);

    // α for which the goal's velocity is within the limits of both axes
    const double v = speed_;
    double low = log_ratio(std::abs(goal_.y.velocity), root_of_difference(v, goal_.y.velocity));
    double high = log_ratio(root_of_difference(v, goal_.x.velocity), std::abs(goal_.x.velocity));
    double low_h = 0;
    double high_h = 0;
    bool low_known = false;
    bool high_known = false;
    double z = std::clamp(log_ratio(need(start_.y, goal_.y), need(start_.x, goal_.x)), low, std::max(low, high));
    double at_least = 0;  // no α is quicker than this
    Division best;
    double best_s = std::numeric_limits<double>::infinity();
    int side = 0;
    for (int i = 0; i < 40; ++i) {
      const double tangent = std::exp(z);
      const double cosine = 1 / std::sqrt(1 + tangent * tangent);
      const Division now = divide(cosine, tangent * cosine);
      if (now.duration_s() < best_s) {
        best = now;
        best_s = now.duration_s();
      }
      at_least = std::max(at_least, now.lead_s + std::min(now.x_s, now.y_s));
      if (best_s - at_least <= 1e-10 * (1 + best_s)) break;

      const double h = std::log((now.x_s + tiny) / (now.y_s + tiny));
      if (h < 0) {
        if (low_known && side < 0) high_h *= 0.5;  // Illinois: the end that stays loses weight
        low = z;
        low_h = h;
        low_known = true;
        side = -1;
      } else {
        if (high_known && side > 0) low_h *= 0.5;
        high = z;
        high_h = h;
        high_known = true;
        side = 1;
      }
      if (high - low <= 1e-15 * std::abs(z)) break;
      if (low_known && high_known) {
        z = low - low_h * (high - low) / (high_h - low_h);
        if (!(z > low && z < high)) z = 0.5 * (low + high);
      } else {
        const double step = -h / 0.75 * (1 + i);
        if (z == (h < 0 ? high : low)) break;  // the goal's velocity forbids to go on
        z = std::clamp(z + step, low, high);
      }
    }
    return best;
  }

 private:
  static constexpr double tiny = 1e-300;

  static double root_of_difference(double hypotenuse, double leg) {
    return std::sqrt(std::max((hypotenuse - std::abs(leg)) * (hypotenuse + std::abs(leg)), 0.0));
  }

  /// log(a / b), kept where e to it and its square are finite.
  static double log_ratio(double a, double b) { return std::clamp(std::log((a + tiny) / (b + tiny)), -80.0, 80.0); }

  /// What an axis asks of its acceleration, roughly.
  [[nodiscard]] double need(const AxisState& start, const AxisState& goal) const {
    return std::abs(goal.position - start.position) + 0.5 * start.velocity * start.velocity / acceleration_;
  }

  [[nodiscard]] Division divide(double cosine, double sine) const {
    Division division{.start = start_,
                      .x_limits = {.speed = speed_ * cosine, .acceleration = acceleration_ * cosine},
                      .y_limits = {.speed = speed_ * sine, .acceleration = acceleration_ * sine}};
    if (to_ != LeadTo::nowhere) lead(division);
    const Plane& from = division.start;
    if (!rests(from.x, goal_.x)) division.x_s = quickest_duration(from.x, goal_.x, division.x_limits);
    if (!rests(from.y, goal_.y)) division.y_s = quickest_duration(from.y, goal_.y, division.y_limits);
    return division;
  }

  void lead(Division& division) const {
    const AxisState& x = start_.x;
    const AxisState& y = start_.y;
    const double to_x = to_ == LeadTo::rest
                            ? 0
                            : std::clamp(x.velocity, -division.x_limits.speed, division.x_limits.speed);
    const double to_y = to_ == LeadTo::rest
                            ? 0
                            : std::clamp(y.velocity, -division.y_limits.speed, division.y_limits.speed);
    const double change = std::hypot(to_x - x.velocity, to_y - y.velocity);
    if (change == 0) return;
    division.lead_s = change / acceleration_;
    division.lead_acceleration_x = acceleration_ * (to_x - x.velocity) / change;
    division.lead_acceleration_y = acceleration_ * (to_y - y.velocity) / change;
    division.start = {.x = {.position = after(x, division.lead_acceleration_x, division.lead_s).position, .velocity = to_x},
                      .y = {.position = after(y, division.lead_acceleration_y, division.lead_s).position, .velocity = to_y}};
  }

  Plane start_;
  Plane goal_;
  double speed_;
  double acceleration_;
  LeadTo to_;
};

// The quickest of the turns that end at the same heading: those that reach just beyond and just short of where the
// change of turn rate alone would lead.
AxisProfile quickest_turn(const MotionState& start, const MotionState& goal, const AxisLimits& limits) {
  constexpr double turn = 2 * std::numbers::pi;
  const AxisState from{.position = wrap_angle(start.pose.heading), .velocity = start.velocity.w};
  const double swing = ramp_distance(start.velocity.w, goal.velocity.w, limits.acceleration);
  const double way = angle_between(start.pose.heading, goal.pose.heading);
  const double beyond = way + turn * std::ceil((swing - way) / turn);
  const auto to = [&](double angle) {
    return AxisProfile::quickest(from, {.position = from.position + angle, .velocity = goal.velocity.w}, limits);
  };
  const AxisProfile left = to(beyond);
  const AxisProfile right = to(beyond - turn);
  return left.duration_s() <= right.duration_s() ? left : right;
}

bool all_sane(const MotionState& state) {
  return sane(state.pose.x) && sane(state.pose.y) && sane(state.pose.heading) && sane(state.velocity.x) &&
         sane(state.velocity.y) && sane(state.velocity.w);
}

}  // namespace

MotionPlanner::MotionPlanner(const MotionLimits& limits) : limits_{limits} {
  require_positive("speed_mps", limits.speed_mps);
  require_positive("acceleration_mps2", limits.acceleration_mps2);
  require_positive("turn_rate_radps", limits.turn_rate_radps);
  require_positive("turn_acceleration_radps2", limits.turn_acceleration_radps2);
}

std::optional<MotionPlan> MotionPlanner::plan(const MotionState& start, const MotionState& goal) const {
  const double v_max = limits_.speed_mps;
  if (!all_sane(start) || !all_sane(goal) || std::hypot(goal.velocity.x, goal.velocity.y) > v_max ||
      std::abs(goal.velocity.w) > limits_.turn_rate_radps) {
    return std::nullopt;
  }
  MotionPlan plan;
  plan.start_x_ = {.position = start.pose.x, .velocity = start.velocity.x};
  plan.start_y_ = {.position = start.pose.y, .velocity = start.velocity.y};
  plan.heading_ = quickest_turn(
      start, goal, {.speed = limits_.turn_rate_radps, .acceleration = limits_.turn_acceleration_radps2});

  Plane from{.x = plan.start_x_, .y = plan.start_y_};
  const Plane to{.x = {.position = goal.pose.x, .velocity = goal.velocity.x},
                 .y = {.position = goal.pose.y, .velocity = goal.velocity.y}};
  const double speed = std::hypot(start.velocity.x, start.velocity.y);
  if (speed > v_max) {
    plan.brake_ = {.duration_s = (speed - v_max) / limits_.acceleration_mps2,
                   .acceleration_x = -limits_.acceleration_mps2 * start.velocity.x / speed,
                   .acceleration_y = -limits_.acceleration_mps2 * start.velocity.y / speed};
    from.x = after(from.x, plan.brake_.acceleration_x, plan.brake_.duration_s);
    from.y = after(from.y, plan.brake_.acceleration_y, plan.brake_.duration_s);
  }

  // The published split first. It may speed up beyond the vector limit when the start is too fast for one axis's
  // share: then the velocity is first taken into the shares, in a straight line, which keeps both limits. Only goals
  // in motion may still be out of reach together; from rest, every goal is within reach at every later time.
  for (const LeadTo lead_to : {LeadTo::nowhere, LeadTo::split, LeadTo::rest}) {
    const Division split = SplitSearch{from, to, limits_, lead_to}.best();
    const bool x_is_later = split.x_s >= split.y_s;
    const double together_s = std::max(split.x_s, split.y_s);
    const auto& [x, y] = split.start;
    const auto earlier = x_is_later ? AxisProfile::lasting(together_s, y, to.y, split.y_limits)
                                    : AxisProfile::lasting(together_s, x, to.x, split.x_limits);
    if (!earlier) continue;
    plan.turn_in_ = {.duration_s = split.lead_s,
                     .acceleration_x = split.lead_acceleration_x,
                     .acceleration_y = split.lead_acceleration_y};
    plan.x_ = x_is_later ? AxisProfile::quickest(x, to.x, split.x_limits) : *earlier;
    plan.y_ = x_is_later ? *earlier : AxisProfile::quickest(y, to.y, split.y_limits);
    const bool within_shares =
        std::abs(x.velocity) <= split.x_limits.speed && std::abs(y.velocity) <= split.y_limits.speed;
    if (lead_to != LeadTo::nowhere || within_shares) return plan;

    // Between two switches the square of the speed is a convex parabola of time: it is largest at one of them.
    const auto too_fast = [&](double time_s) {
      return std::hypot(plan.x_.at(time_s).velocity, plan.y_.at(time_s).velocity) > v_max * (1 + 1e-9);
    };
    const auto x_switches = plan.x_.switches_s();
    const auto y_switches = plan.y_.switches_s();
    if (std::none_of(x_switches.begin(), x_switches.end(), too_fast) &&
        std::none_of(y_switches.begin(), y_switches.end(), too_fast)) {
      return plan;
    }
  }
  return std::nullopt;
}

}  // namespace regista::control
