// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <regista/motor_board/link.hpp>
#include <stdexcept>
#include <utility>

#include "descriptor.hpp"

namespace regista::motor_board {

namespace {

struct Speed {
  int bits_per_second;
  speed_t code;
};
constexpr std::array speeds{Speed{9600, B9600},       Speed{19200, B19200},     Speed{38400, B38400},
                            Speed{57600, B57600},     Speed{115200, B115200},   Speed{230400, B230400},
                            Speed{460800, B460800},   Speed{921600, B921600},   Speed{1000000, B1000000},
                            Speed{2000000, B2000000}, Speed{3000000, B3000000}, Speed{4000000, B4000000}};

class SerialLink final : public BoardLink {
 public:
  SerialLink(std::string device, int bits_per_second) : device_{std::move(device)} {
    const auto* known = std::ranges::find(speeds, bits_per_second, &Speed::bits_per_second);
    if (known == speeds.end()) {
      throw std::invalid_argument{"a serial line has no speed of " + std::to_string(bits_per_second) +
                                  " bits per second; 115200, 1000000 and 2000000 are usual"};
    }
    speed_ = known->code;
  }

  Result<> open() override {
    descriptor_ = Descriptor{::open(device_.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)};
    if (!descriptor_) return failed("open ");
    // The lock keeps another regista away, also one of root's; TIOCEXCL all others.
    if (::flock(descriptor_.get(), LOCK_EX | LOCK_NB) != 0) {
      descriptor_ = {};
      return Error{std::errc::device_or_resource_busy, "open " + device_ + " (another program has it)"};
    }
    termios settings{};
    if (::ioctl(descriptor_.get(), TIOCEXCL) != 0 || ::tcgetattr(descriptor_.get(), &settings) != 0) {
      return failed("set up ");
    }
    ::cfmakeraw(&settings);
    settings.c_cflag |= CLOCAL | CREAD;
    settings.c_cc[VMIN] = 1;  // nothing there is EAGAIN, and 0 bytes are a line that hung up
    settings.c_cc[VTIME] = 0;
    if (::cfsetspeed(&settings, speed_) != 0 || ::tcsetattr(descriptor_.get(), TCSANOW, &settings) != 0 ||
        ::tcflush(descriptor_.get(), TCIOFLUSH) != 0) {
      return failed("set up ");
    }
    return {};
  }

  void close() noexcept override {
    // It stays with a terminal that others have open, as the board's side of a pty is.
    if (descriptor_) (void)::ioctl(descriptor_.get(), TIOCNXCL);
    descriptor_ = {};
  }

  Result<> send(std::span<const std::uint8_t> bytes) override {
    if (::write(descriptor_.get(), bytes.data(), bytes.size()) >= 0 || errno == EAGAIN || errno == EINTR) return {};
    return failed("write to ");
  }

  Result<std::size_t> receive(const Tick&, std::span<std::uint8_t> bytes) override {
    const ssize_t count = ::read(descriptor_.get(), bytes.data(), bytes.size());
    if (count > 0) return static_cast<std::size_t>(count);
    if (count == 0) return Error{std::errc::no_such_device, "read from " + device_ + " (was it unplugged?)"};
    if (errno == EAGAIN || errno == EINTR) return std::size_t{0};
    return failed("read from ");
  }

  [[nodiscard]] const std::string& name() const override { return device_; }
  [[nodiscard]] int descriptor() const override { return descriptor_.get(); }

 private:
  [[nodiscard]] Error failed(const char* what) const {
    return Error{std::error_code{errno, std::generic_category()}, what + device_};
  }

  std::string device_;
  speed_t speed_;
  Descriptor descriptor_;
};

}  // namespace

std::unique_ptr<BoardLink> serial_link(std::string device, int bits_per_second) {
  return std::make_unique<SerialLink>(std::move(device), bits_per_second);
}

std::unique_ptr<BoardLink> make_link(std::string device, int bits_per_second) {
  if (device.starts_with("/dev/spidev")) return spi_link(std::move(device), bits_per_second);
  return serial_link(std::move(device), bits_per_second);
}

}  // namespace regista::motor_board
