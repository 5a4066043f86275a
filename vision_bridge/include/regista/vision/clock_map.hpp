// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/core/time.hpp>

namespace regista::vision {

/// Turns the times that frames bear into ours. The sender's clock may count from anything and run wrong by 3 %; only
/// t_sent - t_capture is believed, and that a datagram cannot arrive before it was sent:
///
///     captured = arrival - (t_sent - t_capture) - delay
///
/// where `arrival` is cleared of what the network and this computer's load added: of arrival - t_sent the least of
/// late counts, and is allowed to grow by 3 % of the time that passes.
class ClockMap {
 public:
  /// When an image with these times was taken. Numbers must be finite; `arrival` not before that of the last call.
  Time captured(double t_capture_s, double t_sent_s, Time arrival, Duration delay);

 private:
  bool started_ = false;
  double offset_s_ = 0;  ///< our clock minus the sender's
  Time last_{};
};

}  // namespace regista::vision
