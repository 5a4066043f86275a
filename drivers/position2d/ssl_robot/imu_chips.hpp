// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <regista/control/imu_calibration.hpp>
#include <regista/core/result.hpp>
#include <span>
#include <string>

namespace regista {

/// A bus of chips with registers.
class I2cBus {
 public:
  virtual ~I2cBus() = default;
  virtual Result<> open() = 0;
  virtual void close() noexcept = 0;
  /// Write `out` to the chip, then, without letting go of the bus, read `in` from it, if there is something to read.
  virtual Result<> transfer(std::uint8_t chip, std::span<const std::uint8_t> out, std::span<std::uint8_t> in) = 0;
};

/// Linux' i2c-dev, such as "/dev/i2c-1".
std::unique_ptr<I2cBus> linux_i2c(std::string device);

/// An accelerometer ADXL345 at 0x53 (Analog Devices, data sheet revision G) and a gyro ITG-3200 at 0x68 (InvenSense,
/// PS-ITG-3200A-00 revision 1.7) on one bus: "6 DOF" boards carry both, their axes parallel.
class ImuChips {
 public:
  explicit ImuChips(std::unique_ptr<I2cBus> bus) : bus_{std::move(bus)} {}

  /// Finds both chips and sets them up: ±16 g in full resolution at 800 Hz, ±2000 °/s at 1 kHz behind 188 Hz.
  Result<> open();
  void close() noexcept { bus_->close(); }
  /// In the chips' axes. Takes 0.5 ms of the bus at 400 kHz.
  Result<control::ImuSample> read();

 private:
  Result<> write(std::uint8_t chip, std::uint8_t reg, std::uint8_t value);

  std::unique_ptr<I2cBus> bus_;
};

}  // namespace regista
