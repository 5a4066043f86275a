// SPDX-License-Identifier: Apache-2.0
#include "ssl_robot.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <regista/sim/motor_board.hpp>

namespace regista {

namespace {

using namespace std::chrono_literals;

constexpr double pi = std::numbers::pi;
constexpr double degree = pi / 180;
constexpr double field_m = 100;         // no camera sees farther
constexpr Duration oldest_pose = 1s;    // older ones are of no use to anybody
constexpr Duration count_period = 5ms;  // of the wheels' velocity: in less, the edges are too few
constexpr Duration slip_period = 50ms;
constexpr Duration slow_period = 20ms;

// Without an IMU the wheels predict, too: their edges are as coarse as wheels_sd in each count_period, and the robot
// may accelerate as it likes.
constexpr double wheels_rate_density = 0.01;
constexpr double wheels_acceleration_density = 1;

constexpr Range positive{.min = 1e-6};
constexpr Range not_negative{.min = 0};

std::unique_ptr<motor_board::BoardLink> link_to_board(const Section& config) {
  const std::string port = config.text("port");
  const auto baud = static_cast<int>(config.integer("baud", 1'000'000, {.min = 1, .max = 100'000'000}));
  const auto seed = static_cast<std::uint64_t>(config.integer("seed", 1, not_negative));
  if (port != "simulated") {
    try {
      return motor_board::make_link(port, baud);
    } catch (const std::invalid_argument& wrong) {
      throw config.error("baud", wrong.what());
    }
  }
  sim::MotorBoardParameters board;
  board.robot.seed = 2 * seed;
  board.imu.seed = 2 * seed + 1;
  return std::make_unique<sim::SimulatedLink>(board);
}

std::unique_ptr<I2cBus> bus_to_imu(const Section& config) {
  const std::string imu = config.text("imu", "board");
  if (imu == "board" || imu == "none") return nullptr;
  if (!imu.starts_with('/')) throw config.error("imu", R"(must be "board", "none" or a device such as "/dev/i2c-1")");
  return linux_i2c(imu);
}

Size3d read_size(const Section& config) {
  if (!config.has("size")) return {.width = 0.18, .length = 0.18, .height = 0.15};
  const auto size = config.lengths("size", {.min = 0.01});
  if (size.size() != 3) throw config.error("size", "must be three lengths: [length width height]");
  return {.width = size[1], .length = size[0], .height = size[2]};
}

control::FieldEstimatorConfig read_estimator(const Section& config, control::FieldEstimatorConfig estimator) {
  estimator.fix_sd_m = config.length("vision_sd", estimator.fix_sd_m, positive);
  estimator.fix_sd_rad = config.angle("vision_turn_sd", estimator.fix_sd_rad, positive);
  estimator.wheels_sd_mps = config.length("wheels_sd", estimator.wheels_sd_mps, positive);
  estimator.wheels_slip_s = config.number("wheels_slip", 0.3, not_negative);
  estimator.translation.acceleration_density =
      config.number("accel_density", estimator.translation.acceleration_density, not_negative);
  estimator.orientation.rate_density = config.number("gyro_density", estimator.orientation.rate_density, not_negative);
  estimator.orientation.bias_density =
      config.number("gyro_bias_density", estimator.orientation.bias_density, not_negative);
  estimator.translation.gate = estimator.orientation.gate = config.number("gate", 4, positive);
  estimator.translation.restart_after = estimator.orientation.restart_after =
      static_cast<std::uint32_t>(config.integer("restart_after", 8, {.min = 1, .max = 1000}));
  return estimator;
}

control::FieldEstimatorConfig without_imu(control::FieldEstimatorConfig estimator) {
  estimator.translation.acceleration_density = wheels_acceleration_density;
  estimator.orientation.rate_density = wheels_rate_density;
  estimator.orientation.bias_density = 0;
  estimator.orientation.initial_bias_sd_radps = 0;
  return estimator;
}

control::ImuCalibrationConfig read_calibration(const Section& config) {
  control::ImuCalibrationConfig calibration;
  calibration.rest = config.duration("imu_rest", calibration.rest, {.min = 0.01, .max = 60});
  if (!config.has("imu_mount")) return calibration;
  const auto mount = config.angles("imu_mount");
  if (mount.size() != 3) throw config.error("imu_mount", "must be three angles: [roll pitch yaw]");
  calibration.mount = {.roll = mount[0], .pitch = mount[1], .yaw = mount[2]};
  return calibration;
}

control::TrajectoryTrackerConfig read_tracker(const Section& config) {
  auto tracker = control::TrajectoryTrackerConfig::fed_forward();
  tracker.profile = {
      .speed_mps = config.length("speed", tracker.profile.speed_mps, positive),
      .acceleration_mps2 = config.length("accel", tracker.profile.acceleration_mps2, positive),
      .turn_rate_radps = config.angle("turn_speed", tracker.profile.turn_rate_radps, positive),
      .turn_acceleration_radps2 = config.angle("turn_accel", tracker.profile.turn_acceleration_radps2, positive)};
  tracker.translation_proportional = config.number("gain", tracker.translation_proportional, not_negative);
  tracker.translation_integral = config.number("integral", tracker.translation_integral, not_negative);
  tracker.rotation_proportional = config.number("turn_gain", tracker.rotation_proportional, not_negative);
  tracker.rotation_integral = config.number("turn_integral", tracker.rotation_integral, not_negative);
  tracker.feed_forward = config.number("feed_forward", tracker.feed_forward, {.min = 0, .max = 1});
  tracker.speed_limit_mps = config.length("command_speed", tracker.profile.speed_mps * 5 / 3, positive);
  tracker.turn_rate_limit_radps = config.angle("command_turn", tracker.profile.turn_rate_radps, positive);
  return tracker;
}

kicker::Limits read_kick_limits(const Section& config) {
  const Range upwards{.min = 0, .max = pi / 2};
  const double chip_angle_min = config.angle("chip_angle_min", 30 * degree, upwards);
  return {.kick_speed_mps = static_cast<float>(config.length("kick_speed", 6.5, positive)),
          .chip_speed_mps = static_cast<float>(config.length("chip_speed", 4, positive)),
          .chip_angle_min_rad = static_cast<float>(chip_angle_min),
          .chip_angle_max_rad = static_cast<float>(config.angle("chip_angle_max", std::max(60 * degree, chip_angle_min),
                                                                {.min = chip_angle_min, .max = upwards.max})),
          .dribbler_radps = static_cast<float>(config.angle("dribbler_speed", 300, positive))};
}

/// "kick speed is 8 m/s, must be within [0, 6.5] m/s"
Error out_of_range(const char* what, double value, double min, double max, const char* unit) {
  char text[128];
  (void)std::snprintf(text, sizeof text, "%s is %.4g %s, must be within [%.4g, %.4g] %s", what, value, unit, min, max,
                      unit);
  return {std::errc::result_out_of_range, text};
}

std::string number(double value) {
  char text[32];
  (void)std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

double towards_zero(double value, double step) { return std::copysign(std::max(0.0, std::abs(value) - step), value); }

/// A limit that a command names; 0 leaves it to the device.
double limit_or(double named, double own) { return named == 0 ? own : std::clamp(std::abs(named), 1e-3 * own, own); }

bool is_new_fix(control::Verdict verdict) {
  return verdict == control::Verdict::fused || verdict == control::Verdict::restarted;
}

}  // namespace

control::Kinematics ssl_kinematics(const Section& config) {
  std::vector<double> angles{pi / 4, 3 * pi / 4, 5 * pi / 4, 7 * pi / 4};
  if (config.has("wheel_angles")) angles = config.angles("wheel_angles");
  if (angles.size() != motor_board_wheels) throw config.error("wheel_angles", "must be four angles");
  try {
    return control::Kinematics::omni(angles, config.length("wheel_distance", 0.08, positive));
  } catch (const std::invalid_argument& wrong) {
    throw config.error("wheel_angles", wrong.what());
  }
}

SslRobot::SslRobot(Setup& setup) : SslRobot{setup, link_to_board(setup.config), bus_to_imu(setup.config)} {}

SslRobot::SslRobot(Setup& setup, std::unique_ptr<motor_board::BoardLink> link, std::unique_ptr<I2cBus> bus,
                   const control::FieldEstimatorConfig& estimator)
    : base_{setup.provide<Position2d>()},
      camera_{setup.provide<Position2d>()},
      kicker_{setup.provide<Kicker>()},
      power_{setup.provide<Power>()},
      imu_{setup.provide<Imu>()},
      vision_text_{setup.property<std::string>("vision", "waiting", {.read_only = true})},
      rejected_{setup.property<std::int32_t>("vision.rejected", 0, {.read_only = true})},
      restarts_{setup.property<std::int32_t>("vision.restarts", 0, {.read_only = true})},
      calibrated_{setup.property<bool>("imu.calibrated", false, {.read_only = true})},
      slipping_{setup.property<bool>("slipping", false, {.read_only = true})},
      refused_{setup.property<std::int32_t>("board.refused", 0, {.read_only = true})},
      kinematics_{ssl_kinematics(setup.config)},
      wheel_radius_m_{setup.config.length("wheel_radius", 0.035, positive)},
      wheel_speed_mps_{setup.config.length("wheel_speed", 2.5, positive)},
      rim_per_edge_m_{2 * pi * wheel_radius_m_ / setup.config.number("ticks", 144, {.min = 1})},
      slip_mps_{setup.config.length("slip", 0.2, positive)},
      size_{read_size(setup.config)},
      with_imu_{read_estimator(setup.config, estimator)},
      without_imu_{without_imu(with_imu_)},
      calibration_config_{read_calibration(setup.config)},
      uses_imu_{setup.config.text("imu", "board") != "none"},
      vision_age_{setup.config.duration("vision_age", 30ms, {.min = 0, .max = 1})},
      vision_stale_{setup.config.duration("vision_stale", 100ms, {.min = 0.01, .max = 10})},
      vision_timeout_{setup.config.duration("vision_timeout", 500ms, {.min = 0, .max = 60})},
      vision_lost_{setup.config.duration("vision_lost", 2s, {.min = 0.01, .max = 60})},
      tracker_config_{read_tracker(setup.config)},
      kick_limits_{read_kick_limits(setup.config)},
      plate_{.pose = {.x = setup.config.length("kicker_offset", 0.08)},
             .size = {.width = setup.config.length("kicker_width", 0.08, positive)}},
      board_{std::move(link)},
      estimator_{without_imu_},
      imu_calibration_{calibration_config_},
      tracker_{tracker_config_} {
  if (bus) chips_.emplace(std::move(bus));
  camera_.takes_measurements();
  vision_lost_text_ = "vision lost " + number(seconds(vision_timeout_)) + " s — position control stopped";
  take_commands();
  take_kicks();
  camera_.on<position2d::VelocityCommand>([this](const auto& pose) { return see(pose); });
}

void SslRobot::take_commands() {
  const Error off{std::errc::operation_not_permitted, "the motors are off: ask for MOTOR_POWER 1"};
  base_.on<position2d::VelocityCommand>([this, off](const position2d::VelocityCommand& velocity) -> Result<> {
    if (!powered_) return off;
    target_ = velocity;
    if (velocity.motors_on == 0) target_ = position2d::VelocityCommand{};
    return {};
  });
  base_.on<position2d::VelocityHeadingCommand>([this, off](const position2d::VelocityHeadingCommand& v) -> Result<> {
    if (!powered_) return off;
    target_ = v;
    return {};
  });
  base_.on<position2d::PositionCommand>([this, off](const position2d::PositionCommand& goal) -> Result<> {
    if (!powered_) return off;
    if (goal.motors_on == 0) {
      target_ = position2d::VelocityCommand{};
      return {};
    }
    if (vision_ == Vision::waiting || vision_ == Vision::stopped || vision_ == Vision::lost) return no_vision();
    if (!to_a_pose()) tracker_.reset(to_field(command_, estimator_.estimate().pose.heading));
    tracker_.limit_profile(limit_or(std::hypot(goal.velocity.x, goal.velocity.y), tracker_config_.profile.speed_mps),
                           limit_or(goal.velocity.w, tracker_config_.profile.turn_rate_radps));
    target_ = goal;
    return {};
  });
  base_.on<position2d::GetGeometry>(
      [this](const auto&) -> Result<position2d::Geometry> { return position2d::Geometry{.size = size_}; });
  base_.on<position2d::SetMotorPower>([this](const position2d::SetMotorPower& request) -> Result<Empty> {
    powered_ = request.on != 0;
    if (!powered_) forget_target();
    return Empty{};
  });
  // Every command says itself whether it is a velocity or a position: both modes are always on.
  base_.on<position2d::SetVelocityMode>([](const auto&) -> Result<Empty> { return Empty{}; });
  base_.on<position2d::SetPositionMode>([](const auto&) -> Result<Empty> { return Empty{}; });
  base_.on<position2d::SetOdometry>(
      [this](const position2d::SetOdometry& request) { return set_odometry(request.pose); });
  base_.on<position2d::ResetOdometry>([this](const auto&) { return set_odometry({}); });
}

void SslRobot::take_kicks() {
  camera_.on<position2d::VelocityHeadingCommand>([this](const position2d::VelocityHeadingCommand& command) -> Result<> {
    if (command.speed_mps == 0) return {};
    return kick(command.speed_mps, command.heading_rad);
  });
  kicker_.on<kicker::KickCommand>([this](const kicker::KickCommand& flat) { return kick(flat.speed_mps, 0); });
  kicker_.on<kicker::ChipCommand>([this](const kicker::ChipCommand& chip) -> Result<> {
    if (chip.angle_rad == 0)
      return out_of_range("chip angle", 0, kick_limits_.chip_angle_min_rad, kick_limits_.chip_angle_max_rad, "rad");
    return kick(chip.speed_mps, chip.angle_rad);
  });
  kicker_.on<kicker::ChargeCommand>(
      [this](const kicker::ChargeCommand& charge) { may_kick_ = charging_ = charge.on != 0; });
  kicker_.on<kicker::DribblerCommand>([this](const kicker::DribblerCommand& dribbler) -> Result<> {
    if (std::abs(dribbler.speed_radps) > kick_limits_.dribbler_radps) {
      return out_of_range("dribbler speed", dribbler.speed_radps, -kick_limits_.dribbler_radps,
                          kick_limits_.dribbler_radps, "rad/s");
    }
    dribbler_radps_ = dribbler.speed_radps;
    return {};
  });
  kicker_.on<kicker::GetGeometry>([this](const auto&) -> Result<kicker::Geometry> { return plate_; });
  kicker_.on<kicker::GetLimits>([this](const auto&) -> Result<kicker::Limits> { return kick_limits_; });
}

Result<> SslRobot::kick(double speed_mps, double angle_rad) {
  if (!may_kick_) return Error{std::errc::operation_not_permitted, "kick: switched off by a stop or CHARGE 0"};
  const bool flat = angle_rad == 0;
  const double fastest = flat ? kick_limits_.kick_speed_mps : kick_limits_.chip_speed_mps;
  if (!(speed_mps > 0 && speed_mps <= fastest)) {
    return out_of_range(flat ? "kick speed" : "chip speed", speed_mps, 0, fastest, "m/s");
  }
  if (!flat && (angle_rad < kick_limits_.chip_angle_min_rad || angle_rad > kick_limits_.chip_angle_max_rad)) {
    return out_of_range("chip angle", angle_rad, kick_limits_.chip_angle_min_rad, kick_limits_.chip_angle_max_rad,
                        "rad");
  }
  return board_.kick(speed_mps, angle_rad);
}

Result<> SslRobot::see(const position2d::VelocityCommand& pose) {
  const auto& [x, y, heading] = pose.velocity;
  if (!(std::hypot(x, y) <= field_m)) {
    return out_of_range("the pose's distance from the origin", std::hypot(x, y), 0, field_m, "m");
  }
  const double age_s = pose.age_s.value_or(seconds(vision_age_));
  if (!(age_s >= 0 && age_s <= seconds(oldest_pose))) {
    return out_of_range("the pose's age", age_s, 0, seconds(oldest_pose), "s");
  }
  seen_ =
      Seen{.pose = {.x = x, .y = y, .heading = wrap_angle(heading)}, .captured = camera_.now() - from_seconds(age_s)};
  return {};
}

Result<Empty> SslRobot::set_odometry(const Pose2d& pose) {
  if (vision_ == Vision::good || vision_ == Vision::stale) {
    return Error{std::errc::operation_not_permitted, "the camera says where the robot is"};
  }
  forget_target();
  estimator_.place(pose);
  return Empty{};
}

Result<> SslRobot::open() {
  if (Result<> opened = board_.open(); !opened) return opened;
  if (chips_) {
    if (Result<> opened = chips_->open(); !opened) return opened;
  }
  estimator_ = control::FieldEstimator{without_imu_};
  imu_calibration_ = control::ImuCalibration{calibration_config_};
  calibrated_.set(false);
  wheels_ = {};
  counted_.reset();
  watched_.reset();
  seen_.reset();
  slipping_.set(false);
  fused_.reset();
  may_kick_ = true;
  turn_vision(vision_timeout_ == Duration{} ? Vision::unused : Vision::waiting);
  forget_target();
  return {};
}

void SslRobot::close() noexcept {
  board_.close();
  if (chips_) chips_->close();
}

void SslRobot::halt() noexcept {
  forget_target();
  command_ = {};
  dribbler_radps_ = 0;
  charging_ = false;
  board_.rest();
}

void SslRobot::forget_target() {
  target_ = position2d::VelocityCommand{};
  tracker_.reset();
}

Result<> SslRobot::read(const Tick& tick) {
  if (Result<> heard = board_.receive(tick); !heard) return heard;
  if (Result<> measured = read_imu(tick); !measured) return measured;
  estimate(tick);
  watch_vision(tick.now);
  command_ = plan(tick);
  slow_ += tick.dt;
  return board_.send(command());
}

// -- Where it is
// -------------------------------------------------------------------------------------------------------

Result<> SslRobot::read_imu(const Tick& tick) {
  control::ImuSample sample;
  const MotorBoardTelemetry& telemetry = board_.telemetry();
  if (chips_) {
    const Result<control::ImuSample> read = chips_->read();
    if (!read) return read.error();
    sample = *read;
  } else if (uses_imu_ && board_.received() > 0 && (telemetry.status & motor_board_imu) != 0) {
    for (int axis = 0; axis < 3; ++axis) {
      sample.accel_mps2(axis) = 1e-3 * telemetry.accel_mmps2[axis];
      sample.rate_radps(axis) = 1e-3 * telemetry.rate_mradps[axis];
    }
  } else {
    return {};
  }
  // The wheels have no set-point, and the board has counted nothing for a while.
  const bool may_rest = command_ == BodyVelocity{} && wheels_ == BodyVelocity{};
  const bool was_ready = imu_calibration_.ready();
  imu_calibration_.step(sample, may_rest, tick.dt);
  if (imu_calibration_.ready() && !was_ready) {
    const Pose2d here = estimator_.estimate().pose;
    estimator_ = control::FieldEstimator{with_imu_};
    estimator_.place(here);
    calibrated_.set(true);
  }
  return {};
}

void SslRobot::estimate(const Tick& tick) {
  control::InertialMeasurement measured{.rate_radps = wheels_.w};
  if (imu_calibration_.ready()) {
    const control::ImuSample& body = imu_calibration_.calibrated();
    measured = {
        .accel_x_mps2 = body.accel_mps2.x(), .accel_y_mps2 = body.accel_mps2.y(), .rate_radps = body.rate_radps.z()};
  }
  estimator_.predict(measured, tick.dt);
  if (board_.received() > 0) read_wheels();
  if (const auto seen = std::exchange(seen_, std::nullopt)) fuse(*seen, tick.now);
}

void SslRobot::read_wheels() {
  const MotorBoardTelemetry& now = board_.telemetry();
  const auto rims_since = [&](const MotorBoardTelemetry& before) {
    control::WheelSpeeds rims(motor_board_wheels);
    const double rim_per_edge_mps = rim_per_edge_m_ / seconds(motor_board::elapsed(before, now));
    for (std::size_t i = 0; i < rims.size(); ++i) {
      rims[i] = rim_per_edge_mps * motor_board::turned_edges(before.count[i], now.count[i]);
    }
    return rims;
  };
  if (!counted_ || !watched_) {
    counted_ = watched_ = now;
    kicks_before_ = now.kicks;
    return;
  }
  if (motor_board::elapsed(*watched_, now) >= slip_period) {
    slipping_.set(kinematics_.slip(rims_since(*watched_)) > slip_mps_);
    watched_ = now;
  }
  if (motor_board::elapsed(*counted_, now) < count_period) return;
  wheels_ = kinematics_.body(rims_since(*counted_));
  counted_ = now;
  if (!*slipping_) estimator_.correct(wheels_);
}

void SslRobot::fuse(const Seen& seen, Time now) {
  camera_.send(position2d::State{.pose = seen.pose}, seen.captured);
  if (!fused_) {  // the first that any camera says
    estimator_.place(seen.pose);
    fused_ = seen.captured;
    return;
  }
  const Pose2d before = estimator_.estimate().pose;
  const auto [position, heading] = estimator_.correct(seen.pose, now - seen.captured);
  if (is_new_fix(position.verdict)) fused_ = seen.captured;
  if (!is_new_fix(position.verdict) || !is_new_fix(heading.verdict)) rejected_.set(*rejected_ + 1);
  if (position.verdict != control::Verdict::restarted && heading.verdict != control::Verdict::restarted) return;

  restarts_.set(*restarts_ + 1);
  const std::string jump = "vision jumped " + number(distance(before, seen.pose)) + " m, " +
                           number(angle_between(before.heading, seen.pose.heading) / degree) + "°";
  base_.tell(1, jump + ": the estimate starts anew");
  if (to_a_pose()) {
    forget_target();
    base_.stop(jump);
  }
}

Error SslRobot::no_vision() const {
  if (vision_ == Vision::waiting) {
    return {std::errc::operation_not_permitted, "no camera has seen the robot yet: position control needs one"};
  }
  return {std::errc::operation_not_permitted, vision_lost_text_};
}

void SslRobot::turn_vision(Vision vision) {
  constexpr std::array names{"unused", "waiting", "good", "stale", "stopped", "lost"};
  vision_ = vision;
  vision_text_.set(names[static_cast<std::size_t>(vision)]);
}

void SslRobot::watch_vision(Time now) {
  if (vision_timeout_ == Duration{} || !fused_) return;
  const Duration unseen = now - *fused_;
  const Vision before = vision_;
  const Vision after = unseen > std::max(vision_lost_, vision_timeout_) ? Vision::lost
                       : unseen > vision_timeout_                       ? Vision::stopped
                       : unseen > vision_stale_                         ? Vision::stale
                                                                        : Vision::good;
  if (after == before) return;
  turn_vision(after);
  if (vision_ == Vision::stopped) base_.tell(1, vision_lost_text_);
  if (vision_ == Vision::lost && to_a_pose()) {
    forget_target();
    base_.stop("vision lost " + number(seconds(vision_lost_)) + " s: destination given up");
  }
  if (before == Vision::stopped && vision_ != Vision::lost) {
    base_.tell(0, "vision is back");
    tracker_.reset(to_field(command_, estimator_.estimate().pose.heading));
  }
}

// -- What it does
// ------------------------------------------------------------------------------------------------------

BodyVelocity SslRobot::plan(const Tick& tick) {
  if (const auto* velocity = std::get_if<position2d::VelocityCommand>(&target_)) return velocity->velocity;
  const Pose2d here = estimator_.estimate().pose;
  if (const auto* ahead = std::get_if<position2d::VelocityHeadingCommand>(&target_)) {
    const double turn = tracker_config_.rotation_proportional * angle_between(here.heading, ahead->heading_rad);
    const double fastest = tracker_config_.turn_rate_limit_radps;
    return {.x = ahead->speed_mps, .w = std::clamp(turn, -fastest, fastest)};
  }
  if (vision_ == Vision::stopped) {  // along the profile's deceleration
    const double speed = std::hypot(command_.x, command_.y);
    const double slower = towards_zero(speed, tracker_config_.profile.acceleration_mps2 * seconds(tick.dt));
    const double share = speed > 0 ? slower / speed : 0;
    return {.x = share * command_.x,
            .y = share * command_.y,
            .w = towards_zero(command_.w, tracker_config_.profile.turn_acceleration_radps2 * seconds(tick.dt))};
  }
  return tracker_.step(here, std::get<position2d::PositionCommand>(target_).pose, tick.dt).command;
}

MotorBoardCommand SslRobot::command() const {
  MotorBoardCommand frame{};
  frame.flags = static_cast<std::uint8_t>((powered_ ? motor_board_drive : 0) | (charging_ ? motor_board_charge : 0));
  frame.dribbler_radps = static_cast<std::int16_t>(std::lround(dribbler_radps_));
  const control::WheelSpeeds rims = control::saturated(kinematics_.wheels(command_), wheel_speed_mps_);
  for (std::size_t i = 0; i < rims.size(); ++i) frame.wheel_mradps[i] = motor_board::milli(rims[i] / wheel_radius_m_);
  return frame;
}

void SslRobot::publish() {
  const control::MotionState state = estimator_.estimate();
  const MotorBoardTelemetry& telemetry = board_.telemetry();
  base_.send(position2d::State{
      .pose = state.pose, .velocity = to_body(state.velocity, state.pose.heading), .stalled = telemetry.stalled != 0});
  if (imu_calibration_.ready()) {
    const control::ImuSample& body = imu_calibration_.calibrated();
    imu_.send(imu::Calibrated{.acceleration_x = static_cast<float>(body.accel_mps2.x()),
                              .acceleration_y = static_cast<float>(body.accel_mps2.y()),
                              .acceleration_z = static_cast<float>(body.accel_mps2.z()),
                              .rate_x = static_cast<float>(body.rate_radps.x()),
                              .rate_y = static_cast<float>(body.rate_radps.y()),
                              .rate_z = static_cast<float>(body.rate_radps.z())});
  }
  if (slow_ < slow_period) return;
  slow_ = {};
  refused_.set(telemetry.refused + board_.refused());
  if (!counted_) return;  // the board has said nothing yet
  const float volts = 1e-3F * telemetry.battery_mv;
  power_.send(power::State{
      .valid = power::volts | power::watts, .voltage_v = volts, .power_w = volts * 0.01F * telemetry.battery_ca});
  kicker_.send(kicker::State{.capacitor_v = 0.1F * telemetry.capacitor_dv,
                             .charged = (telemetry.status & motor_board_charged) != 0,
                             .ball_detected = (telemetry.status & motor_board_ball) != 0,
                             .dribbler_radps = static_cast<float>(telemetry.dribbler_radps),
                             .kick_count = static_cast<std::uint16_t>(telemetry.kicks - kicks_before_)});
}

}  // namespace regista
