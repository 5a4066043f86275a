// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <memory>
#include <numbers>
#include <regista/control/kinematics.hpp>
#include <regista/control/odometry.hpp>
#include <regista/control/orientation_filter.hpp>
#include <regista/control/rollback.hpp>
#include <regista/control/trajectory_tracker.hpp>
#include <regista/control/translation_filter.hpp>
#include <regista/control/velocity_profile.hpp>
#include <regista/sim/imu.hpp>
#include <regista/sim/vision.hpp>
#include <regista/sim/wheeled_robot.hpp>

#include "experiments.hpp"

namespace reproduce {
namespace {

using namespace regista;
using namespace std::chrono_literals;

constexpr double pi = std::numbers::pi;
constexpr double wheel_radius_m = 0.035;
constexpr double wheel_distance_m = 0.08;
const control::Kinematics kinematics =
    control::Kinematics::omni({pi / 4, 3 * pi / 4, 5 * pi / 4, 7 * pi / 4}, wheel_distance_m);

/// The robot that he blames: wheels off their centre and gears of unequal friction. He gives no figures; these are
/// guesses, within what a workshop leaves, that make the wheels alone err as much as his did.
sim::WheeledRobotParameters used_robot(std::uint64_t seed) {
  sim::WheeledRobotParameters robot = sim::ssl_robot();
  constexpr std::array off_centre_m{0.002, -0.003, 0.004, -0.001};
  constexpr std::array gear_friction_nm{0.0, 0.065, 0.0, 0.025};
  for (std::size_t i = 0; i < robot.wheels.size(); ++i) {
    robot.wheels[i].x_m += off_centre_m[i];
    robot.wheels[i].y_m -= off_centre_m[(i + 1) % 4];
    robot.wheels[i].coulomb_nm = gear_friction_nm[i];
  }
  robot.rough_nm = 0.03;
  robot.seed = seed;
  return robot;
}

/// What a robot's computer gets in one of its beats.
struct Senses {
  sim::Imu::Reading imu;                                    ///< without what it read at rest
  control::WheelSpeeds measured = control::WheelSpeeds(4);  ///< by the boards
  control::WheelSpeeds counted = control::WheelSpeeds(4);   ///< from the edges counted in this beat
  std::vector<sim::Detection> vision;
};

struct Disturbances {
  double flip = 0;
  double teleport = 0;
  double gap_from_s = 0;  ///< no vision from here
  double gap_until_s = 0;
};

/// One run: a robot at the origin of the floor, below a camera. Time 0 is when it may move.
class World {
 public:
  World(std::uint64_t seed, Duration beat, const Disturbances& disturbances = {})
      : beat_{beat},
        disturbances_{disturbances},
        robot_{used_robot(seed * 8 + 1)},
        imu_{{.accel_bias_walk_mps2_per_root_s = 0.003, .seed = seed * 8 + 2}},
        vision_{{.flip = disturbances.flip, .teleport = disturbances.teleport, .seed = seed * 8 + 3}} {
    zero_imu();
  }

  /// Hold `command` for one beat.
  const Senses& step(const BodyVelocity& command) {
    std::array<double, 4> wheels{};
    std::ranges::transform(kinematics.wheels(command), wheels.begin(), [](double rim) { return rim / wheel_radius_m; });
    robot_.command(wheels);
    return listen();
  }

  [[nodiscard]] const Pose2d& truth() const { return robot_.state().pose; }
  [[nodiscard]] Duration beat() const { return beat_; }
  [[nodiscard]] double now_s() const { return seconds(now_); }

 private:
  void zero_imu() {
    sim::Imu::Reading sum;
    const int beats = static_cast<int>(1s / beat_);
    for (int i = 0; i < beats; ++i) {
      listen();
      sum.accel_x_mps2 += senses_.imu.accel_x_mps2 / beats;
      sum.accel_y_mps2 += senses_.imu.accel_y_mps2 / beats;
      sum.rate_radps += senses_.imu.rate_radps / beats;
    }
    zero_ = sum;
    now_ = {};
  }

  const Senses& listen() {
    constexpr Duration tick = 5ms;
    const auto before = robot_.state();
    senses_.vision.clear();
    double accel_x = 0, accel_y = 0;
    for (Duration t = tick; t <= beat_; t += tick) {
      const auto& state = robot_.step(tick);
      now_ += tick;
      accel_x += state.accel_x_mps2 * seconds(tick) / seconds(beat_);
      accel_y += state.accel_y_mps2 * seconds(tick) / seconds(beat_);
      for (sim::Detection seen : vision_.step(state.pose, tick)) {
        seen.age += beat_ - t;
        const bool lost = now_s() >= disturbances_.gap_from_s && now_s() < disturbances_.gap_until_s;
        if (!lost) senses_.vision.push_back(seen);
      }
    }
    const auto& state = robot_.state();
    const double rate = angle_between(before.pose.heading, state.pose.heading) / seconds(beat_);
    senses_.imu = imu_.read(accel_x, accel_y, rate, seconds(beat_));
    senses_.imu.accel_x_mps2 -= zero_.accel_x_mps2;
    senses_.imu.accel_y_mps2 -= zero_.accel_y_mps2;
    senses_.imu.rate_radps -= zero_.rate_radps;
    constexpr double rim_per_edge_m = 2 * pi * wheel_radius_m / (9 * 16);
    for (std::size_t i = 0; i < 4; ++i) {
      senses_.measured[i] = state.wheels[i].measured_radps * wheel_radius_m;
      senses_.counted[i] =
          static_cast<double>(state.wheels[i].count - before.wheels[i].count) * rim_per_edge_m / seconds(beat_);
    }
    return senses_;
  }

  Duration beat_;
  Disturbances disturbances_;
  sim::WheeledRobot robot_;
  sim::Imu imu_;
  sim::Vision vision_;
  sim::Imu::Reading zero_;
  Duration now_{};
  Senses senses_;
};

/// What runs on the robot.
class Pilot {
 public:
  virtual ~Pilot() = default;
  virtual void sense(const Senses& senses, Duration beat) = 0;
  /// Towards a goal, for the next beat. True when the plan has ended.
  virtual bool steer(const Pose2d& goal, Duration beat, BodyVelocity& command) = 0;
  [[nodiscard]] virtual control::MotionState estimate() const = 0;
};

/// H, wheels only: the plan's velocity goes to the boards, and nothing comes back.
class OpenLoop final : public Pilot {
 public:
  void sense(const Senses&, Duration) override {}
  bool steer(const Pose2d& goal, Duration beat, BodyVelocity& command) override {
    if (!plan_)
      plan_ = control::MotionPlanner{control::TrajectoryTrackerConfig::published().profile}.plan(
          {}, {.pose = goal, .velocity = {}});
    elapsed_ += beat;
    const auto wanted = plan_->at(elapsed_);
    command = to_body(wanted.velocity, wanted.pose.heading);
    return elapsed_ >= from_seconds(plan_->duration_s());
  }
  [[nodiscard]] control::MotionState estimate() const override { return plan_->at(elapsed_); }

 private:
  std::optional<control::MotionPlan> plan_;
  Duration elapsed_{};
};

/// A pilot with feedback: estimators differ, and the tracker's gains.
class Tracking : public Pilot {
 public:
  explicit Tracking(const control::TrajectoryTrackerConfig& config) : tracker_{config} {}
  bool steer(const Pose2d& goal, Duration beat, BodyVelocity& command) final {
    const auto step = tracker_.step(estimate().pose, goal, beat);
    command = step.command;
    return step.plan_ended;
  }

 private:
  control::TrajectoryTracker tracker_;
};

/// Ours: the plan's velocity fed forward, and gains as high as the chain's delay allows. No integral: what the boards'
/// integrators leave is small, and ours would only overshoot.
control::TrajectoryTrackerConfig our_tracker() {
  auto config = control::TrajectoryTrackerConfig::published();
  config.translation_proportional = 15;
  config.translation_integral = 0;
  config.rotation_proportional = 10;
  config.rotation_integral = 0;
  config.feed_forward = 1;
  return config;
}

/// Ours, wheels only: odometry from the edges that the boards count.
class OnWheels final : public Tracking {
 public:
  OnWheels() : Tracking{our_tracker()} {}
  void sense(const Senses& senses, Duration beat) override {
    velocity_ = kinematics.body(senses.counted);
    odometry_.step(velocity_, beat);
  }
  [[nodiscard]] control::MotionState estimate() const override {
    return {.pose = odometry_.pose(), .velocity = to_field(velocity_, odometry_.pose().heading)};
  }

 private:
  control::Odometry odometry_;
  BodyVelocity velocity_;
};

constexpr double vision_sd_m = 0.004;  // sim::VisionParameters
constexpr double vision_sd_rad = 0.010;
constexpr double no_gate = 1e6;
constexpr double wide_gate = 30;  // leaves the decision to the turn rate

enum class Gates { none, all };

/// H: vision corrects what accelerometer and gyro predict, as if it were of now; three PI. His gate for outliers is one
/// on the turn rate; positions have the like.
class PublishedFusion final : public Tracking {
 public:
  PublishedFusion(bool vision, Gates gates)
      : Tracking{control::TrajectoryTrackerConfig::published()},
        vision_{vision},
        translation_{translation(gates)},
        orientation_{orientation(gates)} {
    translation_.correct(control::PositionMeasurement{.x = 0, .y = 0, .sd_m = vision_sd_m});
    translation_.correct(control::VelocityMeasurement{.x = 0, .y = 0, .sd_mps = 0.001});
    orientation_.correct({.heading_rad = 0, .sd_rad = vision_sd_rad});
  }
  void sense(const Senses& senses, Duration beat) override {
    orientation_.predict(senses.imu.rate_radps, beat);
    const FieldVelocity accel = to_field(BodyVelocity{.x = senses.imu.accel_x_mps2, .y = senses.imu.accel_y_mps2},
                                         orientation_.estimate().heading_rad);
    translation_.predict({.x = accel.x, .y = accel.y}, beat);
    if (!vision_) return;
    for (const sim::Detection& seen : senses.vision) {
      orientation_.correct({.heading_rad = seen.pose.heading, .sd_rad = vision_sd_rad});
      translation_.correct(control::PositionMeasurement{.x = seen.pose.x, .y = seen.pose.y, .sd_m = vision_sd_m});
    }
  }
  [[nodiscard]] control::MotionState estimate() const override {
    const auto at = translation_.estimate();
    const auto turned = orientation_.estimate();
    return {.pose = {.x = at.x, .y = at.y, .heading = turned.heading_rad},
            .velocity = {.x = at.vx, .y = at.vy, .w = turned.w_radps}};
  }

 private:
  static control::TranslationConfig translation(Gates gates) {
    control::TranslationConfig config{.gate = gates == Gates::all ? wide_gate : no_gate};
    if (gates == Gates::all) config.max_speed_mps = 2;
    return config;
  }
  static control::OrientationConfig orientation(Gates gates) {
    auto config = control::OrientationConfig::holtzhausen();
    config.gate = gates == Gates::all ? wide_gate : no_gate;
    if (gates == Gates::all) config.max_turn_rate_radps = 10;
    return config;
  }

  bool vision_;
  control::TranslationFilter translation_;
  control::OrientationFilter orientation_;
};

/// Ours: the wheels too, the gyro's bias, vision at the time of its capture, and a gate on the innovation.
class OurFusion final : public Tracking {
 public:
  OurFusion(bool vision, Gates gates)
      : Tracking{our_tracker()},
        vision_{vision},
        translation_{control::TranslationFilter{{.acceleration_density = 5e-4, .gate = gate(gates)}}},
        orientation_{control::OrientationFilter{{.rate_density = 1e-6, .bias_density = 1e-7, .gate = gate(gates)}}} {
    translation_.correct(control::PositionMeasurement{.x = 0, .y = 0, .sd_m = vision_sd_m});
    orientation_.correct({.heading_rad = 0, .sd_rad = vision_sd_rad});
  }
  void sense(const Senses& senses, Duration beat) override {
    orientation_.predict(senses.imu.rate_radps, beat);
    const double heading = orientation_.filter().estimate().heading_rad;
    const FieldVelocity accel =
        to_field(BodyVelocity{.x = senses.imu.accel_x_mps2, .y = senses.imu.accel_y_mps2}, heading);
    translation_.predict({.x = accel.x, .y = accel.y}, beat);
    const FieldVelocity wheels = to_field(kinematics.body(senses.counted), heading);
    translation_.correct(control::VelocityMeasurement{.x = wheels.x, .y = wheels.y, .sd_mps = wheels_sd_mps});
    if (!vision_) return;
    for (const sim::Detection& seen : senses.vision) {
      orientation_.correct({.heading_rad = seen.pose.heading, .sd_rad = vision_sd_rad}, seen.age);
      translation_.correct(control::PositionMeasurement{.x = seen.pose.x, .y = seen.pose.y, .sd_m = vision_sd_m},
                           seen.age);
    }
  }
  [[nodiscard]] control::MotionState estimate() const override {
    const auto at = translation_.filter().estimate();
    const auto turned = orientation_.filter().estimate();
    return {.pose = {.x = at.x, .y = at.y, .heading = turned.heading_rad},
            .velocity = {.x = at.vx, .y = at.vy, .w = turned.w_radps}};
  }

 private:
  // One edge in a beat of 5 ms is 0.3 m/s at a wheel.
  static constexpr double wheels_sd_mps = 0.15;
  static double gate(Gates gates) { return gates == Gates::all ? 4 : no_gate; }

  bool vision_;
  control::Rollback<control::TranslationFilter, 128> translation_;
  control::Rollback<control::OrientationFilter, 128> orientation_;
};

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

/// The controllers of this chapter, each with the beat that it runs at.
struct Variant {
  std::string controller;  ///< of Row
  std::string name;
  Duration beat;
  std::function<std::unique_ptr<Pilot>(bool vision, Gates gates)> make;
};

const Variant published_wheels{"published", "published, wheels only", 20ms,
                               [](bool, Gates) { return std::make_unique<OpenLoop>(); }};
const Variant our_wheels{"ours", "ours, wheels only", 5ms, [](bool, Gates) { return std::make_unique<OnWheels>(); }};
const Variant published_fusion{"published", "published, fused", 20ms, [](bool vision, Gates gates) {
                                 return std::make_unique<PublishedFusion>(vision, gates);
                               }};
const Variant our_fusion{"ours", "ours, fused", 5ms,
                         [](bool vision, Gates gates) { return std::make_unique<OurFusion>(vision, gates); }};

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
  Experiment result{.title = "H tables 7.1 to 7.4: one metre in eight directions",
                    .text =
                        "A soccer robot drives 1 m to 0°, 45° … 315° and rests for a second; then its true way is "
                        "measured. *Published, wheels only* sends the velocity of the plan to the motor boards and "
                        "leaves the rest to their loops (P 1.1, I 2). *Published, fused* closes three PI loops over "
                        "H's two Kalman filters on accelerometer, gyro and vision. *Ours, wheels only* tracks the "
                        "same plan on odometry; *ours, fused* adds wheels, gyro bias and the age of each frame to "
                        "the filters and feeds the plan's velocity forward.",
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
  for (const auto& [variant, published] : {std::pair{&published_wheels, &wheels},
                                           {&our_wheels, &wheels},
                                           {&published_fusion, &fused},
                                           {&our_fusion, &fused}}) {
    const Moves moves = eight_directions(settings, *variant);
    const std::string how = published == &wheels ? ", wheels only" : ", fused";
    const auto& angles = moves.direction_deg;
    result.rows.push_back(row(published->source, "direction error, largest mean of a direction, either way" + how,
                              "deg", *variant, published->mean_deg,
                              over_directions(angles, settings, size_of_mean, largest)));
    result.rows.push_back(row(published->source, "direction error, mean sd of a direction" + how, "deg", *variant,
                              published->mean_sd_deg, over_directions(angles, settings, standard_deviation, mean)));
    result.rows.push_back(row(published->source, "direction error, largest sd of a direction" + how, "deg", *variant,
                              published->max_sd_deg, over_directions(angles, settings, standard_deviation, largest)));
    const Estimate distance = over_directions(moves.distance_error, settings, mean_size, mean);
    result.rows.push_back(row(published->source, "distance error, mean of all moves" + how, "%", *variant,
                              published->distance_percent,
                              {.value = 100 * distance.value, .low = 100 * distance.low, .high = 100 * distance.high}));
    Line ends{.name = variant->name, .x = {}, .y = {}, .dots = true};
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
    for (const Variant* variant : {&published_fusion, &our_fusion}) {
      std::vector<double> closing_m;
      for (std::size_t run = 0; run < settings.runs; ++run) {
        World world{world_seed(settings, run), variant->beat};
        const auto pilot = variant->make(vision, Gates::all);
        Trace trace = drive(world, *pilot, corners);
        closing_m.push_back(std::hypot(world.truth().x, world.truth().y));
        if (run == 0) {
          result.plots[0].lines.push_back({.name = variant->controller + (vision ? ", vision" : ", no vision"),
                                           .x = std::move(trace.x_m),
                                           .y = std::move(trace.y_m)});
        }
      }
      result.rows.push_back(row("H square", vision ? "closing error with vision" : "closing error without vision", "m",
                                *variant, vision ? 0.088 : 0.542, mean_of(closing_m, settings.seed),
                                !vision && variant == &our_fusion ? "on IMU and wheels" : ""));
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
  for (const Variant* variant : {&published_fusion, &our_fusion}) {
    std::vector<double> more_percent;
    for (std::size_t run = 0; run < settings.runs; ++run) {
      const auto trace = [&](const Disturbances& disturbances) {
        World world{world_seed(settings, run), variant->beat, disturbances};
        return drive(world, *variant->make(true, Gates::all), std::array{Pose2d{.x = 1}});
      };
      Trace all = trace({}), some = trace(half_a_second);
      // The last sample before frames come again.
      const auto after = std::ranges::lower_bound(some.t_s, half_a_second.gap_until_s - 1e-6);
      const auto last = static_cast<std::size_t>(after - some.t_s.begin() - 1);
      more_percent.push_back(100 * (some.off_m[last] - all.off_m[last]));
      if (run == 0) {
        result.plots[0].lines.push_back({.name = variant->name, .x = std::move(some.t_s), .y = std::move(some.off_m)});
      }
    }
    result.rows.push_back(row(
        "H gap", "rise of the position error over 500 ms without vision", "% of the way", *variant, 2.5,
        mean_of(more_percent, settings.seed),
        variant == &our_fusion ? "" : "its frames are 30 ms old and taken for new, so without them that lag fades"));
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
  for (const Variant* variant : {&published_fusion, &our_fusion}) {
    std::array<std::vector<double>, 2> off_m, off_rad;  // without gates, with them
    for (std::size_t run = 0; run < settings.runs; ++run) {
      for (const Gates gates : {Gates::none, Gates::all}) {
        World world{world_seed(settings, run), variant->beat, {.flip = 0.03, .teleport = 0.03}};
        const auto pilot = variant->make(true, gates);
        Trace trace = drive(world, *pilot, goal);
        off_m[gates == Gates::all ? 1 : 0].push_back(trace.rms_m());
        off_rad[gates == Gates::all ? 1 : 0].push_back(trace.rms_rad());
        if (run == 0) {
          result.plots[0].lines.push_back(
              {.name = variant->controller + (gates == Gates::all ? ", gates" : ", no gates"),
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
        row("H outliers", "change of the position's error by the gates", "%", *variant, -81.54, change(off_m)));
    result.rows.push_back(
        row("H outliers", "change of the heading's error by the gates", "%", *variant, -91.56, change(off_rad)));
  }
  return result;
}

Experiment rest(const Settings& settings) {
  Experiment result{.title = "H: velocity at rest",
                    .text = "The robot stands for five seconds: the mean speed that its filter believes in.",
                    .rows = {},
                    .plots = {}};
  for (const Variant* variant : {&published_fusion, &our_fusion}) {
    std::vector<double> speed_mps;
    for (std::size_t run = 0; run < settings.runs; ++run) {
      World world{world_seed(settings, run), variant->beat};
      const auto pilot = variant->make(true, Gates::all);
      std::vector<double> believed_mps;
      while (world.now_s() < 5) {
        pilot->sense(world.step({}), world.beat());
        const FieldVelocity velocity = pilot->estimate().velocity;
        believed_mps.push_back(std::hypot(velocity.x, velocity.y));
      }
      speed_mps.push_back(mean(believed_mps));
    }
    result.rows.push_back(
        row("H rest", "velocity error at rest", "m/s", *variant, 0.045, mean_of(speed_mps, settings.seed)));
  }
  return result;
}

}  // namespace

std::vector<Experiment> soccer_experiments(const Settings& settings) {
  std::vector<Experiment> all;
  for (const auto& run : {directions_table, square, gap, outliers, rest}) all.push_back(run(settings));
  return all;
}

}  // namespace reproduce
