// SPDX-License-Identifier: Apache-2.0
#include "regista/control/pose_ekf.hpp"

#include <iomanip>
#include <sstream>

#include "arc.hpp"
#include "parameter.hpp"

namespace regista::control {
namespace {

enum : int { pos_x, pos_y, heading, speed, turn, bias };

double square(double value) { return value * value; }

}  // namespace

PoseEkf::PoseEkf(const PoseEkfConfig& config) : config_{config} {
  require_not_negative("acceleration_density", config.acceleration_density);
  require_not_negative("turn_density", config.turn_density);
  require_not_negative("bias_density", config.bias_density);
  require_not_negative("slip_density", config.slip_density);
  require_positive("initial_speed_sd_mps", config.initial_speed_sd_mps);
  require_positive("initial_turn_sd_radps", config.initial_turn_sd_radps);
  require_positive("initial_bias_sd_radps", config.initial_bias_sd_radps);
  require(config.gate > 0, "gate", config.gate, "give a positive number of standard deviations, 4 is usual");
  require(config.restart_after > 0, "restart_after", config.restart_after, "give at least 1");
  require_positive("align_distance_m", config.align_distance_m);
  require_positive("lost_position_sd_m", config.lost_position_sd_m);
  require_positive("lost_heading_sd_rad", config.lost_heading_sd_rad);
  // Until it is located and oriented, the filter reckons from the pose 0, known exactly.
  state_.kalman.p.setZero();
  state_.kalman.p(speed, speed) = square(config.initial_speed_sd_mps);
  state_.kalman.p(turn, turn) = square(config.initial_turn_sd_radps);
  state_.kalman.p(bias, bias) = square(config.initial_bias_sd_radps);
}

void PoseEkf::reset(const Pose2d& pose, double position_sd_m, double heading_sd_rad) {
  require(sane(pose.x), "x", pose.x, "give it in metres");
  require(sane(pose.y), "y", pose.y, "give it in metres");
  require(sane(pose.heading), "heading", pose.heading, "give it in radians");
  require_positive("position_sd_m", position_sd_m);
  require_positive("heading_sd_rad", heading_sd_rad);
  place({.x = pose.x, .y = pose.y, .sd_m = position_sd_m});
  state_.kalman.x(heading) = wrap_angle(pose.heading);
  state_.kalman.forget(heading, square(heading_sd_rad));
  state_.located = state_.oriented = true;
}

void PoseEkf::predict(Input, Duration dt) {
  if (dt <= Duration::zero()) return;
  for (SensorRecord* record : {&state_.wheels, &state_.gyro, &state_.heading, &state_.position}) record->unseen += dt;

  auto& [x, p] = state_.kalman;
  const double t = seconds(dt);
  const Arc arc(x(heading), x(turn), t);
  const double v = x(speed);
  const auto way = v * arc.way;
  const auto way_by_turn_rate = v * t * arc.way_by_turn;
  x(pos_x) += way.real();
  x(pos_y) += way.imag();
  x(heading) = wrap_angle(x(heading) + x(turn) * t);

  // p = f p f' with f = I but for seven elements: first the rows, then the columns.
  p.row(pos_x) += -way.imag() * p.row(heading) + arc.way.real() * p.row(speed) + way_by_turn_rate.real() * p.row(turn);
  p.row(pos_y) += way.real() * p.row(heading) + arc.way.imag() * p.row(speed) + way_by_turn_rate.imag() * p.row(turn);
  p.row(heading) += t * p.row(turn);
  p.col(pos_x) += -way.imag() * p.col(heading) + arc.way.real() * p.col(speed) + way_by_turn_rate.real() * p.col(turn);
  p.col(pos_y) += way.real() * p.col(heading) + arc.way.imag() * p.col(speed) + way_by_turn_rate.imag() * p.col(turn);
  p.col(heading) += t * p.col(turn);

  // Integrated white noise, d [[t³/3, t²/2], [t²/2, t]], of the speed along the arc's chord and of the turn rate.
  const Eigen::Vector2d along{arc.way.real() / t, arc.way.imag() / t};
  const double t2 = t * t / 2;
  const double t3 = t * t * t / 3;
  p.block<2, 2>(pos_x, pos_x) += config_.acceleration_density * t3 * along * along.transpose();
  p.block<2, 1>(pos_x, speed) += config_.acceleration_density * t2 * along;
  p.block<1, 2>(speed, pos_x) += config_.acceleration_density * t2 * along.transpose();
  p(speed, speed) += config_.acceleration_density * t;
  p(heading, heading) += config_.turn_density * t3;
  p(heading, turn) += config_.turn_density * t2;
  p(turn, heading) += config_.turn_density * t2;
  p(turn, turn) += config_.turn_density * t;
  p(bias, bias) += config_.bias_density * t;
  p(pos_x, pos_x) += config_.slip_density * t;
  p(pos_y, pos_y) += config_.slip_density * t;
}

Correction PoseEkf::correct(const Measurement& measurement) {
  const Correction result = std::visit([this](const auto& one) { return take(one); }, measurement);
  state_.kalman.x(heading) = wrap_angle(state_.kalman.x(heading));
  return result;
}

Correction PoseEkf::take(const WheelMeasurement& z) {
  if (!sane(z.speed_mps) || !sane(z.w_radps) || !sane(z.speed_sd_mps) || !sane(z.w_sd_radps) || !(z.speed_sd_mps > 0) ||
      !(z.w_sd_radps > 0)) {
    return state_.wheels.note(Verdict::invalid);
  }
  const auto& x = state_.kalman.x;
  const Eigen::Matrix<double, 2, 6> h{{0, 0, 0, 1, 0, 0}, {0, 0, 0, 0, 1, 0}};
  const Eigen::Matrix2d r{{square(z.speed_sd_mps), 0}, {0, square(z.w_sd_radps)}};
  const auto [nis, fused] =
      state_.kalman.correct<2>(Eigen::Vector2d{z.speed_mps - x(speed), z.w_radps - x(turn)}, h, r, config_.gate);
  return state_.wheels.note(fused ? Verdict::fused : Verdict::outlier, nis);
}

Correction PoseEkf::take(const GyroMeasurement& z) {
  if (!sane(z.w_radps) || !sane(z.sd_radps) || !(z.sd_radps > 0)) return state_.gyro.note(Verdict::invalid);
  const auto& x = state_.kalman.x;
  const Eigen::Matrix<double, 1, 6> h{0, 0, 0, 0, 1, 1};
  using Scalar = Eigen::Matrix<double, 1, 1>;
  const auto [nis, fused] =
      state_.kalman.correct<1>(Scalar{z.w_radps - x(turn) - x(bias)}, h, Scalar{square(z.sd_radps)}, config_.gate);
  return state_.gyro.note(fused ? Verdict::fused : Verdict::outlier, nis);
}

Correction PoseEkf::take(const HeadingMeasurement& z) {
  SensorRecord& record = state_.heading;
  if (!sane(z.heading_rad) || !sane(z.sd_rad) || !(z.sd_rad > 0)) return record.note(Verdict::invalid);
  if (!state_.oriented) {
    turn_about_anchor(z.heading_rad, square(z.sd_rad));
    return record.note(Verdict::initialised);
  }
  auto& [x, p] = state_.kalman;
  const Eigen::Matrix<double, 1, 6> h{0, 0, 1, 0, 0, 0};
  using Scalar = Eigen::Matrix<double, 1, 1>;
  const auto [nis, fused] = state_.kalman.correct<1>(Scalar{angle_between(x(heading), z.heading_rad)}, h,
                                                     Scalar{square(z.sd_rad)}, config_.gate);
  if (fused) return record.note(Verdict::fused, nis);
  if (record.refused_in_a_row + 1 < config_.restart_after) return record.note(Verdict::outlier, nis);
  x(heading) = wrap_angle(z.heading_rad);
  state_.kalman.forget(heading, square(z.sd_rad));
  return record.note(Verdict::restarted, nis);
}

Correction PoseEkf::take(const PositionMeasurement& z) {
  SensorRecord& record = state_.position;
  if (!sane(z.x) || !sane(z.y) || !sane(z.sd_m) || !(z.sd_m > 0)) return record.note(Verdict::invalid);
  if (!state_.located) {
    place(z);
    state_.located = true;
    state_.anchor = {.x = z.x, .y = z.y};
    return record.note(Verdict::initialised);
  }
  if (!state_.oriented) return align(z);
  const auto& x = state_.kalman.x;
  const Eigen::Matrix<double, 2, 6> h{{1, 0, 0, 0, 0, 0}, {0, 1, 0, 0, 0, 0}};
  const Eigen::Matrix2d r = square(z.sd_m) * Eigen::Matrix2d::Identity();
  const auto [nis, fused] =
      state_.kalman.correct<2>(Eigen::Vector2d{z.x - x(pos_x), z.y - x(pos_y)}, h, r, config_.gate);
  if (fused) return record.note(Verdict::fused, nis);
  if (record.refused_in_a_row + 1 < config_.restart_after) return record.note(Verdict::outlier, nis);
  place(z);
  // A wrong heading may have led away from the positions: where no sensor gives it, they shall be able to turn it.
  if (state_.heading.taken == 0) state_.kalman.forget(heading, square(config_.lost_heading_sd_rad / 2));
  return record.note(Verdict::restarted, nis);
}

Correction PoseEkf::align(const PositionMeasurement& z) {
  const auto& x = state_.kalman.x;
  const double fixed_x = z.x - state_.anchor.x;
  const double fixed_y = z.y - state_.anchor.y;
  const double reckoned_x = x(pos_x) - state_.anchor.x;
  const double reckoned_y = x(pos_y) - state_.anchor.y;
  const double way = std::hypot(fixed_x, fixed_y);
  // Noise of the two fixes looks like a turn: wait until it is small against the way.
  const double needed = std::max(config_.align_distance_m, 6 * z.sd_m);
  if (way < needed || std::hypot(reckoned_x, reckoned_y) < needed / 2) return state_.position.note(Verdict::waiting);
  const double rotation = std::atan2(fixed_y, fixed_x) - std::atan2(reckoned_y, reckoned_x);
  turn_about_anchor(x(heading) + rotation, 2 * square(z.sd_m / way) + state_.kalman.p(heading, heading));
  place(z);
  return state_.position.note(Verdict::initialised);
}

/// The heading is known at last: what was reckoned since the first position turns with it.
void PoseEkf::turn_about_anchor(double heading_rad, double variance) {
  auto& [x, p] = state_.kalman;
  const double rotation = heading_rad - x(heading);
  const double way_x = x(pos_x) - state_.anchor.x;
  const double way_y = x(pos_y) - state_.anchor.y;
  const double position_variance =
      std::max(p(pos_x, pos_x), p(pos_y, pos_y)) + (way_x * way_x + way_y * way_y) * (variance + p(heading, heading));
  x(pos_x) = state_.anchor.x + std::cos(rotation) * way_x - std::sin(rotation) * way_y;
  x(pos_y) = state_.anchor.y + std::sin(rotation) * way_x + std::cos(rotation) * way_y;
  x(heading) = wrap_angle(heading_rad);
  state_.kalman.forget(pos_x, position_variance);
  state_.kalman.forget(pos_y, position_variance);
  state_.kalman.forget(heading, variance);
  state_.oriented = true;
}

void PoseEkf::place(const PositionMeasurement& z) {
  state_.kalman.x(pos_x) = z.x;
  state_.kalman.x(pos_y) = z.y;
  state_.kalman.forget(pos_x, square(z.sd_m));
  state_.kalman.forget(pos_y, square(z.sd_m));
}

PoseEkf::Estimate PoseEkf::estimate() const {
  const auto& [x, p] = state_.kalman;
  return {.pose = {.x = x(pos_x), .y = x(pos_y), .heading = x(heading)},
          .covariance = {.xx = p(pos_x, pos_x),
                         .xy = p(pos_x, pos_y),
                         .xh = p(pos_x, heading),
                         .yy = p(pos_y, pos_y),
                         .yh = p(pos_y, heading),
                         .hh = p(heading, heading)},
          .speed_mps = x(speed),
          .w_radps = x(turn),
          .bias_radps = x(bias),
          .speed_sd_mps = std::sqrt(p(speed, speed)),
          .w_sd_radps = std::sqrt(p(turn, turn)),
          .bias_sd_radps = std::sqrt(p(bias, bias))};
}

PoseEkf::Status PoseEkf::status() const {
  if (!state_.located || !state_.oriented) return Status::waiting;
  const auto& p = state_.kalman.p;
  const bool certain = p(pos_x, pos_x) + p(pos_y, pos_y) <= square(config_.lost_position_sd_m) &&
                       p(heading, heading) <= square(config_.lost_heading_sd_rad);
  return certain ? Status::tracking : Status::lost;
}

PoseEkf::Explanation PoseEkf::explain() const {
  const auto& p = state_.kalman.p;
  return {.status = status(),
          .located = state_.located,
          .oriented = state_.oriented,
          .position_sd_m = std::sqrt(p(pos_x, pos_x) + p(pos_y, pos_y)),
          .heading_sd_rad = std::sqrt(p(heading, heading)),
          .wheels = state_.wheels,
          .gyro = state_.gyro,
          .heading = state_.heading,
          .position = state_.position};
}

std::string to_string(const PoseEkf::Explanation& e) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(3);
  if (e.status == PoseEkf::Status::waiting) {
    text << "waiting for";
    if (!e.located) text << " a position";
    if (!e.located && !e.oriented) text << " and";
    if (!e.oriented) text << " a heading, or a way between two positions";
  } else {
    text << (e.status == PoseEkf::Status::lost ? "lost" : "tracking") << ": position sd " << e.position_sd_m
         << " m, heading sd " << e.heading_sd_rad << " rad";
  }
  const auto line = [&text](std::string_view name, const SensorRecord& record) {
    text << '\n' << name << ": ";
    if (record.last.verdict == Verdict::none) {
      text << "nothing yet";
      return;
    }
    text << record.taken << " taken, " << record.refused << " refused, " << record.restarts << " restarts; last "
         << to_string(record.last.verdict);
    if (record.last.nis > 0) text << " (NIS " << record.last.nis << ")";
    if (record.taken > 0) text << "; last taken " << seconds(record.unseen) << " s ago";
  };
  line("wheels", e.wheels);
  line("gyro", e.gyro);
  line("heading", e.heading);
  line("position", e.position);
  return text.str();
}

}  // namespace regista::control
