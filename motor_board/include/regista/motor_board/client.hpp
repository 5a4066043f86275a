// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/motor_board/frame.h>

#include <chrono>
#include <optional>
#include <regista/motor_board/link.hpp>

namespace regista::motor_board {

/// The computer's end of the cable: commands out, telemetry in, each kick once, and a board that is silent is an error.
class BoardClient {
 public:
  /// Without telemetry for so long, the board is gone.
  static constexpr Duration patience = std::chrono::milliseconds{100};
  /// The same after open(): a board that was just plugged in has to start.
  static constexpr Duration first_patience = std::chrono::seconds{1};

  explicit BoardClient(std::unique_ptr<BoardLink> link) : link_{std::move(link)} {}

  Result<> open();
  void close() noexcept { link_->close(); }

  /// Take what has come; `telemetry()` is then the newest. Fails when the cable is gone or the board silent, in words.
  Result<> receive(const Tick& tick);
  /// How many telemetry frames the last receive() brought.
  [[nodiscard]] std::size_t received() const { return received_; }
  [[nodiscard]] const MotorBoardTelemetry& telemetry() const { return telemetry_; }

  /// Send the set-points; `sequence` and the kick are filled in here.
  Result<> send(MotorBoardCommand command);
  /// Brake all wheels, dribbler and charger off, if the cable still takes it.
  void rest() noexcept;

  /// Kick with the next frames, until the board says that it has. Fails, in words, without charge, or while another
  /// kick is under way. `angle_rad`: 0 is flat.
  Result<> kick(double speed_mps, double angle_rad);

  /// Frames of the board with a wrong CRC.
  [[nodiscard]] std::uint16_t refused() const { return parser_.refused; }
  [[nodiscard]] const std::string& name() const { return link_->name(); }

 private:
  struct Kick {
    std::uint8_t id = 0;
    std::uint16_t speed_mmps = 0;
    std::uint16_t angle_mrad = 0;
    Duration waited{};
  };

  std::unique_ptr<BoardLink> link_;
  MotorBoardParser parser_{};
  MotorBoardTelemetry telemetry_{};
  std::size_t received_ = 0;
  bool heard_ = false;  ///< since open()
  Duration silent_{};
  std::uint8_t sequence_ = 0;
  std::optional<Kick> kick_;
};

/// Edges between two counts of an encoder, which may have wrapped.
[[nodiscard]] inline double turned_edges(std::int32_t before, std::int32_t now) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(now) - static_cast<std::uint32_t>(before));
}
/// On the board's clock, which may have wrapped.
[[nodiscard]] inline Duration elapsed(const MotorBoardTelemetry& before, const MotorBoardTelemetry& now) {
  return std::chrono::microseconds{now.time_us - before.time_us};
}

/// Into the frames' integers, saturated.
[[nodiscard]] std::int32_t milli(double value);

}  // namespace regista::motor_board
