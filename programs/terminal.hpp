// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>  // NOLINT(modernize-deprecated-headers): POSIX' pseudo-terminals
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <filesystem>
#include <regista/sim/motor_board.hpp>
#include <string>
#include <system_error>
#include <vector>

namespace regista::programs {

/// Both ends of a pseudo-terminal. The near one stays open too, so that the far one outlives whoever uses it.
class Terminal {
 public:
  Terminal() : board_{::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)} {
    std::array<char, 128> name{};
    if (board_ < 0 || ::grantpt(board_) != 0 || ::unlockpt(board_) != 0 ||
        ::ptsname_r(board_, name.data(), name.size()) != 0) {
      throw std::system_error{errno, std::generic_category(), "open a pseudo-terminal"};
    }
    path_ = name.data();
    computer_ = ::open(path_.c_str(), O_RDWR | O_NOCTTY);
    termios settings{};
    if (computer_ < 0 || ::tcgetattr(computer_, &settings) != 0) {
      throw std::system_error{errno, std::generic_category(), "open " + path_};
    }
    ::cfmakeraw(&settings);
    (void)::tcsetattr(computer_, TCSANOW, &settings);
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;
  ~Terminal() {
    ::close(computer_);
    ::close(board_);
  }

  [[nodiscard]] const std::string& path() const { return path_; }

  /// Make `link` a symbolic link to it; one that is there is replaced.
  void link(const std::filesystem::path& link) const {
    if (std::filesystem::is_symlink(link)) std::filesystem::remove(link);
    std::filesystem::create_symlink(path_, link);
  }

  [[nodiscard]] int fileno() const { return board_; }

  /// Carry bytes both ways. Does not wait.
  void exchange(sim::MotorBoard& board) const {
    std::array<std::uint8_t, 4096> bytes{};
    const ssize_t received = ::read(board_, bytes.data(), bytes.size());
    if (received > 0) board.receive(std::span{bytes}.first(static_cast<std::size_t>(received)));
    const std::size_t count = board.transmit(bytes);
    // Nobody may be there to take it; then it is lost, as on a cable.
    if (count > 0 && ::write(board_, bytes.data(), count) < 0 && errno == EAGAIN) (void)::tcflush(computer_, TCIFLUSH);
  }

 private:
  int board_;
  int computer_ = -1;
  std::string path_;
};

/// Until the computer has sent something to one of them, or this long.
template <typename Terminals>
void wait(const Terminals& terminals, int milliseconds) {
  std::vector<pollfd> ready;
  for (const Terminal& terminal : terminals) ready.push_back({.fd = terminal.fileno(), .events = POLLIN, .revents = 0});
  (void)::poll(ready.data(), ready.size(), milliseconds);
}

}  // namespace regista::programs
