// SPDX-License-Identifier: Apache-2.0
#include "regista/control/translation_filter.hpp"

#include "parameter.hpp"

namespace regista::control {
namespace {

using Scalar = Eigen::Matrix<double, 1, 1>;

}  // namespace

TranslationFilter::TranslationFilter(const TranslationConfig& config) : config_{config} {
  require_not_negative("acceleration_density", config.acceleration_density);
  require_positive("initial_speed_sd_mps", config.initial_speed_sd_mps);
  require(config.gate > 0, "gate", config.gate, "give a positive number of standard deviations, 4 is usual");
  require(config.max_speed_mps > 0, "max_speed_mps", config.max_speed_mps, "give a positive speed, or infinity");
  require(config.restart_after > 0, "restart_after", config.restart_after, "give at least 1");
  require_positive("lost_sd_m", config.lost_sd_m);
}

void TranslationFilter::predict(const Input& acceleration, Duration dt) {
  if (sane(acceleration.x) && sane(acceleration.y)) {
    state_.input = acceleration;
  } else {
    ++state_.refused_inputs;
  }
  if (dt <= Duration::zero()) return;
  state_.position.unseen += dt;
  state_.velocity.unseen += dt;
  if (!state_.initialised) return;
  const double t = seconds(dt);
  const double d = config_.acceleration_density;
  const Eigen::RowVector2d a{state_.input.x, state_.input.y};
  Eigen::Matrix2d input;
  input << t * t / 2 * a, t * a;
  state_.kalman.predict(Eigen::Matrix2d{{1, t}, {0, 1}},
                        Eigen::Matrix2d{{d * t * t * t / 3, d * t * t / 2}, {d * t * t / 2, d * t}}, input);
}

Correction TranslationFilter::correct(const Measurement& measurement) {
  return std::visit([this](const auto& one) { return take(one); }, measurement);
}

Correction TranslationFilter::take(const PositionMeasurement& z) {
  SensorRecord& record = state_.position;
  if (!sane(z.x) || !sane(z.y) || !sane(z.sd_m) || !(z.sd_m > 0)) return record.note(Verdict::invalid);
  if (!state_.initialised) {
    start_at(z);
    return record.note(Verdict::initialised);
  }
  const Eigen::RowVector2d fix{z.x, z.y};
  Correction result{.verdict = Verdict::too_fast};
  // Two fixes of a body at rest lie up to `gate` standard deviations of their difference apart.
  const double reach = config_.max_speed_mps * seconds(record.unseen) + config_.gate * std::sqrt(2.0) * z.sd_m;
  if (!((fix - state_.fix).squaredNorm() > reach * reach)) {  // so that infinity times 0 s is no limit either
    const auto [nis, fused] = state_.kalman.correct<1>(fix - state_.kalman.x.row(0), Eigen::RowVector2d{1, 0},
                                                       Scalar{z.sd_m * z.sd_m}, config_.gate);
    result = {.verdict = fused ? Verdict::fused : Verdict::outlier, .nis = nis};
  }
  if (result.verdict == Verdict::fused) {
    state_.fix = fix;
  } else if (record.refused_in_a_row + 1 >= config_.restart_after) {
    start_at(z);
    result.verdict = Verdict::restarted;
  }
  return record.note(result.verdict, result.nis);
}

Correction TranslationFilter::take(const VelocityMeasurement& z) {
  SensorRecord& record = state_.velocity;
  if (!sane(z.x) || !sane(z.y) || !sane(z.sd_mps) || !(z.sd_mps > 0)) return record.note(Verdict::invalid);
  if (!state_.initialised) return record.note(Verdict::waiting);
  const auto [nis, fused] =
      state_.kalman.correct<1>(Eigen::RowVector2d{z.x, z.y} - state_.kalman.x.row(1), Eigen::RowVector2d{0, 1},
                               Scalar{z.sd_mps * z.sd_mps}, config_.gate);
  return record.note(fused ? Verdict::fused : Verdict::outlier, nis);
}

void TranslationFilter::start_at(const PositionMeasurement& z) {
  state_.initialised = true;
  state_.fix = {z.x, z.y};
  state_.kalman.x << state_.fix, 0, 0;
  const double speed_sd = config_.initial_speed_sd_mps;
  state_.kalman.p = Eigen::Vector2d{z.sd_m * z.sd_m, speed_sd * speed_sd}.asDiagonal();
}

TranslationFilter::Estimate TranslationFilter::estimate() const {
  const auto& [x, p] = state_.kalman;
  return {.x = x(0, 0),
          .y = x(0, 1),
          .vx = x(1, 0),
          .vy = x(1, 1),
          .position_sd_m = std::sqrt(p(0, 0)),
          .speed_sd_mps = std::sqrt(p(1, 1))};
}

bool TranslationFilter::lost() const {
  return !state_.initialised || !(state_.kalman.p(0, 0) <= config_.lost_sd_m * config_.lost_sd_m);
}

}  // namespace regista::control
