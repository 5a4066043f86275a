// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/canopen/can_frame.hpp>
#include <regista/core/result.hpp>

namespace regista::canopen {

struct ReceivedFrame {
  CanFrame frame;
  Time time;  ///< when it was on the bus, as well as the bus knows
};

/// So many frames are taken in a row, see CanBus::receive().
inline constexpr std::size_t frames_at_once = 16;

/// The seam to the wire: a socket, a remote bus, or a bus in memory. One thread at a time; never blocks.
class CanBus {
 public:
  virtual ~CanBus() = default;
  /// Hand one frame over. Fails with `no_buffer_space` while the bus is saturated (nothing was taken: try again a
  /// little later) and with `network_down` or `no_such_device` when there is no bus any more.
  virtual Result<> send(const CanFrame& frame) = 0;
  /// Take the next frame that came, error frames among them; empty when none waits. Our own frames do not come back.
  /// Who begins takes frames_at_once of them, or until it is empty, as serve() does: a bus may have asked the system
  /// for so many.
  virtual Result<std::optional<ReceivedFrame>> receive() = 0;
  /// Readable when a frame waits for who has not begun. -1 where there is none.
  [[nodiscard]] virtual int descriptor() const = 0;
};

/// A machine that takes part in a bus: frames and time in, frames out (to the bus that it was made with).
class Station {
 public:
  virtual ~Station() = default;
  /// `now` is when the frame is processed and never goes back.
  virtual void on_frame(const CanFrame& frame, Time now) = 0;
  /// Does what is due. Harmless when nothing is.
  virtual void on_time(Time now) = 0;
  /// When on_time is to be called next, at the latest; Time::max() if nothing is ever due.
  [[nodiscard]] virtual Time next_wake() const = 0;
};

/// Hands frames that wait to the station, up to frames_at_once, then the time. The descriptor stays readable while
/// there are more. Fails as receive() does.
Result<> serve(CanBus& bus, Station& station, Time now);

}  // namespace regista::canopen
