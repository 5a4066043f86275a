// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <cmath>
#include <regista/sim/field.hpp>

#include "require.hpp"

namespace regista::sim {

namespace {

using namespace std::chrono_literals;

constexpr double ball_bounces = 0.4;    // share of the speed that a robot or a board gives back
constexpr double slowest_bounce = 0.1;  // [m/s] below it the ball only rolls along

}  // namespace

Field::Field(const FieldParameters& parameters)
    : parameters_{parameters}, kicker_{parameters.kicker}, ball_{parameters.ball} {
  require_positive("length_m", parameters.length_m);
  require_positive("width_m", parameters.width_m);
  require_not_negative("boundary_m", parameters.boundary_m);
}

MotorBoard& Field::add(const MotorBoardParameters& board, const Pose2d& pose) {
  MotorBoard& added = players_.emplace_back(Player{.board = MotorBoard{board}}).board;
  added.robot().place(pose);
  touching_.assign(players_.size() * players_.size(), false);
  return added;
}

void Field::step(Duration dt) {
  for (Duration left = dt; left > Duration::zero(); left -= 1ms) {
    const Duration part = std::min<Duration>(left, 1ms);
    for (Player& player : players_) player.board.step(part);
    separate();
    step_ball(part);
  }
}

void Field::step_ball(Duration dt) {
  ball_.step(dt);
  for (Player& player : players_) {
    kick(player);
    touch(player);
    player.board.put_ball(kicker_.reaches(ball_, player.board.robot().state().pose));
  }
  keep_inside();
}

void Field::kick(Player& player) {
  const ::MotorBoard& firmware = player.board.firmware();
  if (std::exchange(player.kicks, firmware.telemetry.kicks) == firmware.telemetry.kicks) return;
  const auto& robot = player.board.robot().state();
  if (!kicker_.reaches(ball_, robot.pose)) return;
  const double along_mps = 1e-3 * firmware.command.kick_speed_mmps * std::cos(1e-3 * firmware.command.kick_angle_mrad);
  ball_.kick(to_field(BodyVelocity{.x = robot.velocity.x + along_mps, .y = robot.velocity.y}, robot.pose.heading));
  player.holds = false;
}

/// The ball does not go through a robot; a dribbler that turns inwards holds it.
void Field::touch(Player& player) {
  const auto& robot = player.board.robot().state();
  Pose2d at = inverse(robot.pose) * Pose2d{.x = ball_.x_m(), .y = ball_.y_m()};
  const bool in_front = at.x > 0 && std::abs(at.y) < parameters_.kicker.half_width_m;
  const double front_m = parameters_.kicker.front_m + ball_radius_m;
  const bool touches = in_front ? at.x < front_m : std::hypot(at.x, at.y) < robot_radius_m + ball_radius_m;
  const bool dribbles = player.board.firmware().command.dribbler_radps > 0;
  const BodyVelocity ball = to_body(ball_.velocity(), robot.pose.heading);
  player.holds = dribbles && in_front && (touches || player.holds);
  if (player.holds) {
    const Pose2d held = robot.pose * Pose2d{.x = front_m, .y = at.y};
    ball_.place(held.x, held.y);
    ball_.kick(to_field(BodyVelocity{.x = robot.velocity.x, .y = robot.velocity.y + robot.velocity.w * front_m},
                        robot.pose.heading));
    return;
  }
  if (!touches) return;
  const double away = in_front ? 0 : std::atan2(at.y, at.x);
  const double c = std::cos(away);
  const double s = std::sin(away);
  at = in_front ? Pose2d{.x = front_m, .y = at.y}
                : Pose2d{.x = c * (robot_radius_m + ball_radius_m), .y = s * (robot_radius_m + ball_radius_m)};
  const Pose2d outside = robot.pose * at;
  // Of the robot's surface where they touch.
  const double surface_x = robot.velocity.x - robot.velocity.w * at.y;
  const double surface_y = robot.velocity.y + robot.velocity.w * at.x;
  const double approach = (ball.x - surface_x) * c + (ball.y - surface_y) * s;
  ball_.place(outside.x, outside.y);
  const double back = approach < 0 ? -approach * (-approach > slowest_bounce ? 1 + ball_bounces : 1) : 0;
  ball_.kick(to_field(BodyVelocity{.x = ball.x + back * c, .y = ball.y + back * s}, robot.pose.heading));
}

void Field::keep_inside() {
  const double edge_x = parameters_.length_m / 2 + parameters_.boundary_m - ball_radius_m;
  const double edge_y = parameters_.width_m / 2 + parameters_.boundary_m - ball_radius_m;
  if (std::abs(ball_.x_m()) <= edge_x && std::abs(ball_.y_m()) <= edge_y) return;
  FieldVelocity velocity = ball_.velocity();
  if (std::abs(ball_.x_m()) > edge_x) velocity.x *= -ball_bounces;
  if (std::abs(ball_.y_m()) > edge_y) velocity.y *= -ball_bounces;
  ball_.place(std::clamp(ball_.x_m(), -edge_x, edge_x), std::clamp(ball_.y_m(), -edge_y, edge_y));
  ball_.kick(velocity);
}

/// Robots that overlap are pushed apart, each by half; their motors push on.
void Field::separate() {
  for (std::size_t i = 0; i < players_.size(); ++i) {
    for (std::size_t j = i + 1; j < players_.size(); ++j) {
      const Pose2d a = pose(i);
      const Pose2d b = pose(j);
      const double apart = distance(a, b);
      const double overlap = 2 * robot_radius_m - apart;
      const bool touch = overlap > 0;
      const std::size_t pair = i * players_.size() + j;
      if (touch && !touching_[pair]) ++collisions_;
      touching_[pair] = touch;
      if (!touch) continue;
      const double x = apart > 0 ? (b.x - a.x) / apart : 1;
      const double y = apart > 0 ? (b.y - a.y) / apart : 0;
      for (auto& [player, side] : {std::pair{&players_[i], -0.5}, std::pair{&players_[j], 0.5}}) {
        WheeledRobot& robot = player->board.robot();
        Pose2d moved = robot.state().pose;
        moved.x += side * overlap * x;
        moved.y += side * overlap * y;
        robot.place(moved, robot.state().velocity);
      }
    }
  }
}

}  // namespace regista::sim
