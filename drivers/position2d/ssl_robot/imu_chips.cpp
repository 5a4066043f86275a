// SPDX-License-Identifier: Apache-2.0
#include "imu_chips.hpp"

#include <fcntl.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <numbers>
#include <utility>

namespace regista {

namespace {

/// ADXL345, table 19 "Register Map", and the paragraphs on the registers that follow it.
namespace adxl345 {
constexpr std::uint8_t address = 0x53;  // ALT ADDRESS low
constexpr std::uint8_t devid = 0x00, devid_value = 0xE5;
constexpr std::uint8_t bw_rate = 0x2C, rate_800_hz = 0x0D;  // the most that I²C at 400 kHz can take (table 11)
constexpr std::uint8_t power_ctl = 0x2D, measure = 0x08;
constexpr std::uint8_t data_format = 0x31, full_resolution_16_g = 0x0B;
constexpr std::uint8_t datax0 = 0x32;           // x, y, z: low byte first
constexpr double mps2_per_lsb = 9.80665 / 256;  // table 1: 256 LSB/g in full resolution
}  // namespace adxl345

/// ITG-3200, section 7 "Register Map" and 8.
namespace itg3200 {
constexpr std::uint8_t address = 0x68;  // AD0 low
constexpr std::uint8_t who_am_i = 0x00, who_mask = 0x7E, who_value = 0x68;
constexpr std::uint8_t smplrt_div = 0x15;
constexpr std::uint8_t dlpf_fs = 0x16, range_2000_188_hz = 0x19;  // FS_SEL 3, DLPF_CFG 1
constexpr std::uint8_t pwr_mgm = 0x3E, clock_of_x_gyro = 0x01;
constexpr std::uint8_t gyro_xout_h = 0x1D;                         // x, y, z: high byte first
constexpr double radps_per_lsb = std::numbers::pi / 180 / 14.375;  // section 3.1: 14.375 LSB per °/s
}  // namespace itg3200

class LinuxI2c final : public I2cBus {
 public:
  explicit LinuxI2c(std::string device) : device_{std::move(device)} {}
  ~LinuxI2c() override { close_descriptor(); }

  Result<> open() override {
    close_descriptor();
    descriptor_ = ::open(device_.c_str(), O_RDWR | O_CLOEXEC);
    if (descriptor_ >= 0) return {};
    return Error{std::error_code{errno, std::generic_category()}, "open " + device_};
  }

  void close() noexcept override { close_descriptor(); }

  Result<> transfer(std::uint8_t chip, std::span<const std::uint8_t> out, std::span<std::uint8_t> in) override {
    std::array messages{
        i2c_msg{.addr = chip,
                .flags = 0,
                .len = static_cast<std::uint16_t>(out.size()),
                .buf = const_cast<std::uint8_t*>(out.data())},  // only read, but the struct serves both ways
        i2c_msg{.addr = chip, .flags = I2C_M_RD, .len = static_cast<std::uint16_t>(in.size()), .buf = in.data()}};
    i2c_rdwr_ioctl_data data{.msgs = messages.data(), .nmsgs = in.empty() ? 1U : 2U};
    if (::ioctl(descriptor_, I2C_RDWR, &data) >= 0) return {};
    char text[64];
    (void)std::snprintf(text, sizeof text, "chip 0x%02X on %s", unsigned{chip}, device_.c_str());
    return Error{std::error_code{errno, std::generic_category()}, text};
  }

 private:
  void close_descriptor() noexcept {
    if (descriptor_ >= 0) ::close(descriptor_);
    descriptor_ = -1;
  }

  std::string device_;
  int descriptor_ = -1;
};

std::int16_t two_bytes(std::uint8_t high, std::uint8_t low) { return static_cast<std::int16_t>(high << 8 | low); }

}  // namespace

std::unique_ptr<I2cBus> linux_i2c(std::string device) { return std::make_unique<LinuxI2c>(std::move(device)); }

Result<> ImuChips::write(std::uint8_t chip, std::uint8_t reg, std::uint8_t value) {
  return bus_->transfer(chip, std::array{reg, value}, {});
}

Result<> ImuChips::open() {
  if (Result<> opened = bus_->open(); !opened) return opened;
  std::array<std::uint8_t, 1> who{};
  if (Result<> read = bus_->transfer(adxl345::address, std::array{adxl345::devid}, who); !read) return read;
  if (who[0] != adxl345::devid_value) return Error{std::errc::no_such_device, "chip 0x53 is no ADXL345"};
  if (Result<> read = bus_->transfer(itg3200::address, std::array{itg3200::who_am_i}, who); !read) return read;
  if ((who[0] & itg3200::who_mask) != itg3200::who_value) {
    return Error{std::errc::no_such_device, "chip 0x68 is no ITG-3200"};
  }
  struct Setting {
    std::uint8_t chip, reg, value;
  };
  for (const auto [chip, reg, value] : {Setting{adxl345::address, adxl345::bw_rate, adxl345::rate_800_hz},
                                        {adxl345::address, adxl345::data_format, adxl345::full_resolution_16_g},
                                        {adxl345::address, adxl345::power_ctl, adxl345::measure},
                                        {itg3200::address, itg3200::pwr_mgm, itg3200::clock_of_x_gyro},
                                        {itg3200::address, itg3200::smplrt_div, 0},
                                        {itg3200::address, itg3200::dlpf_fs, itg3200::range_2000_188_hz}}) {
    if (Result<> written = write(chip, reg, value); !written) return written;
  }
  return {};
}

Result<control::ImuSample> ImuChips::read() {
  std::array<std::uint8_t, 6> a{};
  std::array<std::uint8_t, 6> g{};
  if (Result<> done = bus_->transfer(adxl345::address, std::array{adxl345::datax0}, a); !done) return done.error();
  if (Result<> done = bus_->transfer(itg3200::address, std::array{itg3200::gyro_xout_h}, g); !done) return done.error();
  control::ImuSample sample;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto axis = static_cast<Eigen::Index>(i);
    sample.accel_mps2(axis) = adxl345::mps2_per_lsb * two_bytes(a[2 * i + 1], a[2 * i]);
    sample.rate_radps(axis) = itg3200::radps_per_lsb * two_bytes(g[2 * i], g[2 * i + 1]);
  }
  return sample;
}

}  // namespace regista
