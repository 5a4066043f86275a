// SPDX-License-Identifier: Apache-2.0
#include <benchmark/benchmark.h>
#include <regista/control/avoidance.hpp>
#include <regista/control/velocity_profile.hpp>

#include <array>
#include <random>
#include <vector>

#ifdef REGISTA_BENCH_RUCKIG
#include <ruckig/ruckig.hpp>
#endif

namespace regista::control {
namespace {

using namespace std::chrono_literals;

constexpr MotionLimits limits{
    .speed_mps = 3, .acceleration_mps2 = 3, .turn_rate_radps = 10, .turn_acceleration_radps2 = 30};

struct Task {
  MotionState start;
  MotionState goal;
};

/// On a field of 12 m by 9 m: small enough a set to stay in the cache, large enough that no branch is learnt.
std::vector<Task> tasks(double fastest_mps) {
  std::mt19937_64 random{1};
  std::uniform_real_distribution<double> unit{-1, 1};
  std::vector<Task> tasks(4096);
  for (auto& [start, goal] : tasks) {
    const double speed = fastest_mps * std::sqrt(std::abs(unit(random)));
    const double direction = std::numbers::pi * unit(random);
    start = {.pose = {6 * unit(random), 4.5 * unit(random), 3 * unit(random)},
             .velocity = {speed * std::cos(direction), speed * std::sin(direction), 3 * fastest_mps * unit(random)}};
    goal.pose = {6 * unit(random), 4.5 * unit(random), 3 * unit(random)};
  }
  return tasks;
}

/// Tasks that continue plans: what a controller that plans at every tick asks for.
std::vector<Task> replans() {
  const MotionPlanner planner{limits};
  std::mt19937_64 random{2};
  std::uniform_real_distribution<double> part{0, 1};
  std::vector<Task> replans = tasks(0);
  for (auto& [start, goal] : replans) {
    const auto plan = planner.plan(start, goal);
    start = plan->at(from_seconds(part(random) * plan->duration_s()));
  }
  return replans;
}

// The least that three axes cost, each for itself: square roots and divisions of a trapezoid from rest.
void three_trapezoids(benchmark::State& state) {
  const auto all = tasks(0);
  std::size_t i = 0;
  const auto duration = [](double distance, double speed, double acceleration) {
    const double peak = std::min(speed, std::sqrt(acceleration * distance));
    return peak / acceleration + distance / peak;
  };
  for ([[maybe_unused]] const auto _ : state) {
    const auto& [start, goal] = all[++i % all.size()];
    benchmark::DoNotOptimize(duration(std::abs(goal.pose.x - start.pose.x), 2, 2));
    benchmark::DoNotOptimize(duration(std::abs(goal.pose.y - start.pose.y), 2, 2));
    benchmark::DoNotOptimize(duration(std::abs(goal.pose.heading - start.pose.heading), 10, 30));
  }
}

void plan(benchmark::State& state, const std::vector<Task>& all) {
  const MotionPlanner planner{limits};
  std::size_t i = 0;
  for ([[maybe_unused]] const auto _ : state) {
    const auto& [start, goal] = all[++i % all.size()];
    benchmark::DoNotOptimize(planner.plan(start, goal));
  }
}

#ifdef REGISTA_BENCH_RUCKIG
void ruckig_plan(benchmark::State& state, const std::vector<Task>& all) {
  std::vector<ruckig::InputParameter<3>> moves;
  for (const auto& [start, goal] : all) {
    auto& move = moves.emplace_back();
    move.current_position = {start.pose.x, start.pose.y, start.pose.heading};
    move.current_velocity = {start.velocity.x, start.velocity.y, start.velocity.w};
    move.target_position = {goal.pose.x, goal.pose.y, goal.pose.heading};
    move.max_velocity = {limits.speed_mps, limits.speed_mps, limits.turn_rate_radps};
    move.max_acceleration = {limits.acceleration_mps2, limits.acceleration_mps2, limits.turn_acceleration_radps2};
  }
  ruckig::Ruckig<3> ruckig;
  ruckig::Trajectory<3> trajectory;
  std::size_t i = 0;
  for ([[maybe_unused]] const auto _ : state) {
    benchmark::DoNotOptimize(ruckig.calculate(moves[++i % moves.size()], trajectory));
  }
}
#endif

void polynomials(benchmark::State& state) {
  std::array<double, 3> acceleration{1, 2, 3};
  benchmark::DoNotOptimize(acceleration);
  double t = 0;
  for ([[maybe_unused]] const auto _ : state) {
    t = t > 2 ? 0 : t + 0.01;
    MotionState at{};
    at.pose.x = (1 + 0.5 * acceleration[0] * t) * t;
    at.pose.y = (1 + 0.5 * acceleration[1] * t) * t;
    at.pose.heading = (1 + 0.5 * acceleration[2] * t) * t;
    at.velocity = {1 + acceleration[0] * t, 1 + acceleration[1] * t, 1 + acceleration[2] * t};
    benchmark::DoNotOptimize(at);
  }
}

void evaluate(benchmark::State& state) {
  const auto plan = MotionPlanner{limits}.plan({}, {.pose = {4, 3, 1}});
  Duration t{};
  for ([[maybe_unused]] const auto _ : state) {
    t = t > 3s ? Duration{} : t + 10ms;
    benchmark::DoNotOptimize(plan->at(t));
  }
}

std::vector<Disc> crowd() {
  std::mt19937_64 random{3};
  std::uniform_real_distribution<double> unit{-1, 1};
  std::vector<Disc> crowd(31);
  for (Disc& disc : crowd) {
    disc = {.x = 6 * unit(random),
            .y = 4.5 * unit(random),
            .velocity = {.x = unit(random), .y = unit(random)},
            .radius_m = 0.09,
            .cooperates = unit(random) > 0};
  }
  return crowd;
}

void distances(benchmark::State& state) {
  const auto others = crowd();
  for ([[maybe_unused]] const auto _ : state) {
    for (const Disc& other : others) benchmark::DoNotOptimize(std::sqrt(other.x * other.x + other.y * other.y));
  }
}

void avoid(benchmark::State& state) {
  const auto others = crowd();
  Avoidance avoidance{{.speed_mps = 2, .acceleration_mps2 = 3, .horizon = 1500ms}};
  for ([[maybe_unused]] const auto _ : state) {
    benchmark::DoNotOptimize(avoidance.step({.velocity = {.x = 1}, .radius_m = 0.09}, {.x = 2}, others, 10ms));
  }
}

BENCHMARK(three_trapezoids)->Name("plan_3dof/three_trapezoids");
BENCHMARK_CAPTURE(plan, rest, tasks(0))->Name("plan_3dof/from_rest");
BENCHMARK_CAPTURE(plan, replans, replans())->Name("plan_3dof/replanned_on_the_way");
BENCHMARK_CAPTURE(plan, motion, tasks(3))->Name("plan_3dof/from_any_velocity");
#ifdef REGISTA_BENCH_RUCKIG
BENCHMARK_CAPTURE(ruckig_plan, rest, tasks(0))->Name("plan_3dof/ruckig_from_rest");
BENCHMARK_CAPTURE(ruckig_plan, replans, replans())->Name("plan_3dof/ruckig_replanned_on_the_way");
BENCHMARK_CAPTURE(ruckig_plan, motion, tasks(3))->Name("plan_3dof/ruckig_from_any_velocity");
#endif
BENCHMARK(polynomials)->Name("evaluate_plan/polynomials");
BENCHMARK(evaluate)->Name("evaluate_plan/at");
BENCHMARK(distances)->Name("avoidance_31_discs/distances");
BENCHMARK(avoid)->Name("avoidance_31_discs/step");

}  // namespace
}  // namespace regista::control
