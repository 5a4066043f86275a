// SPDX-License-Identifier: Apache-2.0
#include "soccer_robot.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <numbers>
#include <optional>
#include <regista/control/field_estimator.hpp>
#include <regista/control/odometry.hpp>
#include <regista/control/orientation_filter.hpp>
#include <regista/control/trajectory_tracker.hpp>
#include <regista/control/translation_filter.hpp>

namespace regista::reproduce {
namespace {

using namespace std::chrono_literals;

constexpr double pi = std::numbers::pi;
constexpr double wheel_radius_m = 0.035;

const control::Kinematics& kinematics() {
  static const auto of_the_robot = control::Kinematics::omni({pi / 4, 3 * pi / 4, 5 * pi / 4, 7 * pi / 4}, 0.08);
  return of_the_robot;
}

class OpenLoop final : public Pilot {
 public:
  void sense(const Senses&, Duration) override {}
  bool steer(const Pose2d& goal, Duration beat, BodyVelocity& command) override {
    if (!plan_) {
      const control::MotionPlanner planner{control::TrajectoryTrackerConfig::published().profile};
      plan_ = planner.plan({}, {.pose = goal, .velocity = {}});
    }
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

class OnWheels final : public Tracking {
 public:
  OnWheels() : Tracking{control::TrajectoryTrackerConfig::fed_forward()} {}
  void sense(const Senses& senses, Duration beat) override {
    velocity_ = kinematics().body(senses.counted);
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

/// His gate for outliers is one on the turn rate; positions have the like.
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

class OurFusion final : public Tracking {
 public:
  OurFusion(bool vision, Gates gates)
      : Tracking{control::TrajectoryTrackerConfig::fed_forward()}, vision_{vision}, estimator_{config(gates)} {}
  void sense(const Senses& senses, Duration beat) override {
    estimator_.predict({.accel_x_mps2 = senses.imu.accel_x_mps2,
                        .accel_y_mps2 = senses.imu.accel_y_mps2,
                        .rate_radps = senses.imu.rate_radps},
                       beat);
    estimator_.correct(kinematics().body(senses.counted));
    if (!vision_) return;
    for (const sim::Detection& seen : senses.vision) estimator_.correct(seen.pose, seen.age);
  }
  [[nodiscard]] control::MotionState estimate() const override { return estimator_.estimate(); }

 private:
  static control::FieldEstimatorConfig config(Gates gates) {
    control::FieldEstimatorConfig config;
    config.translation.gate = config.orientation.gate = gates == Gates::all ? 4 : no_gate;
    return config;
  }

  bool vision_;
  control::FieldEstimator estimator_;
};

}  // namespace

World::World(std::uint64_t seed, Duration beat, const Disturbances& disturbances)
    : beat_{beat},
      disturbances_{disturbances},
      robot_{sim::used_ssl_robot(seed * 8 + 1)},
      imu_{{.accel_bias_walk_mps2_per_root_s = 0.003, .seed = seed * 8 + 2}},
      vision_{{.flip = disturbances.flip, .teleport = disturbances.teleport, .seed = seed * 8 + 3}} {
  zero_imu();
}

const Senses& World::step(const BodyVelocity& command) {
  std::array<double, 4> wheels{};
  std::ranges::transform(kinematics().wheels(command), wheels.begin(), [](double rim) { return rim / wheel_radius_m; });
  robot_.command(wheels);
  return listen();
}

void World::zero_imu() {
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

const Senses& World::listen() {
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
    senses_.counted[i] =
        static_cast<double>(state.wheels[i].count - before.wheels[i].count) * rim_per_edge_m / seconds(beat_);
  }
  return senses_;
}

Variant published_wheels() {
  return {"published", "published, wheels only", 20ms, [](bool, Gates) { return std::make_unique<OpenLoop>(); }};
}

Variant our_wheels() {
  return {"ours", "ours, wheels only", 5ms, [](bool, Gates) { return std::make_unique<OnWheels>(); }};
}

Variant published_fusion() {
  return {"published", "published, fused", 20ms,
          [](bool vision, Gates gates) { return std::make_unique<PublishedFusion>(vision, gates); }};
}

Variant our_fusion() {
  return {"ours", "ours, fused", 5ms,
          [](bool vision, Gates gates) { return std::make_unique<OurFusion>(vision, gates); }};
}

}  // namespace regista::reproduce
