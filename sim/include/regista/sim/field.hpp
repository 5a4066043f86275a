// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <regista/sim/ball.hpp>
#include <regista/sim/motor_board.hpp>
#include <vector>

namespace regista::sim {

/// The defaults are the league's division B.
struct FieldParameters {
  double length_m = 9;      ///< along x
  double width_m = 6;       ///< along y
  double boundary_m = 0.3;  ///< from the lines to the boards around the field
  BallParameters ball = {};
  KickerParameters kicker = {};  ///< only its place on the robot: the boards have capacitors of their own
};

/// A field with robots on their motor boards, and a ball that they push, hold with the dribbler and kick. The ball
/// rolls: a chip is a slower kick. Boards around the field send it back. Deterministic.
class Field {
 public:
  static constexpr double robot_radius_m = 0.09;
  static constexpr double ball_radius_m = 0.0215;

  /// Throws std::invalid_argument that names the value which cannot be.
  explicit Field(const FieldParameters& parameters = {});

  /// One more robot, at rest. References to boards stay valid only until the next.
  MotorBoard& add(const MotorBoardParameters& board, const Pose2d& pose);
  /// At most 1 ms at a time: what is longer is taken in steps of that.
  void step(Duration dt);

  [[nodiscard]] std::size_t size() const { return players_.size(); }
  [[nodiscard]] MotorBoard& board(std::size_t number) { return players_[number].board; }
  [[nodiscard]] const Pose2d& pose(std::size_t number) const { return players_[number].board.robot().state().pose; }
  [[nodiscard]] const Ball& ball() const { return ball_; }
  void place_ball(double x_m, double y_m) { ball_.place(x_m, y_m); }
  /// How often two robots began to touch.
  [[nodiscard]] std::uint64_t collisions() const { return collisions_; }

 private:
  struct Player {
    MotorBoard board;
    std::uint16_t kicks = 0;  ///< seen so far
    bool holds = false;       ///< the ball turns at its dribbler
  };

  void step_ball(Duration dt);
  void kick(Player& player);
  void touch(Player& player);
  void keep_inside();
  void separate();

  FieldParameters parameters_;
  Kicker kicker_;
  std::vector<Player> players_;
  std::vector<bool> touching_;  ///< of each pair, [i * size() + j]
  Ball ball_;
  std::uint64_t collisions_ = 0;
};

}  // namespace regista::sim
