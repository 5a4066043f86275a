// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/motor_board/board.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <regista/control/kinematics.hpp>
#include <regista/device/driver.hpp>
#include <regista/motor_board/link.hpp>
#include <span>
#include <string>
#include <vector>

namespace regista {

/// What one robot of a simulator is told in one beat.
struct SimulatorCommand {
  std::uint32_t robot = 0;  ///< its pattern, 0 to 15
  bool yellow = false;
  BodyVelocity velocity{};
  double kick_mps = 0;  ///< 0: no kick
  double kick_rad = 0;  ///< above the floor
  double dribbler_radps = 0;
};

/// What brings a robot to rest at once, whatever its velocity: all wheels at 0. A velocity of 0 alone does not: grSim
/// takes each command for a step of deceleration from the velocity that the robot has, and drives on at what is left
/// when no other follows.
struct SimulatorBrake {
  std::uint32_t robot = 0;
  bool yellow = false;
};

/// RobotControl of the league's simulation protocol (github.com/RoboCup-SSL/ssl-simulation-protocol), as protobuf has
/// it.
[[nodiscard]] std::vector<std::uint8_t> league_packet(const SimulatorCommand& command);
[[nodiscard]] std::vector<std::uint8_t> league_packet(const SimulatorBrake& brake);
/// grSim_Packet of grSim's own protocol.
[[nodiscard]] std::vector<std::uint8_t> grsim_packet(const SimulatorCommand& command);
[[nodiscard]] std::vector<std::uint8_t> grsim_packet(const SimulatorBrake& brake);
/// Whether a RobotControlResponse says that this robot's dribbler has the ball; nothing when it says nothing of it.
[[nodiscard]] std::optional<bool> ball_contact(std::span<const std::uint8_t> response, std::uint32_t robot);

struct SimulatorAddress {
  std::string host = "127.0.0.1";
  std::uint16_t port = 0;
  bool grsim = false;
  std::uint32_t robot = 0;
  bool yellow = false;
};

/// A robot of a simulator as a motor board: the reference firmware, with a radio for its wheels. A simulator tells of
/// no encoders; the wheels are taken to turn as they were told, and the camera corrects that.
class SimulatorLink final : public motor_board::BoardLink {
 public:
  SimulatorLink(SimulatorAddress address, const control::Kinematics& kinematics, double wheel_radius_m,
                double edges_per_rad);
  ~SimulatorLink() override { close(); }
  SimulatorLink(const SimulatorLink&) = delete;
  SimulatorLink& operator=(const SimulatorLink&) = delete;

  Result<> open() override;
  void close() noexcept override;
  /// Goes out by radio at once: who halts and closes sends nothing after it.
  Result<> send(std::span<const std::uint8_t> bytes) override;
  /// One beat of the robot: what was sent last comes back as if it had been measured. Fails where nobody listens at the
  /// simulator's port.
  Result<std::size_t> receive(const Tick& tick, std::span<std::uint8_t> bytes) override;
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  Result<> listen();
  Result<> radio();
  Result<> transmit(std::span<const std::uint8_t> packet);
  [[nodiscard]] Error failed(int error) const;
  [[nodiscard]] std::uint32_t now_us() const;

  SimulatorAddress address_;
  control::Kinematics kinematics_;
  double wheel_radius_m_;
  double edges_per_rad_;
  std::string name_;
  int socket_ = -1;
  MotorBoard firmware_{};
  bool answers_ = false;  ///< the firmware took a command, and has not told of it
  Duration now_{};
  double edges_[motor_board_wheels] = {};
};

/// The driver of a robot whose wheels tell what they were told and not how they turn, which a simulator that stalls, or
/// runs slower than time, makes two things: the camera, behind the bridge, is believed sooner than by ssl_robot.
std::unique_ptr<Driver> simulated_robot(Setup& setup, SimulatorAddress address);

}  // namespace regista
