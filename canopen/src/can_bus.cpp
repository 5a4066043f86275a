// SPDX-License-Identifier: Apache-2.0
#include <regista/canopen/can_bus.hpp>

namespace regista::canopen {

Result<> serve(CanBus& bus, Station& station, Time now) {
  while (true) {
    const auto received = bus.receive();
    if (!received) return received.error();
    if (!*received) break;
    station.on_frame((*received)->frame, now);
  }
  station.on_time(now);
  return {};
}

}  // namespace regista::canopen
