// SPDX-License-Identifier: Apache-2.0
#include "regista/control/orientation_filter.hpp"

#include <regista/core/geometry.hpp>

#include "parameter.hpp"

namespace regista::control {

OrientationFilter::OrientationFilter(const OrientationConfig& config) : config_{config} {
  require_not_negative("rate_density", config.rate_density);
  require_not_negative("bias_density", config.bias_density);
  require_not_negative("initial_bias_sd_radps", config.initial_bias_sd_radps);
  require(config.gate > 0, "gate", config.gate, "give a positive number of standard deviations, 4 is usual");
  require(config.max_turn_rate_radps > 0, "max_turn_rate_radps", config.max_turn_rate_radps,
          "give a positive rate, or infinity");
  require(config.restart_after > 0, "restart_after", config.restart_after, "give at least 1");
  require_positive("lost_sd_rad", config.lost_sd_rad);
}

void OrientationFilter::predict(const Input& rate_radps, Duration dt) {
  if (sane(rate_radps)) {
    state_.input = rate_radps;
  } else {
    ++state_.refused_inputs;
  }
  if (dt <= Duration::zero()) return;
  state_.heading.unseen += dt;
  if (!state_.initialised) return;
  // heading' = rate - bias; the noise of the rate and, integrated, that of the bias.
  const double t = seconds(dt);
  const double b = config_.bias_density;
  const Eigen::Matrix2d q{{config_.rate_density * t + b * t * t * t / 3, -b * t * t / 2}, {-b * t * t / 2, b * t}};
  state_.kalman.predict(Eigen::Matrix2d{{1, -t}, {0, 1}}, q, Eigen::Vector2d{state_.input * t, 0});
  state_.kalman.x(0) = wrap_angle(state_.kalman.x(0));
}

Correction OrientationFilter::correct(const Measurement& z) {
  SensorRecord& record = state_.heading;
  if (!sane(z.heading_rad) || !sane(z.sd_rad) || !(z.sd_rad > 0)) return record.note(Verdict::invalid);
  if (!state_.initialised) {
    start_at(z);
    return record.note(Verdict::initialised);
  }
  Correction result{.verdict = Verdict::too_fast};
  const double reach = config_.max_turn_rate_radps * seconds(record.unseen) + config_.gate * std::sqrt(2.0) * z.sd_rad;
  // So that infinity times 0 s is no limit either.
  if (!(std::abs(angle_between(state_.fix_rad, z.heading_rad)) > reach)) {
    const double innovation = angle_between(state_.kalman.x(0), z.heading_rad);
    const auto [nis, fused] =
        state_.kalman.correct<1>(Eigen::Matrix<double, 1, 1>{innovation}, Eigen::RowVector2d{1, 0},
                                 Eigen::Matrix<double, 1, 1>{z.sd_rad * z.sd_rad}, config_.gate);
    result = {.verdict = fused ? Verdict::fused : Verdict::outlier, .nis = nis};
  }
  if (result.verdict == Verdict::fused) {
    state_.kalman.x(0) = wrap_angle(state_.kalman.x(0));
    state_.fix_rad = z.heading_rad;
  } else if (record.refused_in_a_row + 1 >= config_.restart_after) {
    start_at(z);
    result.verdict = Verdict::restarted;
  }
  return record.note(result.verdict, result.nis);
}

void OrientationFilter::start_at(const HeadingMeasurement& z) {
  state_.initialised = true;
  state_.fix_rad = z.heading_rad;
  const double bias_sd = config_.initial_bias_sd_radps;
  state_.kalman.x = {wrap_angle(z.heading_rad), 0};
  state_.kalman.p = Eigen::Vector2d{z.sd_rad * z.sd_rad, bias_sd * bias_sd}.asDiagonal();
}

OrientationFilter::Estimate OrientationFilter::estimate() const {
  const auto& [x, p] = state_.kalman;
  return {.heading_rad = x(0),
          .w_radps = state_.input - x(1),
          .bias_radps = x(1),
          .heading_sd_rad = std::sqrt(p(0, 0)),
          .bias_sd_radps = std::sqrt(p(1, 1))};
}

bool OrientationFilter::lost() const {
  return !state_.initialised || !(state_.kalman.p(0, 0) <= config_.lost_sd_rad * config_.lost_sd_rad);
}

}  // namespace regista::control
