// SPDX-License-Identifier: Apache-2.0
#include "regista/control/complementary_filter.hpp"

#include <regista/core/geometry.hpp>
#include <utility>

#include "parameter.hpp"

namespace regista::control {

ComplementaryFilter::ComplementaryFilter(const ComplementaryConfig& config) : config_{config} {
  require_positive("time_constant_s", config.time_constant_s);
  require(config.max_turn_rate_radps > 0, "max_turn_rate_radps", config.max_turn_rate_radps,
          "give a positive rate, or infinity");
  require(config.gate > 0, "gate", config.gate, "give a positive number of standard deviations, 4 is usual");
  require(config.restart_after > 0, "restart_after", config.restart_after, "give at least 1");
}

void ComplementaryFilter::predict(const Input& rate_radps, Duration dt) {
  if (sane(rate_radps)) {
    state_.input = rate_radps;
  } else {
    ++state_.refused_inputs;
  }
  if (dt <= Duration::zero()) return;
  state_.heading.unseen += dt;
  state_.heading_rad = wrap_angle(state_.heading_rad + state_.input * seconds(dt));
}

Correction ComplementaryFilter::correct(const Measurement& z) {
  SensorRecord& record = state_.heading;
  if (!sane(z.heading_rad) || !sane(z.sd_rad) || !(z.sd_rad > 0)) return record.note(Verdict::invalid);
  const double t = seconds(record.unseen);
  const double reach = config_.max_turn_rate_radps * t + config_.gate * std::sqrt(2.0) * z.sd_rad;
  // So that infinity times 0 s is no limit either.
  const bool possible = !(std::abs(angle_between(state_.fix_rad, z.heading_rad)) > reach);
  if (state_.initialised && !possible && record.refused_in_a_row + 1 < config_.restart_after) {
    return record.note(Verdict::too_fast);
  }
  state_.fix_rad = z.heading_rad;
  if (!state_.initialised || !possible) {
    state_.heading_rad = wrap_angle(z.heading_rad);
    return record.note(std::exchange(state_.initialised, true) ? Verdict::restarted : Verdict::initialised);
  }
  const double share = -std::expm1(-t / config_.time_constant_s);
  state_.heading_rad = wrap_angle(state_.heading_rad + share * angle_between(state_.heading_rad, z.heading_rad));
  return record.note(Verdict::fused);
}

}  // namespace regista::control
