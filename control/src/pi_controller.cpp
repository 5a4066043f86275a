// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <regista/control/pi_controller.hpp>

#include "parameter.hpp"

namespace regista::control {

PiController::PiController(const PiGains& gains) : gains_{gains} {
  require_not_negative("proportional", gains.proportional);
  require_not_negative("integral", gains.integral);
  require_not_negative("derivative", gains.derivative);
  require_positive("output_limit", gains.output_limit);
  require(gains.reset_jump > 0, "reset_jump", gains.reset_jump, "give a part above 0, or infinity for never");
}

double PiController::step(double set_point, double measured, Duration dt) {
  if (!sane(set_point) || !sane(measured)) {
    ++refused_;
    return 0;
  }
  const double dt_s = seconds(dt);
  const double limit = gains_.output_limit;
  if (started_ && std::abs(set_point - set_point_) > gains_.reset_jump * std::abs(set_point_)) integral_ = 0;

  const double error = set_point - measured;
  double direct = gains_.proportional * error;
  if (started_ && dt_s > 0) direct -= gains_.derivative * (measured - measured_) / dt_s;
  const double integral = integral_ + gains_.integral * error * dt_s;
  const bool driven_further = std::abs(direct + integral) > limit && error * (direct + integral) > 0;
  if (!driven_further) integral_ = integral;

  set_point_ = set_point;
  measured_ = measured;
  started_ = true;
  return std::clamp(direct + integral_, -limit, limit);
}

}  // namespace regista::control
