// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <regista/canopen/can_bus.hpp>
#include <string>

namespace regista::canopen {

/// A bus by its name: a CAN interface of Linux ("can0"), or "socketcand://HOST[:PORT]/BUS". The second blocks for up to
/// 3 s. Fails as the two do, and with `invalid_argument`.
Result<std::unique_ptr<CanBus>> open_bus(const std::string& name);

}  // namespace regista::canopen
