// SPDX-License-Identifier: Apache-2.0
#include <regista/control/field_estimator.hpp>

#include <algorithm>
#include <cmath>

#include "parameter.hpp"

namespace regista::control {

namespace {

constexpr double vibration_s = 0.03;  ///< time constant: long for gears and rollers, short for who brakes

}  // namespace

FieldEstimator::FieldEstimator(const FieldEstimatorConfig& config)
    : config_{config},
      translation_{TranslationFilter{config.translation}},
      orientation_{OrientationFilter{config.orientation}} {
  require_positive("fix_sd_m", config.fix_sd_m);
  require_positive("fix_sd_rad", config.fix_sd_rad);
  require_positive("wheels_sd_mps", config.wheels_sd_mps);
  require_not_negative("wheels_slip_s", config.wheels_slip_s);
  require_not_negative("wheels_slip_most_mps", config.wheels_slip_most_mps);
  place({});
}

void FieldEstimator::place(const Pose2d& pose) {
  translation_.replace(TranslationFilter{config_.translation});
  translation_.correct(PositionMeasurement{.x = pose.x, .y = pose.y, .sd_m = config_.fix_sd_m});
  orientation_.replace(OrientationFilter{config_.orientation});
  orientation_.correct({.heading_rad = pose.heading, .sd_rad = config_.fix_sd_rad});
  pushed_ = {};
}

void FieldEstimator::predict(const InertialMeasurement& measured, Duration dt) {
  orientation_.predict(measured.rate_radps, dt);
  const FieldVelocity accel = to_field(BodyVelocity{.x = measured.accel_x_mps2, .y = measured.accel_y_mps2},
                                       orientation_.filter().estimate().heading_rad);
  translation_.predict({.x = accel.x, .y = accel.y}, dt);
  const FieldAcceleration& taken = translation_.filter().state().input;
  const double step_s = std::max(0.0, seconds(dt));
  const double share = step_s / (vibration_s + step_s);
  pushed_.x += share * (taken.x - pushed_.x);
  pushed_.y += share * (taken.y - pushed_.y);
}

Correction FieldEstimator::correct(const BodyVelocity& wheels) {
  const FieldVelocity seen = to_field(wheels, orientation_.filter().estimate().heading_rad);
  const double slip_mps =
      std::min(config_.wheels_slip_s * std::hypot(pushed_.x, pushed_.y), config_.wheels_slip_most_mps);
  return translation_.correct(
      VelocityMeasurement{.x = seen.x, .y = seen.y, .sd_mps = std::hypot(config_.wheels_sd_mps, slip_mps)});
}

FieldEstimator::Fix FieldEstimator::correct(const Pose2d& seen, Duration age) {
  Fix fix;
  fix.heading = orientation_.correct({.heading_rad = seen.heading, .sd_rad = config_.fix_sd_rad}, age);
  fix.position = translation_.correct(PositionMeasurement{.x = seen.x, .y = seen.y, .sd_m = config_.fix_sd_m}, age);
  return fix;
}

MotionState FieldEstimator::estimate() const {
  const auto at = translation_.filter().estimate();
  const auto turned = orientation_.filter().estimate();
  return {.pose = {.x = at.x, .y = at.y, .heading = turned.heading_rad},
          .velocity = {.x = at.vx, .y = at.vy, .w = turned.w_radps}};
}

}  // namespace regista::control
