// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <chrono>
#include <cmath>
#include <numbers>
#include <regista/control/calibration.hpp>
#include <regista/control/kinematics.hpp>
#include <regista/control/pose_ekf.hpp>
#include <regista/control/waypoint_mission.hpp>
#include <regista/sim/gps.hpp>
#include <regista/sim/imu.hpp>
#include <regista/sim/wheeled_robot.hpp>
#include <stdexcept>

#include "experiments.hpp"

namespace regista::reproduce {
namespace {

using namespace std::chrono_literals;

constexpr double pi = std::numbers::pi;
constexpr Duration beat = 20ms;
constexpr double track_m = 0.6;
constexpr double wheel_radius_m = 0.15;
constexpr double gear = 40;
constexpr int edges_a_turn = 64;

const control::Kinematics& kinematics() {
  static const auto of_the_robot = control::Kinematics::differential(track_m);
  return of_the_robot;
}

/// A field robot of 50 kg with two driven wheels: a guess.
sim::WheeledRobot robot(std::uint64_t seed) {
  auto parameters = sim::differential_robot(track_m, 50);
  for (sim::Wheel& wheel : parameters.wheels) {
    wheel.radius_m = wheel_radius_m;
    wheel.gear = gear;
    wheel.inertia_kg_m2 = 0.05;
  }
  parameters.motor = {.nominal_v = 24,
                      .resistance_ohm = 0.5,
                      .torque_constant_nm_per_a = 0.06,
                      .inertia_kg_m2 = 1e-4,
                      .no_load_a = 0.5};
  parameters.battery = {.full_v = 26, .empty_v = 22, .capacity_ah = 20, .resistance_ohm = 0.03};
  parameters.loop = {.p = 10, .i_per_s = 10, .triggers_per_revolution = edges_a_turn};
  parameters.grip = 0.5;
  parameters.rough_nm = 2;
  parameters.seed = seed;
  return sim::WheeledRobot{parameters};
}

/// All of a run but what drives it.
struct Field {
  sim::WheeledRobot robot;
  sim::Gps gps;
  sim::Magnetometer compass;
  sim::Imu imu;
  std::array<std::int64_t, 2> count{};

  struct Senses {
    control::WheelMeasurement wheels;
    double compass_rad = 0;
    double rate_radps = 0;
    std::optional<sim::Gps::Fix> fix;
  };

  Senses step(const BodyVelocity& command) {
    const auto rims = kinematics().wheels(command);
    robot.command(std::array{rims[0] / wheel_radius_m, rims[1] / wheel_radius_m});
    const double before_rad = robot.state().pose.heading;
    const auto& state = robot.step(beat);
    constexpr double rim_per_edge_m = 2 * pi * wheel_radius_m / (gear * edges_a_turn);
    control::WheelSpeeds speeds(2);
    for (std::size_t i = 0; i < 2; ++i) {
      speeds[i] = static_cast<double>(state.wheels[i].count - count[i]) * rim_per_edge_m / seconds(beat);
      count[i] = state.wheels[i].count;
    }
    const BodyVelocity body = kinematics().body(speeds);
    Senses senses{.wheels = {.speed_mps = body.x, .w_radps = body.w, .speed_sd_mps = 0.03, .w_sd_radps = 0.1},
                  .compass_rad = compass.read(state.pose.heading),
                  .rate_radps = imu.read(state.accel_x_mps2, state.accel_y_mps2,
                                         angle_between(before_rad, state.pose.heading) / seconds(beat), seconds(beat))
                                    .rate_radps,
                  .fix = gps.step(state.pose, beat)};
    return senses;
  }
};

struct Brain {
  std::string controller;
  control::WaypointMissionConfig mission;
  control::PoseEkfConfig ekf;
  control::CompassCalibration compass;
  bool gyro = false;
  double gps_sd_m = 0;
  double compass_sd_rad = 0;
};

/// The compass beside a reference, through two full circles.
control::CompassCalibration calibrate_compass(std::uint64_t seed) {
  sim::Magnetometer compass{{.seed = seed}};
  std::vector<control::CompassSample> run;
  for (int i = 0; i < 720; ++i) {
    const double heading = wrap_angle(i * pi / 180);
    run.push_back({.measured_rad = compass.read(heading), .reference_rad = heading});
  }
  auto result = control::CompassCalibration::fit(run);
  if (!result) throw std::runtime_error{result.error().message()};
  return *result;
}

struct Stop {
  double estimate_off_m = 0;  ///< from estimate to goal when it stands there
  double truth_off_m = 0;
  double gps_off_m = 0;     ///< error of the GPS then, noise apart
  double beyond_gps_m = 0;  ///< from truth to goal as the GPS shows it
};

struct Outcome {
  std::vector<Stop> stops;
  bool finished = false;
  std::vector<double> x_m, y_m;
};

Outcome drive(Field field, const Brain& brain, const std::vector<control::Waypoint>& waypoints) {
  control::PoseEkf ekf{brain.ekf};
  control::WaypointMission mission{brain.mission, waypoints};
  Outcome outcome;
  control::WaypointMission::Output out;
  control::ToolReport report;
  for (double t = 0; t < 600 && !outcome.finished; t += seconds(beat)) {
    const auto senses = field.step(out.command);
    ekf.predict({}, beat);
    ekf.correct(senses.wheels);
    if (brain.gyro) ekf.correct(control::GyroMeasurement{.w_radps = senses.rate_radps, .sd_radps = 0.007});
    if (senses.fix) {  // with each fix, so that the compass does not count for more than it knows
      ekf.correct(control::HeadingMeasurement{.heading_rad = brain.compass.corrected(senses.compass_rad),
                                              .sd_rad = brain.compass_sd_rad});
      ekf.correct(control::PositionMeasurement{.x = senses.fix->x_m, .y = senses.fix->y_m, .sd_m = brain.gps_sd_m});
    }
    std::optional<Pose2d> estimate;
    if (ekf.status() == control::PoseEkf::Status::tracking) estimate = ekf.estimate().pose;
    out = mission.step(
        {.estimate = estimate, .wheels = {.x = senses.wheels.speed_mps, .w = senses.wheels.w_radps}, .tool = report},
        beat);
    if (out.tool == control::ToolAction::measure && report.finished != control::ToolAction::measure) {
      const Pose2d goal = waypoints[out.waypoint].pose;
      const Pose2d truth = field.robot.state().pose;
      const sim::Gps::Fix error = field.gps.error();
      outcome.stops.push_back({.estimate_off_m = distance(ekf.estimate().pose, goal),
                               .truth_off_m = distance(truth, goal),
                               .gps_off_m = std::hypot(error.x_m, error.y_m),
                               .beyond_gps_m = std::hypot(truth.x + error.x_m - goal.x, truth.y + error.y_m - goal.y)});
    }
    report = {.finished = out.tool};  // the tool needs one beat
    outcome.finished = out.phase == control::WaypointMission::Phase::finished;
    if (out.phase == control::WaypointMission::Phase::failed) mission.resume();
    outcome.x_m.push_back(field.robot.state().pose.x);
    outcome.y_m.push_back(field.robot.state().pose.y);
  }
  return outcome;
}

/// How fast the GPS's drift wanders, seen from now [m²/s] on each axis: to the robot the field moves below it.
double drift_density(const sim::GpsParameters& gps) { return 2 * gps.drift_m * gps.drift_m / gps.drift_s; }

/// Mean distance that the best filter leaves between a position and its GPS's drift: the steady state of a random walk
/// of that density seen through white noise of density noise² · period has the variance √(product) on each axis, and
/// the distance is Rayleigh's.
double least_distance_m(const sim::GpsParameters& gps) {
  const double variance = std::sqrt(drift_density(gps) * gps.noise_m * gps.noise_m * gps.period_s);
  return std::sqrt(variance * pi / 2);
}

std::vector<control::Waypoint> list(std::initializer_list<Pose2d> poses) {
  std::vector<control::Waypoint> waypoints;
  for (const Pose2d& pose : poses) waypoints.push_back({.pose = pose, .work = control::Work::measure});
  return waypoints;
}

}  // namespace

std::vector<Experiment> waypoint_experiments(const Settings& settings) {
  struct Scenario {
    std::string source, name;
    std::vector<control::Waypoint> waypoints;
    double jump_every_s, loss_every_s;
  };
  const std::array scenarios{
      Scenario{"L scenario 1", "the corners of a square of 10 m",
               list({{10, 0, pi / 2}, {10, 10, pi}, {0, 10, -pi / 2}, {0, 0, 0}}), 0, 0},
      Scenario{"L scenario 2", "six points in two rows, with jumps and losses of the GPS",
               list({{8, 0, 0}, {16, 0, 0}, {24, 4, pi / 2}, {16, 8, pi}, {8, 8, pi}, {0, 8, pi}}), 60, 60}};

  const control::WaypointLawConfig law{.speed_mps = 0.8, .turn_rate_limit_radps = 0.8};
  const std::array brains{
      Brain{.controller = "published",
            .mission = {.law = law, .parking = {.radius_m = 0.4, .leave_radius_m = 0.8, .estimates = 1, .jump_m = 1e6}},
            .ekf = {},
            .compass = {},
            .gyro = false,
            .gps_sd_m = 0.3,
            .compass_sd_rad = 0.1},
      Brain{.controller = "ours",
            .mission = {.law = law, .parking = {.radius_m = 0.07, .leave_radius_m = 0.14, .estimates = 5}},
            .ekf = {.slip_density = drift_density(sim::GpsParameters{})},
            .compass = calibrate_compass(settings.seed),
            .gyro = true,
            .gps_sd_m = 0.1,
            .compass_sd_rad = 0.02}};

  Experiment result{
      .title = "L: two lists of waypoints",
      .text =
          "A field robot drives to each waypoint by Park and Kuipers' law, lowers its tool, measures, "
          "raises it and goes on, on a GPS whose error wanders with a sd of 1 m on each axis (correlation "
          "time 120 s) beside 0.1 m of noise, and on a compass that errs by up to 6.5° with the heading. "
          "Published: an EKF on wheels, GPS and the compass as it is, and a waypoint reached at 0.4 m. "
          "Ours: gyro, a calibrated compass, and parking within 0.07 m in five estimates that agree with "
          "the wheels. The GPS moves the truth by metres whatever the controller does, so beside the truth "
          "stands how far the robot is from where the goal is *in the GPS's own frame*: that is what "
          "navigation can answer for. The lists of "
          "waypoints are ours.",
      .rows = {},
      .plots = {}};
  for (std::size_t s = 0; s < scenarios.size(); ++s) {
    const Scenario& scenario = scenarios[s];
    Plot plot{.file = "l-" + std::to_string(s + 1),
              .title = "L: " + scenario.name,
              .x_label = "x [m]",
              .y_label = "y [m]",
              .lines = {{.name = "waypoints", .x = {}, .y = {}, .dots = true}},
              .same_scale = true};
    for (const auto& waypoint : scenario.waypoints) {
      plot.lines[0].x.push_back(waypoint.pose.x);
      plot.lines[0].y.push_back(waypoint.pose.y);
    }
    for (const Brain& brain : brains) {
      std::vector<double> estimate_m, truth_m, gps_m, beyond_m, finished;
      for (std::size_t run = 0; run < settings.runs; ++run) {
        const std::uint64_t seed = (settings.seed * 1'000'003 + run) * 8;
        Outcome outcome = drive({.robot = robot(seed),
                                 .gps = sim::Gps{{.jump_every_s = scenario.jump_every_s,
                                                  .loss_every_s = scenario.loss_every_s,
                                                  .seed = seed + 1}},
                                 .compass = sim::Magnetometer{{.seed = seed + 2}},
                                 .imu = sim::Imu{{.seed = seed + 3}}},
                                brain, scenario.waypoints);
        Stop sum;
        for (const Stop& stop : outcome.stops) {
          sum.estimate_off_m = std::max(sum.estimate_off_m, stop.estimate_off_m);
          sum.truth_off_m += stop.truth_off_m;
          sum.gps_off_m += stop.gps_off_m;
          sum.beyond_gps_m += stop.beyond_gps_m;
        }
        const auto stops = static_cast<double>(std::max<std::size_t>(outcome.stops.size(), 1));
        estimate_m.push_back(sum.estimate_off_m);
        truth_m.push_back(sum.truth_off_m / stops);
        gps_m.push_back(sum.gps_off_m / stops);
        beyond_m.push_back(sum.beyond_gps_m / stops);
        finished.push_back(static_cast<double>(outcome.stops.size()) / static_cast<double>(scenario.waypoints.size()));
        if (run == 0) {
          plot.lines.push_back({.name = brain.controller, .x = std::move(outcome.x_m), .y = std::move(outcome.y_m)});
        }
      }
      const auto row = [&](std::string quantity, std::string unit, std::string better, std::optional<double> published,
                           std::span<const double> values, std::string note) {
        const Estimate estimate = mean_of(values, settings.seed);
        result.rows.push_back({scenario.source, std::move(quantity), std::move(unit), brain.controller,
                               std::move(better), published, estimate.value, estimate.low, estimate.high,
                               std::move(note)});
      };
      row("share of the waypoints worked at", "1", "higher", std::nullopt, finished, scenario.name);
      row("estimate to goal, worst waypoint of a run", "m", "lower", 0.4, estimate_m, "");
      row("truth to goal", "m", "lower", std::nullopt, truth_m, "");
      row("error of the GPS there", "m", "lower", std::nullopt, gps_m, "the same receiver for both");
      row("truth to goal beyond the GPS's own error", "m", "lower", std::nullopt, beyond_m,
          "noise of the fixes alone allows " + std::to_string(std::lround(1000 * least_distance_m({}))) + " mm");
    }
    result.plots.push_back(std::move(plot));
  }
  return {std::move(result)};
}

}  // namespace regista::reproduce
