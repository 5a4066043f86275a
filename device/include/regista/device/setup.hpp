// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <regista/device/config.hpp>
#include <regista/device/port.hpp>
#include <regista/device/property.hpp>
#include <regista/device/required.hpp>

namespace regista {

/// What a driver finds when it is made: its section of the `.cfg`, its ports, the devices it stands on, its properties.
class Setup {
 public:
  explicit Setup(Section section) : config{std::move(section)} {}
  Setup(const Setup&) = delete;
  Setup& operator=(const Setup&) = delete;

  const Section config;

  /// A device that this driver implements. `key` tells two of one interface apart (`provides ["left:::power:0"]`).
  template <InterfaceType I>
  Port<I> provide(std::string_view key = "") {
    PortCore& core = ports.emplace_back();
    core.interface = I::code;
    core.key = key;
    core.number = ports.size() - 1;
    return Port<I>{core};
  }

  /// A device of another driver that this one uses (`requires ["imu:0"]`).
  template <InterfaceType I>
  Required<I> require(std::string_view key = "") {
    RequiredCore& core = required.emplace_back();
    core.interface = I::code;
    core.key = key;
    core.number = required.size() - 1;
    return Required<I>{core};
  }

  /// T: std::int32_t, double, bool or std::string.
  template <typename T>
  Property<T> property(std::string_view name, T initial, const PropertyOptions& options = {}) {
    PropertyCore& core = properties.emplace_back();
    core.name = name;
    core.value = std::move(initial);
    core.options = options;
    return Property<T>{core};
  }

  // For the host; deques, because drivers hold pointers to their elements.
  std::deque<PortCore> ports;
  std::deque<RequiredCore> required;
  std::deque<PropertyCore> properties;
};

}  // namespace regista
