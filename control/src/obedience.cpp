// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <regista/control/obedience.hpp>

#include "parameter.hpp"

namespace regista::control {

Obedience::Obedience(const ObedienceConfig& config) : config_{config} {
  require_positive("patience", seconds(config.patience));
  require_positive("speed_mps", config.speed_mps);
  require_positive("turn_radps", config.turn_radps);
}

bool Obedience::step(const BodyVelocity& commanded, const std::optional<BodyVelocity>& measured, Duration dt) {
  const auto close = [](double command, double measure, double allowed) {
    return std::abs(measure - command) <= std::max(allowed, std::abs(command) / 2);  // NaN is not close
  };
  const bool obeys = measured && close(commanded.x, measured->x, config_.speed_mps) &&
                     close(commanded.y, measured->y, config_.speed_mps) &&
                     close(commanded.w, measured->w, config_.turn_radps);
  disobeyed_ = obeys ? Duration{} : disobeyed_ + dt;
  return disobeyed_ <= config_.patience;
}

}  // namespace regista::control
