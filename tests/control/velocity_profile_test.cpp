// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/control/velocity_profile.hpp>

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <random>

namespace regista::control {
namespace {

constexpr double pi = std::numbers::pi;
constexpr MotionLimits limits{
    .speed_mps = 3, .acceleration_mps2 = 3, .turn_rate_radps = 10, .turn_acceleration_radps2 = 30};

double speed(const MotionState& state) { return std::hypot(state.velocity.x, state.velocity.y); }

class RandomStates {
 public:
  explicit RandomStates(unsigned seed) : random_{seed} {}

  double uniform(double low, double high) { return std::uniform_real_distribution<double>{low, high}(random_); }

  /// On a field of 12 m by 9 m, as fast as `fastest_mps` in any direction.
  MotionState state(double fastest_mps) {
    const double v = fastest_mps * std::sqrt(uniform(0, 1));
    const double direction = uniform(-pi, pi);
    return {.pose = {.x = uniform(-6, 6), .y = uniform(-4.5, 4.5), .heading = uniform(-pi, pi)},
            .velocity = {.x = v * std::cos(direction), .y = v * std::sin(direction), .w = uniform(-10, 10)}};
  }

 private:
  std::mt19937_64 random_;
};

TEST(AxisProfile, from_rest_to_rest_is_a_trapezoid) {
  const auto profile = AxisProfile::quickest({}, {.position = 3}, {.speed = 1, .acceleration = 2});
  EXPECT_NEAR(profile.duration_s(), 0.5 + 2.5 + 0.5, 1e-15);
  EXPECT_NEAR(profile.at(0.25).velocity, 0.5, 1e-15);
  EXPECT_NEAR(profile.at(1.5).velocity, 1, 1e-15);
  EXPECT_NEAR(profile.at(1.5).position, 1.25, 1e-15);
}

TEST(AxisProfile, a_short_move_backwards_is_a_triangle) {
  const auto profile = AxisProfile::quickest({.position = 1}, {.position = 0.5}, {.speed = 10, .acceleration = 2});
  EXPECT_NEAR(profile.duration_s(), 1, 1e-15);
  EXPECT_NEAR(profile.at(0.5).velocity, -1, 1e-15);
}

TEST(AxisProfile, too_fast_to_stop_in_time_it_overshoots_and_comes_back) {
  const auto profile = AxisProfile::quickest({.velocity = 2}, {.position = 1}, {.speed = 2, .acceleration = 1});
  EXPECT_NEAR(profile.at(2).velocity, 0, 1e-15);
  EXPECT_NEAR(profile.at(2).position, 2, 1e-15);
  EXPECT_NEAR(profile.duration_s(), 4, 1e-15);
}

TEST(AxisProfile, after_the_end_goes_on_with_the_final_velocity) {
  const auto profile = AxisProfile::quickest({}, {.position = 1, .velocity = 0.5}, {.speed = 1, .acceleration = 1});
  const AxisState later = profile.at(profile.duration_s() + 2);
  EXPECT_NEAR(later.position, 2, 1e-14);
  EXPECT_EQ(later.velocity, 0.5);
}

// Durations out of reach exist: who flies past the goal too early cannot meet it a little later.
TEST(AxisProfile, a_goal_in_motion_cannot_be_met_at_every_later_time) {
  const AxisState start{.velocity = 1};
  const AxisState goal{.position = 0.9, .velocity = 1};
  const AxisLimits axis{.speed = 1.5, .acceleration = 1};
  EXPECT_TRUE(AxisProfile::lasting(1, start, goal, axis));
  EXPECT_FALSE(AxisProfile::lasting(2, start, goal, axis));
  EXPECT_TRUE(AxisProfile::lasting(6, start, goal, axis));
}

TEST(AxisProfile, can_last_any_longer_when_the_goal_is_at_rest) {
  RandomStates random{1};
  for (int i = 0; i < 100'000; ++i) {
    const AxisLimits axis{.speed = random.uniform(0.1, 4), .acceleration = random.uniform(0.1, 4)};
    const AxisState start{.position = random.uniform(-6, 6), .velocity = random.uniform(-axis.speed, axis.speed)};
    const AxisState goal{.position = random.uniform(-6, 6)};
    const double duration_s = AxisProfile::quickest(start, goal, axis).duration_s() * random.uniform(1, 3);
    const auto profile = AxisProfile::lasting(duration_s, start, goal, axis);
    ASSERT_TRUE(profile);
    ASSERT_EQ(profile->duration_s(), duration_s);
    ASSERT_NEAR(profile->at(duration_s).position, goal.position, 1e-11);
    for (const double switch_s : profile->switches_s()) {
      ASSERT_LE(std::abs(profile->at(switch_s).velocity), axis.speed * (1 + 1e-12));
    }
  }
}

TEST(MotionPlanner, names_the_limit_that_it_refuses) {
  for (const auto& [bad, name] :
       {std::pair{MotionLimits{0, 1, 1, 1}, "speed_mps"}, std::pair{MotionLimits{1, -1, 1, 1}, "acceleration_mps2"},
        std::pair{MotionLimits{1, 1, std::nan(""), 1}, "turn_rate_radps"},
        std::pair{MotionLimits{1, 1, 1, INFINITY}, "turn_acceleration_radps2"}}) {
    try {
      const MotionPlanner planner{bad};
      FAIL() << name;
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(std::string{error.what()}.find(name), 0U) << error.what();
    }
  }
}

TEST(MotionPlanner, refuses_what_is_no_number_and_goals_beyond_the_limits) {
  const MotionPlanner planner{limits};
  EXPECT_FALSE(planner.plan({.pose = {.x = std::nan("")}}, {}));
  EXPECT_FALSE(planner.plan({}, {.pose = {.heading = INFINITY}}));
  EXPECT_FALSE(planner.plan({}, {.velocity = {.x = 1e9}}));
  EXPECT_FALSE(planner.plan({}, {.velocity = {.x = 2.9, .y = 2.9}}));
  EXPECT_FALSE(planner.plan({}, {.velocity = {.w = -10.1}}));
  EXPECT_TRUE(planner.plan({}, {}));
}

TEST(MotionPlanner, a_straight_move_gets_the_whole_limits) {
  const auto plan = MotionPlanner{limits}.plan({}, {.pose = {.x = 4, .y = 3}});
  ASSERT_TRUE(plan);
  EXPECT_NEAR(plan->duration_s(), 5.0 / 3 + 1, 1e-9);
  EXPECT_NEAR(speed(plan->at(from_seconds(1.2))), 3, 1e-12);
}

TEST(MotionPlanner, meets_a_goal_that_moves_at_full_speed_along_one_axis) {
  const auto plan = MotionPlanner{limits}.plan({}, {.pose = {.x = 1, .y = 1}, .velocity = {.y = 3}});
  ASSERT_TRUE(plan);
  EXPECT_LT(plan->duration_s(), 5);
  const MotionState end = plan->at(from_seconds(plan->duration_s()));
  EXPECT_NEAR(end.pose.x, 1, 1e-8);
  EXPECT_NEAR(end.pose.y, 1, 1e-8);
  EXPECT_NEAR(end.velocity.y, 3, 1e-8);
}

TEST(MotionPlanner, turns_the_quicker_way_which_may_be_the_longer) {
  const MotionPlanner planner{limits};
  EXPECT_LT(planner.plan({}, {.pose = {.heading = -1}})->at(std::chrono::milliseconds{100}).velocity.w, 0);
  EXPECT_LT(planner.plan({.pose = {.heading = -3}}, {.pose = {.heading = 3}})->duration_s(), 0.2);
  const auto turning = planner.plan({.velocity = {.w = 10}}, {.pose = {.heading = -pi + 0.1}});
  for (int ms = 0; ms < 300; ++ms) EXPECT_GT(turning->at(std::chrono::milliseconds{ms}).velocity.w, 0);
}

struct Case {
  const char* name;
  double start_mps;
  double goal_mps;
};
class Plans : public testing::TestWithParam<Case> {};

TEST_P(Plans, keep_both_vector_limits_at_every_instant_and_arrive_on_both_axes_at_once) {
  const MotionPlanner planner{limits};
  RandomStates random{2};
  for (int i = 0; i < 20'000; ++i) {
    const MotionState start = random.state(GetParam().start_mps);
    const MotionState goal = random.state(GetParam().goal_mps);
    const auto plan = planner.plan(start, goal);
    ASSERT_TRUE(plan);
    ASSERT_EQ(plan->at({}).pose, start.pose);

    auto switches_s = plan->switches_s();
    ASSERT_EQ(switches_s[4], switches_s[7]);  // x and y end
    std::sort(switches_s.begin(), switches_s.end());
    // The acceleration is constant between switches: the change of velocity tells it.
    double before_s = 0;
    for (const double switch_s : switches_s) {
      const MotionState from = plan->at(from_seconds(before_s));
      const MotionState to = plan->at(from_seconds(switch_s));
      const double change = std::hypot(to.velocity.x - from.velocity.x, to.velocity.y - from.velocity.y);
      ASSERT_LE(change, limits.acceleration_mps2 * (switch_s - before_s) + 1e-8);
      ASSERT_LE(speed(to), std::max(limits.speed_mps, speed(from)) + 1e-8);
      // Positions follow the velocities: no jump anywhere.
      ASSERT_NEAR(to.pose.x - from.pose.x, 0.5 * (from.velocity.x + to.velocity.x) * (switch_s - before_s), 1e-6);
      ASSERT_NEAR(to.pose.y - from.pose.y, 0.5 * (from.velocity.y + to.velocity.y) * (switch_s - before_s), 1e-6);
      before_s = switch_s;
    }
    const MotionState end = plan->at(from_seconds(switches_s.back()));
    ASSERT_NEAR(end.pose.x, goal.pose.x, 1e-8);
    ASSERT_NEAR(end.pose.y, goal.pose.y, 1e-8);
    ASSERT_NEAR(end.velocity.x, goal.velocity.x, 1e-8);
    ASSERT_NEAR(end.velocity.y, goal.velocity.y, 1e-8);
  }
}

TEST_P(Plans, end_at_the_heading_and_turn_rate_of_the_goal) {
  const MotionPlanner planner{limits};
  RandomStates random{3};
  for (int i = 0; i < 20'000; ++i) {
    const MotionState start = random.state(GetParam().start_mps);
    MotionState goal = random.state(GetParam().goal_mps);
    goal.pose.x = start.pose.x;  // so that the turn ends last
    goal.pose.y = start.pose.y;
    const auto plan = planner.plan({.pose = start.pose, .velocity = {.w = start.velocity.w}},
                                   {.pose = goal.pose, .velocity = {.w = goal.velocity.w}});
    ASSERT_TRUE(plan);
    const MotionState end = plan->at(from_seconds(plan->duration_s()));
    ASSERT_NEAR(angle_between(end.pose.heading, goal.pose.heading), 0, 1e-7);
    ASSERT_NEAR(end.velocity.w, goal.velocity.w, 1e-7);
  }
}

TEST_P(Plans, replanned_on_the_way_do_not_jump) {
  const MotionPlanner planner{limits};
  RandomStates random{4};
  for (int i = 0; i < 20'000; ++i) {
    const auto plan = planner.plan(random.state(GetParam().start_mps), random.state(GetParam().goal_mps));
    const Duration now = from_seconds(plan->duration_s() * random.uniform(0, 1));
    const MotionState here = plan->at(now);
    const auto next = planner.plan(here, random.state(GetParam().goal_mps));
    ASSERT_TRUE(next);
    const MotionState there = next->at({});
    ASSERT_EQ(there.pose, here.pose);
    ASSERT_EQ(there.velocity.x, here.velocity.x);
    ASSERT_EQ(there.velocity.y, here.velocity.y);
    ASSERT_EQ(there.velocity.w, here.velocity.w);
  }
}

INSTANTIATE_TEST_SUITE_P(, Plans,
                         testing::Values(Case{"rest_to_rest", 0, 0}, Case{"inside_to_rest", 3, 0},
                                         Case{"outside_to_rest", 6, 0}, Case{"inside_to_motion", 3, 3},
                                         Case{"outside_to_motion", 6, 3}),
                         [](const auto& chosen) { return std::string{chosen.param.name}; });

TEST(MotionPlanner, finds_a_plan_whatever_the_orders_of_magnitude) {
  RandomStates random{8};
  const auto any = [&] { return std::copysign(std::pow(10, random.uniform(-6, 2.5)), random.uniform(-1, 1)); };
  const auto any_or_none = [&] { return random.uniform(0, 1) < 0.2 ? 0 : any(); };
  for (int i = 0; i < 20'000; ++i) {
    const MotionLimits odd{.speed_mps = 1e-3 + std::abs(any()),
                           .acceleration_mps2 = 1e-3 + std::abs(any()),
                           .turn_rate_radps = 1e-3 + std::abs(any()),
                           .turn_acceleration_radps2 = 1e-3 + std::abs(any())};
    const double speed_mps = odd.speed_mps * random.uniform(0, 1);
    const double direction = random.uniform(-pi, pi);
    const MotionState start{.pose = {any_or_none(), any_or_none(), any()},
                            .velocity = {any_or_none(), any_or_none(), any()}};
    const MotionState goal{.pose = {any_or_none(), any_or_none(), any()},
                           .velocity = {speed_mps * std::cos(direction), speed_mps * std::sin(direction), 0}};
    for (const MotionState& to : {goal, MotionState{.pose = goal.pose}}) {
      const auto plan = MotionPlanner{odd}.plan(start, to);
      ASSERT_TRUE(plan);
      ASSERT_TRUE(std::isfinite(plan->duration_s()));
      ASSERT_GE(plan->duration_s(), 0);
    }
  }
}

TEST(MotionPlanner, from_above_the_speed_limit_brakes_straight_at_full_deceleration) {
  const MotionPlanner planner{limits};
  RandomStates random{5};
  for (int i = 0; i < 1000; ++i) {
    MotionState start = random.state(3);
    const double factor = random.uniform(3.1, 6) / speed(start);
    start.velocity.x *= factor;
    start.velocity.y *= factor;
    const auto plan = planner.plan(start, random.state(0));
    const double inside_s = (speed(start) - limits.speed_mps) / limits.acceleration_mps2;
    for (const double part : {0.1, 0.5, 0.9, 1.0}) {
      const MotionState state = plan->at(from_seconds(part * inside_s));
      ASSERT_NEAR(speed(state), speed(start) - limits.acceleration_mps2 * part * inside_s, 1e-8);
      ASSERT_NEAR(state.velocity.x * start.velocity.y, state.velocity.y * start.velocity.x, 1e-8);
    }
  }
}

TEST(MotionPlanner, replanned_every_tick_arrives_when_the_first_plan_said) {
  const MotionPlanner planner{limits};
  RandomStates random{6};
  for (int i = 0; i < 100; ++i) {
    const MotionState start = random.state(0);
    const MotionState goal = random.state(0);
    auto plan = planner.plan({.pose = start.pose}, {.pose = goal.pose});
    const double promised_s = plan->duration_s();
    double now_s = 0;
    while (now_s + 0.01 < promised_s) {
      now_s += 0.01;
      plan = planner.plan(plan->at(std::chrono::milliseconds{10}), {.pose = goal.pose});
      // While braking, the duration goes with the square root of a rounding error in position.
      ASSERT_NEAR(now_s + plan->duration_s(), promised_s, 1e-5);
    }
  }
}

// Holtzhausen 2013 after Purwin and D'Andrea 2006: each axis advances through five cases, and α is halved towards the
// axis that ends later.
double published_axis_s(double distance, double velocity, double v_max, double a_max) {
  double time_s = 0;
  for (int phase = 0; phase < 8; ++phase) {
    if (distance < 0) {
      distance = -distance;
      velocity = -velocity;
    }
    if (velocity < 0) {  // 1: away from the goal: brake
      time_s += -velocity / a_max;
      distance += velocity * velocity / (2 * a_max);
      velocity = 0;
    } else if (velocity > v_max) {  // 5: too fast: slow down to the limit
      const double slow_s = (velocity - v_max) / a_max;
      time_s += slow_s;
      distance -= 0.5 * (velocity + v_max) * slow_s;
      velocity = v_max;
    } else if (velocity * velocity / (2 * a_max) > distance * (1 + 1e-12)) {  // cannot stop in time: brake, come back
      time_s += velocity / a_max;
      distance -= velocity * velocity / (2 * a_max);
      velocity = 0;
    } else {  // 2 speed up, 3 cruise, 4 slow down
      const double peak = std::min(v_max, std::sqrt(a_max * distance + 0.5 * velocity * velocity));
      const double ramps = (peak * peak - 0.5 * velocity * velocity) / a_max;
      return time_s + (2 * peak - velocity) / a_max + std::max(0.0, distance - ramps) / peak;
    }
  }
  return time_s;
}

struct Published {
  double duration_s;
  double alpha;
};

Published published_plan(const MotionState& start, const MotionState& goal) {
  double alpha = pi / 4;
  double x_s = 0;
  double y_s = 0;
  for (double step = pi / 8;; step /= 2) {
    x_s = published_axis_s(goal.pose.x - start.pose.x, start.velocity.x, limits.speed_mps * std::cos(alpha),
                           limits.acceleration_mps2 * std::cos(alpha));
    y_s = published_axis_s(goal.pose.y - start.pose.y, start.velocity.y, limits.speed_mps * std::sin(alpha),
                           limits.acceleration_mps2 * std::sin(alpha));
    if (std::abs(x_s - y_s) < 1e-3 || step <= 1e-7) break;
    alpha += x_s > y_s ? -step : step;
  }
  return {.duration_s = std::max(x_s, y_s), .alpha = alpha};
}

/// Its axes do not know of each other: what they do together may be too fast.
bool published_plan_keeps_the_speed_limit(const MotionState& start, const MotionState& goal, double alpha) {
  const auto axis = [](double from, double velocity, double to, double share) {
    return AxisProfile::quickest({.position = from, .velocity = velocity}, {.position = to},
                                 {.speed = limits.speed_mps * share, .acceleration = limits.acceleration_mps2 * share});
  };
  const AxisProfile x = axis(start.pose.x, start.velocity.x, goal.pose.x, std::cos(alpha));
  const AxisProfile y = axis(start.pose.y, start.velocity.y, goal.pose.y, std::sin(alpha));
  const auto keeps = [&](double time_s) {
    return std::hypot(x.at(time_s).velocity, y.at(time_s).velocity) <= limits.speed_mps * (1 + 1e-9);
  };
  const auto sx = x.switches_s();
  const auto sy = y.switches_s();
  return std::all_of(sx.begin(), sx.end(), keeps) && std::all_of(sy.begin(), sy.end(), keeps);
}

// REGISTA_PLANS=1000000 for the full count.
TEST(MotionPlanner, is_never_slower_than_the_published_algorithm_where_that_keeps_the_speed_limit) {
  const char* asked = std::getenv("REGISTA_PLANS");
  const int plans = asked ? std::atoi(asked) : 50'000;
  const MotionPlanner planner{limits};
  RandomStates random{7};
  int compared = 0;
  int slower = 0;
  int beyond_the_limit = 0;
  int slower_than_beyond = 0;
  double worst_s = -std::numeric_limits<double>::infinity();
  double saved_s = 0;
  for (int i = 0; i < plans; ++i) {
    MotionState start = random.state(i % 4 == 0 ? 0 : limits.speed_mps);
    MotionState goal = random.state(0);
    start.velocity.w = goal.velocity.w = 0;  // the published plan does not turn
    goal.pose.heading = start.pose.heading;
    const Published published = published_plan(start, goal);
    const double difference_s = planner.plan(start, goal)->duration_s() - published.duration_s;
    if (published_plan_keeps_the_speed_limit(start, goal, published.alpha)) {
      ++compared;
      slower += difference_s > 1e-7;
      worst_s = std::max(worst_s, difference_s);
      saved_s -= difference_s;
    } else {
      ++beyond_the_limit;
      slower_than_beyond += difference_s > 1e-9;
    }
  }
  RecordProperty("compared", compared);
  std::printf(
      "%d plans: %d within the limit, of these %d slower (worst %.3g s, mean gain %.3g s); %d beyond it, %d of "
      "these quicker than ours\n",
      plans, compared, slower, worst_s, saved_s / compared, beyond_the_limit, slower_than_beyond);
  EXPECT_EQ(slower, 0);
  EXPECT_GT(compared, plans * 8 / 10);
}

}  // namespace
}  // namespace regista::control
