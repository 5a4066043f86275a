// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gps.h>

#include <memory>
#include <optional>
#include <regista/core/result.hpp>
#include <string>
#include <variant>

#include "local_frame.hpp"

namespace regista {

/// How many receivers gpsd knows.
struct Receivers {
  int count = 0;
};
using GpsdReport = std::variant<Fix, Receivers>;

/// The way to a gpsd.
class GpsdLink {
 public:
  virtual ~GpsdLink() = default;
  /// May block, as long as TCP's connect does.
  virtual Result<> open() = 0;
  virtual void close() noexcept = 0;
  [[nodiscard]] virtual int descriptor() const = 0;
  /// The next of what has come, or nothing when that is all; does not wait. An error is a gpsd that is gone.
  virtual Result<std::optional<GpsdReport>> receive() = 0;
  /// "gpsd at 127.0.0.1:2947", for texts.
  [[nodiscard]] virtual const std::string& name() const = 0;
};

/// Through libgps, over TCP. `receiver`: the device's path, if gpsd has several; empty: whichever reports.
std::unique_ptr<GpsdLink> libgps_link(std::string host, std::uint16_t port, std::string receiver);

/// gpsd's TPV and SKY in SI. What is not finite is taken as unknown; a position that is none on earth, or exactly 0, 0
/// (what some receivers say before they know), as no fix. Errors of gpsd are at 95 %, as its manual guesses.
[[nodiscard]] Fix to_fix(const gps_data_t& data);

}  // namespace regista
