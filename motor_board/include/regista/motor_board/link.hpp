// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <regista/core/result.hpp>
#include <regista/core/time.hpp>
#include <span>
#include <string>

namespace regista::motor_board {

/// The cable to a motor board: bytes out, bytes in. An error is a cable that is gone; it may be opened again.
class BoardLink {
 public:
  virtual ~BoardLink() = default;
  virtual Result<> open() = 0;
  virtual void close() noexcept = 0;
  /// Does not wait. What the cable cannot take now is lost, as it may be on its way.
  virtual Result<> send(std::span<const std::uint8_t> bytes) = 0;
  /// What has come, as much as fits into `bytes`; none is no error. Does not wait. A simulated board lives in the time
  /// of `tick`.
  virtual Result<std::size_t> receive(const Tick& tick, std::span<std::uint8_t> bytes) = 0;
  /// "/dev/ttyACM0", for texts.
  [[nodiscard]] virtual const std::string& name() const = 0;
  /// Readable when something has come; -1 where nothing tells.
  [[nodiscard]] virtual int descriptor() const { return -1; }
};

/// A serial line, real or over USB, for us alone while it is open. `bits_per_second` is one of termios' (115200,
/// 1000000 …), or throws std::invalid_argument; USB disregards it.
std::unique_ptr<BoardLink> serial_link(std::string device, int bits_per_second);

/// Linux' spidev, mode 0: the frames of both directions pass each other in one transfer, ours filled up with zeros.
std::unique_ptr<BoardLink> spi_link(std::string device, int bits_per_second);

/// By name: "/dev/spidev…" is SPI, all else a serial line.
std::unique_ptr<BoardLink> make_link(std::string device, int bits_per_second);

}  // namespace regista::motor_board
