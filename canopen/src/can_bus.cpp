// SPDX-License-Identifier: Apache-2.0
#include <regista/canopen/can_bus.hpp>

namespace regista::canopen {

Result<> serve(CanBus& bus, Station& station, Time now) {
  // Not until none is left: on a busy bus that is never, and then the time would stand still and every deadline be
  // missed.
  for (std::size_t i = 0; i < frames_at_once; ++i) {
    const auto received = bus.receive();
    if (!received) return received.error();
    if (!*received) break;
    station.on_frame((*received)->frame, now);
  }
  station.on_time(now);
  return {};
}

}  // namespace regista::canopen
