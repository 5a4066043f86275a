// SPDX-License-Identifier: Apache-2.0
#include "simulated_gps.hpp"

#include <cmath>
#include <numbers>

namespace regista {

namespace {

constexpr double first_time_s = 1'767'225'600;  // 2026-01-01: a simulation has no date of its own

sim::GpsParameters read_parameters(const Section& config) {
  const Range positive{.min = 1e-3};
  const Range not_negative{.min = 0};
  return {.period_s = config.number("period", 0.2, positive),
          .noise_m = config.length("noise", 0.1, not_negative),
          .drift_m = config.length("drift", 1, not_negative),
          .drift_s = config.number("drift_time", 120, positive),
          .jump_every_s = config.number("jump_every", 0, not_negative),
          .jump_m = config.length("jump", 3, not_negative),
          .loss_every_s = config.number("loss_every", 0, not_negative),
          .loss_s = config.number("loss", 5, positive),
          .seed = static_cast<std::uint64_t>(config.integer("seed", 1, not_negative))};
}

}  // namespace

SimulatedGps::SimulatedGps(Setup& setup)
    : receiver_{setup.provide<Gps>()},
      local_{setup.provide<Localize>()},
      truth_{setup.require<Position2d>()},
      parameters_{read_parameters(setup.config)},
      gps_{parameters_},
      frame_{read_datum(setup.config).value_or(Geodetic{63.4, 10.4, 40})},
      time_s_{first_time_s} {
  truth_.on_data<position2d::State>([this](const position2d::State& state, Time) { base_ = state; });
}

Result<> SimulatedGps::read(const Tick& tick) {
  time_s_ += seconds(tick.dt);
  without_ += tick.dt;
  seen_.reset();
  if (base_) seen_ = gps_.step(base_->pose, tick.dt);
  return {};
}

void SimulatedGps::publish() {
  if (!seen_) {
    if (seconds(without_) > 1.5 * parameters_.period_s) {
      without_ -= from_seconds(parameters_.period_s);
      receiver_.send(to_state({.time_s = time_s_}));
    }
    return;
  }
  without_ = {};
  const FieldVelocity velocity = to_field(base_->velocity, base_->pose.heading);
  const double sd_m = std::hypot(parameters_.noise_m, parameters_.drift_m);
  const Fix fix{.time_s = time_s_,
                .quality = 1,
                .place = frame_.geodetic({.x = seen_->x_m, .y = seen_->y_m}),
                .three_d = true,
                .speed_mps = std::hypot(velocity.x, velocity.y),
                .course_rad = std::atan2(velocity.y, velocity.x) - std::numbers::pi / 2,
                .east_sd_m = sd_m,
                .north_sd_m = sd_m,
                .horizontal_error_m = rayleigh_95 * sd_m,
                .vertical_error_m = 2 * 1.96 * sd_m,  // satellites are above only: twice as bad, as a rule
                .hdop = 0.9,
                .vdop = 1.8,
                .satellites_in_view = 12,
                .satellites_used = 9};
  receiver_.send(to_state(fix));
  local_.send(frame_.to_local(fix));
}

}  // namespace regista
