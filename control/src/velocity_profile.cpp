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

constexpr double tiny = 1e-300;  // keeps a quotient of zeros from being NaN

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
  double velocity;    ///< in the direction of the axis
  double duration_s;  ///< of the whole move
  double slope_s;     ///< of the duration, over the logarithm of a factor on both limits
};

// Up (or down from above the limit) to the cruising velocity u and down to v1. Without a limit the two ramps meet at
// u² = a d + (v0² + v1²)/2. The five cases of Holtzhausen (away from the goal; speed up; cruise; slow down; too fast)
// are the signs and zeros of the phases that come out.
[[gnu::always_inline]] inline Cruise quickest_cruise(const AxisState& start, const AxisState& goal,
                                                     const AxisLimits& limits) {
  const auto [distance, v0, v1, sign] = mirrored(start, goal, limits.acceleration);
  const double a = limits.acceleration;
  const double peak_squared = a * distance + 0.5 * (v0 * v0 + v1 * v1);
  if (peak_squared <= limits.speed * limits.speed) {
    const double faster_end = std::max(v0, v1);
    const double peak = std::max(std::sqrt(std::max(peak_squared, 0.0)), faster_end);
    const double duration_s = (2 * peak - v0 - v1) / a;
    return {.velocity = sign * peak, .duration_s = duration_s, .slope_s = distance / (peak + tiny) - duration_s};
  }
  const double u = limits.speed;
  const double up = std::abs(u - v0);
  const double down = std::abs(v1 - u);
  // up/a + down/a + (distance - ramps)/u, gathered
  const double way = a * distance;
  const double lost = up * (u - v0) + down * (u - v1);
  const double inverse = 1 / (a * u);
  return {.velocity = sign * u,
          .duration_s = (way + 0.5 * lost) * inverse,
          .slope_s = ((up + down) * u - way - lost) * inverse};
}

/// Beyond the limit in the same direction at both ends.
bool passes_too_fast(const AxisState& start, const AxisState& goal, const AxisLimits& limits) {
  return start.velocity * goal.velocity > 0 &&
         std::min(std::abs(start.velocity), std::abs(goal.velocity)) > limits.speed;
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
  const Cruise cruise = quickest_cruise(start, goal, limits);
  return {start, cruise.velocity, goal.velocity, limits.acceleration, cruise.duration_s};
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
  const double rounding = 1e-12 * (1 + std::abs(distance) + (v0 * v0 + v1 * v1) / a);
  const auto lasts = [&](double& u) {
    u = std::clamp(u, -limits.speed, limits.speed);  // a double root has lost half of its digits
    const double ramps_s = (std::abs(u - v0) + std::abs(v1 - u)) / a;
    const double covered = ramp_distance(v0, u, a) + ramp_distance(u, v1, a) + u * (duration_s - ramps_s);
    return ramps_s <= duration_s * (1 + 1e-12) && std::abs(covered - distance) <= rounding;
  };
  // above both velocities: u² - sum u + reach = 0, the smaller root
  double u = 2 * reach / (sum + std::sqrt(std::max(sum * sum - 4 * reach, 0.0)));
  if (!lasts(u)) {
    // between them: linear
    u = (distance - ramp_distance(v0, v1, a)) / (duration_s - std::abs(v1 - v0) / a);
    if (!lasts(u)) {
      // below both, even backwards: u² + difference u - dip = 0; a negative discriminant is a duration out of reach
      const double difference = a * duration_s - v0 - v1;
      const double dip = a * distance - 0.5 * (v0 * v0 + v1 * v1);
      u = 0.5 * (std::sqrt(difference * difference + 4 * dip) - difference);
      if (!lasts(u)) return std::nullopt;
    }
  }
  return AxisProfile{start, sign * u, goal.velocity, a, duration_s};
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

/// Without the care for overflow of std::hypot, which no sane number needs.
double length(double x, double y) { return std::sqrt(x * x + y * y); }

/// Where the velocity is taken in a straight line, before the axes go their ways.
enum class LeadTo { nowhere, split, rest };

/// The limits shared between the axes at an angle α, and how long the lead then takes and each axis.
struct Split {
  double cosine = 1;
  double sine = 0;
  double lead_s = 0;
  Cruise x{};
  Cruise y{};

  [[nodiscard]] double duration_s() const { return lead_s + std::max(x.duration_s, y.duration_s); }
};

/// Constant acceleration of x and y, and where it ends.
struct Led {
  double duration_s = 0;
  double acceleration_x = 0;
  double acceleration_y = 0;
  Plane end;
};

struct Translation {
  Led led;
  AxisProfile x;
  AxisProfile y;

  [[nodiscard]] double duration_s() const { return led.duration_s + x.duration_s(); }
};

}  // namespace

class SplitSearch {
 public:
  SplitSearch(const Plane& start, const Plane& goal, const MotionLimits& limits, LeadTo lead_to)
      : start_{start}, goal_{goal}, speed_{limits.speed_mps}, acceleration_{limits.acceleration_mps2}, to_{lead_to} {}

  [[nodiscard]] Split split(double cosine, double sine) const {
    if (to_ == LeadTo::nowhere) return split(cosine, sine, start_, 0);
    const Led led = lead(cosine, sine);
    return split(cosine, sine, led.end, led.duration_s);
  }

  /// The duration of x grows with α and that of y falls, so where they are equal the later of the two is least. The
  /// unknown is z = log tan α: the logarithm of their ratio is nearly a line in it, so that Newton's method takes four
  /// steps where bisection takes thirty. Brackets guard it.
  [[nodiscard]] Split best() const {
    if (rests(start_.y, goal_.y)) return split(1, 0);
    if (rests(start_.x, goal_.x)) return split(0, 1);

    // α for which the goal's velocity is within the limits of both axes
    const double gx = std::abs(goal_.x.velocity);
    const double gy = std::abs(goal_.y.velocity);
    double low = gy == 0 ? -80 : log_ratio(gy, other_leg(speed_, gy));
    double high = gx == 0 ? 80 : std::max(log_ratio(other_leg(speed_, gx), gx), low);
    double z = std::clamp(log_ratio(need(start_.y, goal_.y), need(start_.x, goal_.x)), low, high);
    bool low_known = false;
    bool high_known = false;
    double at_least = 0;  // no α is quicker than this
    double last_z = z;
    double last_error = std::numeric_limits<double>::infinity();
    double best_s = std::numeric_limits<double>::infinity();
    Split best;
    for (int i = 0; i < 60; ++i) {
      const double tangent = std::exp(z);
      const double cosine = 1 / std::sqrt(1 + tangent * tangent);
      const Split now = split(cosine, tangent * cosine);
      if (now.duration_s() < best_s) {
        best = now;
        best_s = now.duration_s();
      }
      const double x_s = now.x.duration_s + tiny;
      const double y_s = now.y.duration_s + tiny;
      at_least = std::max(at_least, now.lead_s + std::min(x_s, y_s));
      const double to_gain_s = best_s - at_least;
      if (to_gain_s <= 5e-8) break;

      const double error = log_of_ratio(x_s, y_s);
      if (z == (error < 0 ? high : low)) break;  // the goal's velocity forbids to go on
      (error < 0 ? low : high) = z;
      (error < 0 ? low_known : high_known) = true;
      const bool slow = std::abs(error) > 0.25 * std::abs(last_error);
      // Where an axis can only just stop in time, its duration goes with a square root: rounding forbids to come
      // nearer.
      if (slow && to_gain_s <= 1e-7) break;
      double slope = -now.sine * now.sine * now.x.slope_s / x_s - now.cosine * now.cosine * now.y.slope_s / y_s;
      if (slow) slope = (error - last_error) / (z - last_z);  // the lead is not in the slope: take the secant
      double next = std::clamp(z - error / std::max(slope, 0.1), low, high);
      if (slow && low_known && high_known) next = 0.5 * (low + high);
      if (next == z) break;
      last_z = z;
      z = next;
      last_error = error;
    }
    return best;
  }

  /// Whether a split other than `best()` may take less than `duration_s` to a goal at rest. With a share too small for
  /// its start velocity an axis takes less time the smaller the share, until it only just stops in time, after 2 d /
  /// v0. The derivative of the duration says when: a d > v0 v_max.
  [[nodiscard]] bool another_may_be_quicker(double duration_s) const {
    const auto dips = [&](const AxisState& start, const AxisState& goal) {
      const double distance = (goal.position - start.position) * (start.velocity < 0 ? -1 : 1);
      const double v0 = std::abs(start.velocity);
      return acceleration_ * distance > v0 * speed_ && 2 * distance < duration_s * v0;
    };
    return dips(start_.x, goal_.x) || dips(start_.y, goal_.y);
  }

  /// The published split: α halved from 45° towards the axis that ends later, until they end within a millisecond.
  [[nodiscard]] Split published() const {
    double cosine_of_step = std::sqrt(0.5);
    double sine_of_step = cosine_of_step;
    Split now = split(cosine_of_step, sine_of_step);
    while (sine_of_step > 1e-7 && std::abs(now.x.duration_s - now.y.duration_s) >= 1e-3) {
      const double twice = 2 * std::sqrt(0.5 * (1 + cosine_of_step));  // the cosine of half the step
      sine_of_step /= twice;
      cosine_of_step = 0.5 * twice;
      const double turned = now.x.duration_s > now.y.duration_s ? -sine_of_step : sine_of_step;
      now = split(now.cosine * cosine_of_step - now.sine * turned, now.sine * cosine_of_step + now.cosine * turned);
    }
    return now;
  }

  /// Both axes at once, for as long as the later needs. Empty when one is beyond its share at both ends, when the
  /// earlier cannot last so long, or when together they are too fast on the way.
  [[nodiscard]] std::optional<Translation> translation(const Split& split) const {
    const Led led = lead(split.cosine, split.sine);
    const auto& [x, y] = led.end;
    const AxisLimits x_limits = limits_of(split.cosine);
    const AxisLimits y_limits = limits_of(split.sine);
    if (passes_too_fast(x, goal_.x, x_limits) || passes_too_fast(y, goal_.y, y_limits)) return std::nullopt;
    const bool x_is_later = split.x.duration_s >= split.y.duration_s;
    const auto earlier = x_is_later ? AxisProfile::lasting(split.x.duration_s, y, goal_.y, y_limits)
                                    : AxisProfile::lasting(split.y.duration_s, x, goal_.x, x_limits);
    if (!earlier) return std::nullopt;
    const AxisProfile later =
        x_is_later ? AxisProfile{x, split.x.velocity, goal_.x.velocity, x_limits.acceleration, split.x.duration_s}
                   : AxisProfile{y, split.y.velocity, goal_.y.velocity, y_limits.acceleration, split.y.duration_s};
    const Translation together{.led = led, .x = x_is_later ? later : *earlier, .y = x_is_later ? *earlier : later};
    const bool within_shares = std::max(std::abs(x.velocity), std::abs(goal_.x.velocity)) <= x_limits.speed &&
                               std::max(std::abs(y.velocity), std::abs(goal_.y.velocity)) <= y_limits.speed;
    if (within_shares) return together;

    // Between two switches the square of the speed is a convex parabola of time: it is largest at one of them.
    const auto too_fast = [&](double time_s) {
      return length(together.x.at(time_s).velocity, together.y.at(time_s).velocity) > speed_ * (1 + 1e-9);
    };
    const auto x_switches = together.x.switches_s();
    const auto y_switches = together.y.switches_s();
    if (std::any_of(x_switches.begin(), x_switches.end(), too_fast) ||
        std::any_of(y_switches.begin(), y_switches.end(), too_fast)) {
      return std::nullopt;
    }
    return together;
  }

 private:
  /// The straight line in velocity space, at full acceleration, to where the lead ends.
  [[nodiscard]] Led lead(double cosine, double sine) const {
    const double share_x = to_ == LeadTo::rest ? 0 : speed_ * cosine;
    const double share_y = to_ == LeadTo::rest ? 0 : speed_ * sine;
    const AxisState& x = start_.x;
    const AxisState& y = start_.y;
    const double to_x = std::clamp(x.velocity, -share_x, share_x);
    const double to_y = std::clamp(y.velocity, -share_y, share_y);
    const double change = length(to_x - x.velocity, to_y - y.velocity);
    if (to_ == LeadTo::nowhere || change == 0) return {.end = start_};
    const double duration_s = change / acceleration_;
    return {.duration_s = duration_s,
            .acceleration_x = (to_x - x.velocity) / duration_s,
            .acceleration_y = (to_y - y.velocity) / duration_s,
            .end = {.x = {.position = x.position + 0.5 * (x.velocity + to_x) * duration_s, .velocity = to_x},
                    .y = {.position = y.position + 0.5 * (y.velocity + to_y) * duration_s, .velocity = to_y}}};
  }

  [[nodiscard]] AxisLimits limits_of(double share) const {
    return {.speed = speed_ * share, .acceleration = acceleration_ * share};
  }

  /// log(a / b), ever more roughly beyond a factor of two: a step of the search needs no exact one.
  static double log_of_ratio(double a, double b) {
    const double f = (a - b) / (a + b);  // log = 2 artanh f
    const double squared = f * f;
    return 2 * f * (1 + squared * (1.0 / 3 + squared * (1.0 / 5 + squared * (1.0 / 7))));
  }

  static double other_leg(double hypotenuse, double leg) {
    return std::sqrt(std::max((hypotenuse - leg) * (hypotenuse + leg), 0.0));
  }

  /// log(a / b), kept where e to it and its square are finite.
  static double log_ratio(double a, double b) { return std::clamp(std::log((a + tiny) / (b + tiny)), -80.0, 80.0); }

  /// What an axis asks of the limits, roughly; exactly, when the start moves straight towards the goal or rests.
  [[nodiscard]] double need(const AxisState& start, const AxisState& goal) const {
    const double speed = length(start_.x.velocity, start_.y.velocity);
    return std::abs(goal.position - start.position) + 0.5 * std::abs(start.velocity) * speed / acceleration_;
  }

  [[nodiscard]] Split split(double cosine, double sine, const Plane& from, double lead_s) const {
    return {.cosine = cosine,
            .sine = sine,
            .lead_s = lead_s,
            .x = cruise(from.x, goal_.x, limits_of(cosine)),
            .y = cruise(from.y, goal_.y, limits_of(sine))};
  }

  static Cruise cruise(const AxisState& start, const AxisState& goal, const AxisLimits& limits) {
    if (rests(start, goal)) return {};
    return quickest_cruise(start, goal, limits);
  }

  const Plane& start_;
  const Plane& goal_;
  double speed_;
  double acceleration_;
  LeadTo to_;
};

namespace {

// The published split first. When the start is too fast for one axis's share, it may speed up beyond the vector limit:
// then the velocity is first taken into the shares, in a straight line, which keeps both limits. A goal in motion
// leaves little choice of shares, and may still be out of reach for both axes together. The last resort is always
// there: from rest every goal is within reach at every later time, and equal shares s = √½ keep the limit with any
// velocities at the ends: an axis beyond its share is within it before the other is beyond its own, as |vx| s + |vy| s
// <= v_max.
std::optional<Translation> quickest_translation(const Plane& start, const Plane& goal, const MotionLimits& limits) {
  std::optional<Translation> quickest;
  const auto consider = [&](const std::optional<Translation>& other) {
    if (other && (!quickest || other->duration_s() < quickest->duration_s())) quickest = other;
  };
  const double half = std::sqrt(0.5);
  const bool goal_rests = goal.x.velocity == 0 && goal.y.velocity == 0;

  const SplitSearch direct{start, goal, limits, LeadTo::nowhere};
  consider(direct.translation(direct.best()));
  if (!goal_rests) {
    consider(direct.translation(direct.split(half, half)));
  } else if (!quickest || direct.another_may_be_quicker(quickest->duration_s())) {
    consider(direct.translation(direct.published()));
  }
  if (quickest) return quickest;

  const SplitSearch turning_in{start, goal, limits, LeadTo::split};
  consider(turning_in.translation(turning_in.best()));
  if (goal_rests && quickest) return quickest;
  const SplitSearch from_rest{start, goal, limits, LeadTo::rest};
  consider(from_rest.translation(from_rest.best()));
  consider(from_rest.translation(from_rest.split(half, half)));
  return quickest;
}

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
  if (!all_sane(start) || !all_sane(goal) || length(goal.velocity.x, goal.velocity.y) > v_max ||
      std::abs(goal.velocity.w) > limits_.turn_rate_radps) {
    return std::nullopt;
  }
  MotionPlan plan;
  plan.start_x_ = {.position = start.pose.x, .velocity = start.velocity.x};
  plan.start_y_ = {.position = start.pose.y, .velocity = start.velocity.y};
  plan.heading_ =
      quickest_turn(start, goal, {.speed = limits_.turn_rate_radps, .acceleration = limits_.turn_acceleration_radps2});

  Plane from{.x = plan.start_x_, .y = plan.start_y_};
  const Plane to{.x = {.position = goal.pose.x, .velocity = goal.velocity.x},
                 .y = {.position = goal.pose.y, .velocity = goal.velocity.y}};
  const double speed = length(start.velocity.x, start.velocity.y);
  if (speed > v_max) {
    plan.brake_ = {.duration_s = (speed - v_max) / limits_.acceleration_mps2,
                   .acceleration_x = -limits_.acceleration_mps2 * start.velocity.x / speed,
                   .acceleration_y = -limits_.acceleration_mps2 * start.velocity.y / speed};
    from.x = after(from.x, plan.brake_.acceleration_x, plan.brake_.duration_s);
    from.y = after(from.y, plan.brake_.acceleration_y, plan.brake_.duration_s);
  }

  const auto translation = quickest_translation(from, to, limits_);
  if (!translation) return std::nullopt;
  plan.turn_in_ = {.duration_s = translation->led.duration_s,
                   .acceleration_x = translation->led.acceleration_x,
                   .acceleration_y = translation->led.acceleration_y};
  plan.x_ = translation->x;
  plan.y_ = translation->y;
  return plan;
}

}  // namespace regista::control
