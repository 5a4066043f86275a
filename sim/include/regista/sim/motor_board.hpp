// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/motor_board/board.h>

#include <deque>
#include <regista/motor_board/link.hpp>
#include <regista/sim/imu.hpp>
#include <regista/sim/wheeled_robot.hpp>

namespace regista::sim {

struct MotorBoardParameters {
  WheeledRobotParameters robot = ssl_robot();  ///< four wheels; `hop_s` is 0, whatever it says
  ImuParameters imu = {};                      ///< on the board, its x ahead
  bool has_imu = true;
  double charge_s = 2;  ///< of the kicker's capacitor, from empty to full, at constant power
  double full_v = 200;
  double kick_mps = 6.5;  ///< the kick that empties it
};

/// A robot at the far end of the cable: the reference firmware, which is the one that boards run, with a simulated
/// robot for its hardware.
class MotorBoard {
 public:
  explicit MotorBoard(const MotorBoardParameters& parameters = {});

  /// Bytes that arrive, before the next step.
  void receive(std::span<const std::uint8_t> bytes) { input_.insert(input_.end(), bytes.begin(), bytes.end()); }
  void step(Duration dt);
  /// What it has sent since the last call, as much as fits.
  std::size_t transmit(std::span<std::uint8_t> bytes);

  [[nodiscard]] const ::MotorBoard& firmware() const { return firmware_; }
  [[nodiscard]] const WheeledRobot& robot() const { return robot_; }
  WheeledRobot& robot() { return robot_; }
  /// Put a ball before the kicker, or take it away; a kick does so, too.
  void put_ball(bool there) { ball_ = there; }

 private:
  void run_firmware();
  void measure();
  void answer();

  MotorBoardParameters parameters_;
  WheeledRobot robot_;
  Imu imu_;
  ::MotorBoard firmware_{};
  std::deque<std::uint8_t> input_;
  std::deque<std::uint8_t> output_;
  Duration now_{};
  Duration answered_{};  ///< when
  Duration carried_{};   ///< of steps that were no whole millisecond
  double charge_ = 0;    ///< of the capacitor's energy, 0 to 1
  double dribbler_radps_ = 0;
  bool ball_ = false;
  double accel_x_sum_ = 0;  ///< since the last answer [m/s]
  double accel_y_sum_ = 0;
  double answered_heading_ = 0;
};

/// A simulated board in this process, as a cable: it lives in the time of the beats. What is sent arrives at once, what
/// it answers comes with the next beat.
class SimulatedLink final : public motor_board::BoardLink {
 public:
  explicit SimulatedLink(const MotorBoardParameters& parameters = {}) : board_{parameters} {}
  [[nodiscard]] MotorBoard& board() { return board_; }

  Result<> open() override { return {}; }
  void close() noexcept override {}
  Result<> send(std::span<const std::uint8_t> bytes) override {
    board_.receive(bytes);
    return {};
  }
  Result<std::size_t> receive(const Tick& tick, std::span<std::uint8_t> bytes) override {
    board_.step(tick.dt);
    return board_.transmit(bytes);
  }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  MotorBoard board_;
  std::string name_ = "simulated";
};

}  // namespace regista::sim
