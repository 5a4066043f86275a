// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <linux/spi/spidev.h>
#include <regista/motor_board/frame.h>
#include <sys/ioctl.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <regista/motor_board/link.hpp>
#include <utility>

#include "descriptor.hpp"

namespace regista::motor_board {

namespace {

class SpiLink final : public BoardLink {
 public:
  SpiLink(std::string device, int bits_per_second)
      : device_{std::move(device)}, bits_per_second_{static_cast<std::uint32_t>(bits_per_second)} {}

  Result<> open() override {
    descriptor_ = Descriptor{::open(device_.c_str(), O_RDWR | O_CLOEXEC)};
    if (!descriptor_) return failed("open ");
    const std::uint8_t mode = SPI_MODE_0;
    const std::uint8_t bits = 8;
    if (::ioctl(descriptor_.get(), SPI_IOC_WR_MODE, &mode) < 0 ||
        ::ioctl(descriptor_.get(), SPI_IOC_WR_BITS_PER_WORD, &bits) < 0 ||
        ::ioctl(descriptor_.get(), SPI_IOC_WR_MAX_SPEED_HZ, &bits_per_second_) < 0) {
      return failed("set up ");
    }
    fresh_ = false;
    return {};
  }

  void close() noexcept override { descriptor_ = {}; }

  Result<> send(std::span<const std::uint8_t> bytes) override {
    out_ = {};
    std::ranges::copy(bytes.first(std::min(bytes.size(), out_.size())), out_.begin());
    spi_ioc_transfer transfer{};
    transfer.tx_buf = reinterpret_cast<std::uintptr_t>(out_.data());
    transfer.rx_buf = reinterpret_cast<std::uintptr_t>(in_.data());
    transfer.len = static_cast<std::uint32_t>(out_.size());
    transfer.speed_hz = bits_per_second_;
    if (::ioctl(descriptor_.get(), SPI_IOC_MESSAGE(1), &transfer) < 0) return failed("transfer over ");
    fresh_ = true;
    return {};
  }

  Result<std::size_t> receive(const Tick&, std::span<std::uint8_t> bytes) override {
    if (!std::exchange(fresh_, false)) return std::size_t{0};
    const std::size_t count = std::min(bytes.size(), in_.size());
    std::copy_n(in_.begin(), count, bytes.begin());
    return count;
  }

  [[nodiscard]] const std::string& name() const override { return device_; }

 private:
  [[nodiscard]] Error failed(const char* what) const {
    return Error{std::error_code{errno, std::generic_category()}, what + device_};
  }

  using Transfer = std::array<std::uint8_t, motor_board_telemetry_size>;

  std::string device_;
  std::uint32_t bits_per_second_;
  Descriptor descriptor_;
  Transfer out_{};
  Transfer in_{};
  bool fresh_ = false;  ///< `in_` came with the last transfer
};

}  // namespace

std::unique_ptr<BoardLink> spi_link(std::string device, int bits_per_second) {
  return std::make_unique<SpiLink>(std::move(device), bits_per_second);
}

}  // namespace regista::motor_board
