// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <regista/device/driver.hpp>
#include <regista/motor_board/client.hpp>

namespace regista {

/// A motor board with up to four wheels, each by itself: for rovers that another driver, or a program, steers.
///
/// `actarray:0` has one rotary actuator for each wheel, in the board's order; its speeds are in rad/s at the wheel, its
/// positions in rad since the driver opened. `power:0` is the battery.
///
/// | Key           | Value                                                         | Default       |
/// |---------------|---------------------------------------------------------------|---------------|
/// | `port`        | "/dev/ttyACM0", "/dev/spidev0.0", "simulated"                 | must be there |
/// | `baud`        | [bits/s] of it                                                | 1000000       |
/// | `wheels`      | how many of the board's four are there                        | 4             |
/// | `ticks`       | edges that the board counts in one turn of a wheel            | 144           |
/// | `wheel_speed` | [rad/s] largest                                               | 100           |
class MotorBoardDriver final : public Driver {
 public:
  /// The board that the `.cfg` names.
  explicit MotorBoardDriver(Setup& setup);
  /// With this cable to it.
  MotorBoardDriver(Setup& setup, std::unique_ptr<motor_board::BoardLink> link);

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override;
  void close() noexcept override { board_.close(); }

 private:
  /// `joint` -1: all wheels.
  Result<> set_speed(std::int32_t joint, double radps);

  Port<Actarray> wheels_;
  Port<Power> power_;
  std::size_t count_;
  double rad_per_edge_;
  double fastest_radps_;
  motor_board::BoardClient board_;
  std::array<double, motor_board_wheels> targets_radps_{};
  std::optional<MotorBoardTelemetry> before_;
  std::array<double, motor_board_wheels> angles_rad_{};
  bool powered_ = true;
  actarray::State state_;
};

}  // namespace regista
