// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <iterator>
#include <numbers>

#include "experiments.hpp"
#include "soccer_robot.hpp"

namespace regista::reproduce {
namespace {

using namespace std::chrono_literals;

constexpr double pi = std::numbers::pi;

/// A drive as it was: truth, and how far off the estimate was, root mean square.
struct Trace {
  std::vector<double> t_s, x_m, y_m, off_m, off_rad;

  [[nodiscard]] double rms_m() const { return rms(off_m); }
  [[nodiscard]] double rms_rad() const { return rms(off_rad); }

 private:
  static double rms(std::span<const double> values) {
    double squares = 0;
    for (const double value : values) squares += value * value;
    return std::sqrt(squares / static_cast<double>(values.size()));
  }
};

/// Through all goals in turn, with a rest of 1 s at each.
Trace drive(World& world, Pilot& pilot, std::span<const Pose2d> goals) {
  Trace trace;
  for (const Pose2d& goal : goals) {
    BodyVelocity command;
    for (Duration rested{}; rested < 1s;) {
      if (pilot.steer(goal, world.beat(), command)) rested += world.beat();
      pilot.sense(world.step(command), world.beat());
      const Pose2d at = pilot.estimate().pose;
      trace.t_s.push_back(world.now_s());
      trace.x_m.push_back(world.truth().x);
      trace.y_m.push_back(world.truth().y);
      trace.off_m.push_back(distance(at, world.truth()));
      trace.off_rad.push_back(std::abs(angle_between(at.heading, world.truth().heading)));
    }
  }
  return trace;
}

/// The worlds of run `r` are the same for all variants.
std::uint64_t world_seed(const Settings& settings, std::size_t run, std::size_t part = 0) {
  return settings.seed * 1'000'003 + run * 16 + part;
}

Row row(std::string source, std::string quantity, std::string unit, const Variant& variant, double published,
        const Estimate& estimate, std::string note = {}) {
  return {.source = std::move(source),
          .quantity = std::move(quantity),
          .unit = std::move(unit),
          .controller = variant.controller,
          .better = "lower",
          .published = published,
          .value = estimate.value,
          .ci95_low = estimate.low,
          .ci95_high = estimate.high,
          .note = std::move(note)};
}

// -- Tables 7.1 to 7.4 ------------------------------------------------------------------------------------------------

constexpr std::size_t directions = 8;
using Directions = std::array<std::vector<double>, directions>;  // one value a run

/// One metre in each direction.
struct Moves {
  Directions direction_deg, distance_error, end_x_m, end_y_m;
};

Moves eight_directions(const Settings& settings, const Variant& variant) {
  Moves moves;
  for (std::size_t k = 0; k < directions; ++k) {
    const double direction = pi / 4 * static_cast<double>(k);
    const std::array goal{Pose2d{.x = std::cos(direction), .y = std::sin(direction)}};
    for (std::size_t run = 0; run < settings.runs; ++run) {
      World world{world_seed(settings, run, k), variant.beat};
      const auto pilot = variant.make(true, Gates::all);
      drive(world, *pilot, goal);
      const Pose2d end = world.truth();
      moves.direction_deg[k].push_back(angle_between(direction, std::atan2(end.y, end.x)) * 180 / pi);
      moves.distance_error[k].push_back(std::hypot(end.x, end.y) - 1);
      moves.end_x_m[k].push_back(end.x);
      moves.end_y_m[k].push_back(end.y);
    }
  }
  return moves;
}

/// `each` of the directions' samples, put together by `all`.
Estimate over_directions(const Directions& values, const Settings& settings,
                         const std::function<double(std::span<const double>)>& each,
                         const std::function<double(std::span<const double>)>& all) {
  std::vector<double> sample(settings.runs);
  const auto statistic = [&](std::span<const std::size_t> runs) {
    std::array<double, directions> one{};
    for (std::size_t k = 0; k < directions; ++k) {
      std::ranges::transform(runs, sample.begin(), [&](std::size_t run) { return values[k][run]; });
      one[k] = each(sample);
    }
    return all(one);
  };
  return bootstrap(settings.runs, statistic, settings.seed);
}

double largest(std::span<const double> values) { return *std::ranges::max_element(values); }
double size_of_mean(std::span<const double> values) { return std::abs(mean(values)); }
double mean_size(std::span<const double> values) {
  double sum = 0;
  for (const double value : values) sum += std::abs(value);
  return sum / static_cast<double>(values.size());
}

Experiment directions_table(const Settings& settings) {
  Experiment result{
      .title = "H tables 7.1 to 7.4: one metre in eight directions",
      .text =
          "A soccer robot drives 1 m to 0°, 45° … 315° and rests for a second; then its true way is "
          "measured. *Published, wheels only* sends the velocity of the plan to the motor boards and "
          "leaves the rest to their loops (P 1.1, I 2). *Published, fused* closes three PI loops over "
          "H's two Kalman filters on accelerometer, gyro and vision. *Ours, wheels only* tracks the "
          "same plan on odometry; *ours, fused* adds wheels, gyro bias and the age of each frame to "
          "the filters and feeds the plan's velocity forward. "
          "The distance error is the mean of |way - 1 m| over all moves; that H means the same is our reading.",
      .rows = {},
      .plots = {{.file = "h-directions",
                 .title = "Ends of 1 m moves in eight directions",
                 .x_label = "x [m]",
                 .y_label = "y [m]",
                 .lines = {},
                 .same_scale = true}}};
  struct Published {
    std::string source;
    double mean_deg, mean_sd_deg, max_sd_deg, distance_percent;
  };
  const Published wheels{"H 7.1-7.2", 15.43, 4.68, 9.75, 27.67}, fused{"H 7.3-7.4", 1.93, 1.29, 1.70, 10.49};
  const std::vector<std::pair<Variant, const Published*>> compared{
      {published_wheels(), &wheels}, {our_wheels(), &wheels}, {published_fusion(), &fused}, {our_fusion(), &fused}};
  for (const auto& [variant, published] : compared) {
    const Moves moves = eight_directions(settings, variant);
    const std::string how = published == &wheels ? ", wheels only" : ", fused";
    const auto& angles = moves.direction_deg;
    result.rows.push_back(row(published->source, "direction error, largest mean of a direction, either way" + how,
                              "deg", variant, published->mean_deg,
                              over_directions(angles, settings, size_of_mean, largest)));
    result.rows.push_back(row(published->source, "direction error, mean sd of a direction" + how, "deg", variant,
                              published->mean_sd_deg, over_directions(angles, settings, standard_deviation, mean)));
    result.rows.push_back(row(published->source, "direction error, largest sd of a direction" + how, "deg", variant,
                              published->max_sd_deg, over_directions(angles, settings, standard_deviation, largest)));
    const Estimate distance = over_directions(moves.distance_error, settings, mean_size, mean);
    result.rows.push_back(row(published->source, "distance error, mean of all moves" + how, "%", variant,
                              published->distance_percent,
                              {.value = 100 * distance.value, .low = 100 * distance.low, .high = 100 * distance.high}));
    Line ends{.name = variant.name, .x = {}, .y = {}, .dots = true};
    for (std::size_t k = 0; k < directions; ++k) {
      std::ranges::copy(moves.end_x_m[k], std::back_inserter(ends.x));
      std::ranges::copy(moves.end_y_m[k], std::back_inserter(ends.y));
    }
    result.plots[0].lines.push_back(std::move(ends));
  }
  return result;
}

// -- The other experiments --------------------------------------------------------------------------------------------

Experiment square(const Settings& settings) {
  constexpr std::array corners{Pose2d{.x = 1}, Pose2d{.x = 1, .y = 1}, Pose2d{.y = 1}, Pose2d{}};
  Experiment result{.title = "H: a square of one metre",
                    .text =
                        "Four moves back to the start, without vision and with it; the distance from start to end is "
                        "the closing error. Without vision H integrates the accelerometer twice, and all depends on "
                        "how well it was zeroed; ours has the wheels beside it.",
                    .rows = {},
                    .plots = {{.file = "h-square",
                               .title = "One square of each",
                               .x_label = "x [m]",
                               .y_label = "y [m]",
                               .lines = {},
                               .same_scale = true}}};
  for (const bool vision : {false, true}) {
    for (const Variant& variant : {published_fusion(), our_fusion()}) {
      std::vector<double> closing_m;
      for (std::size_t run = 0; run < settings.runs; ++run) {
        World world{world_seed(settings, run), variant.beat};
        const auto pilot = variant.make(vision, Gates::all);
        Trace trace = drive(world, *pilot, corners);
        closing_m.push_back(std::hypot(world.truth().x, world.truth().y));
        if (run == 0) {
          result.plots[0].lines.push_back({.name = variant.controller + (vision ? ", vision" : ", no vision"),
                                           .x = std::move(trace.x_m),
                                           .y = std::move(trace.y_m)});
        }
      }
      result.rows.push_back(row("H square", vision ? "closing error with vision" : "closing error without vision", "m",
                                variant, vision ? 0.088 : 0.542, mean_of(closing_m, settings.seed),
                                !vision && variant.controller == "ours" ? "on IMU and wheels" : ""));
    }
  }
  return result;
}

Experiment gap(const Settings& settings) {
  constexpr Disturbances half_a_second{.gap_from_s = 0.8, .gap_until_s = 1.3};
  Experiment result{.title = "H: half a second without vision",
                    .text =
                        "The move of 1 m ahead again, with no frame from 0.8 s to 1.3 s: how much farther the estimate "
                        "is off then than at the same time with all frames, in per cent of the metre.",
                    .rows = {},
                    .plots = {{.file = "h-gap",
                               .title = "Estimate off the truth, no vision from 0.8 s to 1.3 s",
                               .x_label = "t [s]",
                               .y_label = "error [m]",
                               .lines = {}}}};
  for (const Variant& variant : {published_fusion(), our_fusion()}) {
    std::vector<double> more_percent;
    for (std::size_t run = 0; run < settings.runs; ++run) {
      const auto trace = [&](const Disturbances& disturbances) {
        World world{world_seed(settings, run), variant.beat, disturbances};
        return drive(world, *variant.make(true, Gates::all), std::array{Pose2d{.x = 1}});
      };
      Trace all = trace({}), some = trace(half_a_second);
      // The last sample before frames come again.
      const auto after = std::ranges::lower_bound(some.t_s, half_a_second.gap_until_s - 1e-6);
      const auto last = static_cast<std::size_t>(after - some.t_s.begin() - 1);
      more_percent.push_back(100 * (some.off_m[last] - all.off_m[last]));
      if (run == 0) {
        result.plots[0].lines.push_back({.name = variant.name, .x = std::move(some.t_s), .y = std::move(some.off_m)});
      }
    }
    result.rows.push_back(row("H gap", "rise of the position error over 500 ms without vision", "% of the way", variant,
                              2.5, mean_of(more_percent, settings.seed)));
  }
  return result;
}

Experiment outliers(const Settings& settings) {
  Experiment result{
      .title = "H: outliers of vision",
      .text =
          "The move again, while 3 % of the frames turn the robot by ±90° or 180° and another 3 % see it a "
          "metre away: what the gates change in the error of the estimate (root mean square over the "
          "move, mean of the runs). Which of H's two figures is whose is our reading: the "
          "larger gain for the heading, which his gate on the turn rate watches.",
      .rows = {},
      .plots = {{.file = "h-outliers",
                 .title = "Heading estimate off the truth",
                 .x_label = "t [s]",
                 .y_label = "error [rad]",
                 .lines = {}}}};
  constexpr std::array goal{Pose2d{.x = 1}};
  for (const Variant& variant : {published_fusion(), our_fusion()}) {
    std::array<std::vector<double>, 2> off_m, off_rad;  // without gates, with them
    for (std::size_t run = 0; run < settings.runs; ++run) {
      for (const Gates gates : {Gates::none, Gates::all}) {
        World world{world_seed(settings, run), variant.beat, {.flip = 0.03, .teleport = 0.03}};
        const auto pilot = variant.make(true, gates);
        Trace trace = drive(world, *pilot, goal);
        off_m[gates == Gates::all ? 1 : 0].push_back(trace.rms_m());
        off_rad[gates == Gates::all ? 1 : 0].push_back(trace.rms_rad());
        if (run == 0) {
          result.plots[0].lines.push_back(
              {.name = variant.controller + (gates == Gates::all ? ", gates" : ", no gates"),
               .x = std::move(trace.t_s),
               .y = std::move(trace.off_rad)});
        }
      }
    }
    const auto change = [&](const std::array<std::vector<double>, 2>& off) {
      return bootstrap(
          settings.runs,
          [&](std::span<const std::size_t> runs) {
            double without = 0, with = 0;
            for (const std::size_t run : runs) {
              without += off[0][run];
              with += off[1][run];
            }
            return 100 * (with / without - 1);
          },
          settings.seed);
    };
    result.rows.push_back(
        row("H outliers", "change of the position's error by the gates", "%", variant, -81.54, change(off_m)));
    result.rows.push_back(
        row("H outliers", "change of the heading's error by the gates", "%", variant, -91.56, change(off_rad)));
  }
  return result;
}

Experiment rest(const Settings& settings) {
  Experiment result{.title = "H: velocity at rest",
                    .text =
                        "The robot stands for five seconds: the mean speed that its filter believes in. The "
                        "simulated sensors (vision of 4 mm, IMU of its data sheets) are evidently quieter than his.",
                    .rows = {},
                    .plots = {}};
  for (const Variant& variant : {published_fusion(), our_fusion()}) {
    std::vector<double> speed_mps;
    for (std::size_t run = 0; run < settings.runs; ++run) {
      World world{world_seed(settings, run), variant.beat};
      const auto pilot = variant.make(true, Gates::all);
      std::vector<double> believed_mps;
      while (world.now_s() < 5) {
        pilot->sense(world.step({}), world.beat());
        const FieldVelocity velocity = pilot->estimate().velocity;
        believed_mps.push_back(std::hypot(velocity.x, velocity.y));
      }
      speed_mps.push_back(mean(believed_mps));
    }
    result.rows.push_back(
        row("H rest", "velocity error at rest", "m/s", variant, 0.045, mean_of(speed_mps, settings.seed)));
  }
  return result;
}

}  // namespace

std::vector<Experiment> soccer_experiments(const Settings& settings) {
  std::vector<Experiment> all;
  for (const auto& run : {directions_table, square, gap, outliers, rest}) all.push_back(run(settings));
  return all;
}

}  // namespace regista::reproduce
