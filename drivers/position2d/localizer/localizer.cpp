// SPDX-License-Identifier: Apache-2.0
#include "localizer.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

namespace regista {

namespace {

using namespace std::chrono_literals;

constexpr Range positive{.min = 1e-9};
constexpr Range not_negative{.min = 0};
constexpr double degrees = 180 / std::numbers::pi;
constexpr Duration explain_period = 500ms;
constexpr double set_position_sd_m = 0.1;  // of a pose that is given without one
constexpr double set_heading_sd_rad = 0.1;
constexpr double most_heading_sd_rad = 1;  // of a fix: one that is less sure says nothing of the heading

control::PoseEkfConfig read_ekf(const Section& config) {
  control::PoseEkfConfig ekf;
  ekf.acceleration_density = config.number("accel_density", ekf.acceleration_density, not_negative);
  ekf.turn_density = config.number("turn_density", ekf.turn_density, not_negative);
  ekf.slip_density = config.number("slip_density", ekf.slip_density, not_negative);
  ekf.gate = config.number("gate", ekf.gate, positive);
  ekf.restart_after =
      static_cast<std::uint32_t>(config.integer("restart_after", ekf.restart_after, {.min = 1, .max = 1000}));
  ekf.align_distance_m = config.length("align", ekf.align_distance_m, positive);
  ekf.lost_position_sd_m = config.length("lost", ekf.lost_position_sd_m, positive);
  ekf.lost_heading_sd_rad = config.angle("lost_heading", ekf.lost_heading_sd_rad, positive);
  return ekf;
}

control::CompassCalibration read_compass(const Section& config) {
  if (!config.has("compass")) return {};
  const auto angles = config.angles("compass");
  if (angles.size() != 5) throw config.error("compass", "must be five angles: A to E of the deviation");
  std::array<double, 5> coefficients{};
  std::ranges::copy(angles, coefficients.begin());
  try {
    return control::CompassCalibration{coefficients};
  } catch (const std::invalid_argument& wrong) {
    throw config.error("compass", wrong.what());
  }
}

std::optional<Pose2d> read_start(const Section& config) {
  if (!config.has("start")) return {};
  const auto place = config.lengths("start");
  const auto angles = config.angles("start");
  if (place.size() != 3) throw config.error("start", "must be x, y and a heading");
  return Pose2d{.x = place[0], .y = place[1], .heading = wrap_angle(angles[2])};
}

template <InterfaceType I>
std::optional<Required<I>> require_if_named(Setup& setup) {
  const auto names = setup.config.device_names("requires");
  const bool named = std::ranges::any_of(names, [](const PlacedName& p) { return p.name.interface == I::code; });
  return named ? std::optional{setup.require<I>()} : std::nullopt;
}

std::string text_of(const char* format, auto... numbers) {
  char text[160];
  (void)std::snprintf(text, sizeof text, format, numbers...);
  return text;
}

}  // namespace

Localizer::Localizer(Setup& setup)
    : pose_{setup.provide<Position2d>()},
      belief_{setup.provide<Localize>()},
      wheels_{setup.require<Position2d>()},
      imu_{require_if_named<Imu>(setup)},
      fixes_{require_if_named<Localize>(setup)},
      explain_text_{setup.property<std::string>("explain", "not open", {.read_only = true})},
      status_text_{setup.property<std::string>("status", "waiting", {.read_only = true})},
      position_sd_m_{setup.property<double>("position_sd", 0, {.read_only = true})},
      heading_sd_rad_{setup.property<double>("heading_sd", 0, {.read_only = true})},
      ekf_config_{read_ekf(setup.config)},
      wheels_sd_mps_{setup.config.length("wheels_sd", 0.03, positive)},
      wheels_turn_sd_radps_{setup.config.angle("wheels_turn_sd", 0.1, positive)},
      wheels_timeout_{setup.config.duration("wheels_timeout", 500ms, {.min = 0.02, .max = 60})},
      gyro_sd_radps_{setup.config.angle("gyro_sd", 0.007, positive)},
      uses_heading_{setup.config.boolean("imu_heading", false)},
      heading_sd_of_imu_rad_{setup.config.angle("heading_sd", 0.05, positive)},
      heading_period_{from_seconds(1 / setup.config.number("heading_rate", 5, {.min = 0.01, .max = 1000}))},
      compass_{read_compass(setup.config)},
      fix_sd_m_{setup.config.length("fix_sd", 0.05, positive)},
      start_{read_start(setup.config)},
      filter_{fresh()} {
  pose_.takes_measurements();
  wheels_.on_data<position2d::State>([this](const position2d::State& state, Time measured) {
    wheels_seen_ = pose_.now();
    stalled_ = state.stalled;
    take(control::WheelMeasurement{.speed_mps = state.velocity.x,
                                   .w_radps = state.velocity.w,
                                   .speed_sd_mps = wheels_sd_mps_,
                                   .w_sd_radps = wheels_turn_sd_radps_},
         measured);
  });
  if (imu_) listen_to_imu();
  if (fixes_) {
    fixes_->on_data<localize::State>([this](const localize::State& state, Time at) { take_fix(state, at); });
  }

  belief_.on<localize::SetPose>([this](const localize::SetPose& set) -> Result<Empty> {
    const auto& [xx, yy, aa, xy, ya, xa] = set.covariance;
    if (xx < 0 || yy < 0 || aa < 0) return Error{std::errc::invalid_argument, "a variance is below 0"};
    const double variance = std::max(xx, yy);
    return place(set.mean, variance > 0 ? std::sqrt(variance) : set_position_sd_m,
                 aa > 0 ? std::sqrt(aa) : set_heading_sd_rad);
  });
  pose_.on<position2d::SetOdometry>(
      [this](const position2d::SetOdometry& set) { return place(set.pose, set_position_sd_m, set_heading_sd_rad); });
}

void Localizer::listen_to_imu() {
  imu_->on_data<imu::Calibrated>([this](const imu::Calibrated& c, Time at) { take_gyro(c.rate_z, at); });
  imu_->on_data<imu::Euler>([this](const imu::Euler& euler, Time at) {
    take_gyro(euler.samples.rate_z, at);
    take_heading(euler.orientation.yaw, at);
  });
  imu_->on_data<imu::FullState>([this](const imu::FullState& full, Time at) {
    take_gyro(full.velocity.yaw, at);
    take_heading(full.pose.yaw, at);
  });
  imu_->on_data<imu::State>([this](const imu::State& state, Time at) { take_heading(state.pose.yaw, at); });
}

control::PoseEkf Localizer::fresh() const {
  control::PoseEkf ekf{ekf_config_};
  if (start_) ekf.reset(*start_, set_position_sd_m, set_heading_sd_rad);
  return ekf;
}

Result<> Localizer::open() {
  filter_.replace(fresh());
  advanced_.reset();
  wheels_seen_.reset();
  imu_seen_.reset();
  fix_seen_.reset();
  heading_taken_.reset();
  told_restarts_ = 0;
  told_status_ = "waiting";
  since_explained_ = explain_period;
  return {};
}

Result<Empty> Localizer::place(const Pose2d& pose, double position_sd_m, double heading_sd_rad) {
  control::PoseEkf ekf = filter_.filter();
  try {
    ekf.reset(pose, position_sd_m, heading_sd_rad);
  } catch (const std::invalid_argument& wrong) {
    return Error{std::errc::invalid_argument, wrong.what()};
  }
  filter_.replace(std::move(ekf));
  return Empty{};
}

// -- What sensors say

void Localizer::advance(Time now) {
  if (advanced_) filter_.predict({}, now - *advanced_);
  advanced_ = std::max(advanced_.value_or(now), now);
}

void Localizer::take(const control::PoseEkf::Measurement& measurement, Time measured) {
  const Time now = pose_.now();
  advance(now);
  // The provider's thread may have read its clock a moment after ours was read.
  filter_.correct(measurement, now - std::min(measured, now));
}

void Localizer::take_gyro(double w_radps, Time measured) {
  imu_seen_ = pose_.now();
  take(control::GyroMeasurement{.w_radps = w_radps, .sd_radps = gyro_sd_radps_}, measured);
}

void Localizer::take_heading(double yaw_rad, Time measured) {
  imu_seen_ = pose_.now();
  if (!uses_heading_ || (heading_taken_ && measured - *heading_taken_ < heading_period_)) return;
  heading_taken_ = measured;
  take(control::HeadingMeasurement{.heading_rad = compass_.corrected(yaw_rad), .sd_rad = heading_sd_of_imu_rad_},
       measured);
}

void Localizer::take_fix(const localize::State& state, Time measured) {
  fix_seen_ = pose_.now();
  if (state.hypotheses.empty()) return;
  const localize::Hypothesis& fix = state.hypotheses.front();
  const auto& [xx, yy, aa, xy, ya, xa] = fix.covariance;
  const double sd_m = std::sqrt(std::max(xx, yy));
  if (const double sd_rad = std::sqrt(aa); sd_rad > 0 && sd_rad <= most_heading_sd_rad) {
    take(control::HeadingMeasurement{.heading_rad = fix.mean.heading, .sd_rad = sd_rad}, measured);
  }
  take(control::PositionMeasurement{.x = fix.mean.x, .y = fix.mean.y, .sd_m = sd_m < fix_sd_m_ ? fix_sd_m_ : sd_m},
       measured);
}

// -- What it says

bool Localizer::believable() const {
  const bool wheels = wheels_seen_ && pose_.now() - *wheels_seen_ <= wheels_timeout_;
  return wheels && filter_.filter().status() == control::PoseEkf::Status::tracking;
}

Result<> Localizer::read(const Tick& tick) {
  advance(tick.now);
  tell_changes();
  since_explained_ += tick.dt;
  if (since_explained_ >= explain_period) {
    since_explained_ = {};
    explain_text_.set(explain());
  }
  return {};
}

void Localizer::tell_changes() {
  using Status = control::PoseEkf::Status;
  const auto explanation = filter_.filter().explain();
  const std::uint64_t restarts = explanation.position.restarts + explanation.heading.restarts;
  if (restarts > told_restarts_) pose_.tell(1, "sensors disagreed with the pose for too long: it starts anew there");
  told_restarts_ = restarts;
  const std::string status = explanation.status == Status::waiting ? "waiting"
                             : explanation.status == Status::lost  ? "lost"
                             : believable()                        ? "tracking"
                                                                   : "no wheels";
  status_text_.set(status);
  position_sd_m_.set(explanation.position_sd_m);
  heading_sd_rad_.set(explanation.heading_sd_rad);
  if (status == told_status_) return;
  pose_.tell(status == "tracking" ? 0 : 1, "the pose is now: " + status);
  told_status_ = status;
}

std::string Localizer::explain() const {
  std::string text = control::to_string(filter_.filter().explain());
  const auto line = [&](const char* device, bool connected, std::optional<Time> seen) {
    text += std::string{"\n"} + device + (connected ? ": connected" : ": not connected");
    text += seen ? text_of(", spoke %.2f s ago", seconds(pose_.now() - *seen)) : ", said nothing";
  };
  line("base", wheels_.connected(), wheels_seen_);
  if (imu_) line("imu", imu_->connected(), imu_seen_);
  if (fixes_) line("fixes", fixes_->connected(), fix_seen_);
  if (filter_.too_old() > 0) text += "\n" + std::to_string(filter_.too_old()) + " measurements came too late";
  const auto estimate = filter_.filter().estimate();
  text += text_of("\nspeed %.2f m/s, gyro bias %.3f °/s (sd %.3f)", estimate.speed_mps, degrees * estimate.bias_radps,
                  degrees * estimate.bias_sd_radps);
  return text;
}

void Localizer::publish() {
  if (!believable()) return;
  const auto estimate = filter_.filter().estimate();
  pose_.send(position2d::State{
      .pose = estimate.pose, .velocity = {.x = estimate.speed_mps, .w = estimate.w_radps}, .stalled = stalled_});
  const control::PoseCovariance& p = estimate.covariance;
  belief_.send(localize::State{
      .hypotheses = {{.mean = estimate.pose, .covariance = {p.xx, p.yy, p.hh, p.xy, p.yh, p.xh}, .weight = 1}}});
}

}  // namespace regista
