// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/core/result.hpp>
#include <regista/core/time.hpp>
#include <regista/device/setup.hpp>
#include <span>

namespace regista {

/// One piece of hardware, or one skill that uses other devices. The host calls everything below, and every handler of
/// its ports, on one thread, in this order:
///
///     open -> { process messages -> read -> publish }* -> halt -> close
///
/// Messages are processed when they arrive; the beat (`rate` in the .cfg) paces read and publish, and so does each
/// descriptor that becomes readable. A driver starts no threads, takes no locks and reads no clocks.
///
/// What a call throws or returns as an error is a fault: the host halts the driver, tells the clients, and opens it
/// again with back-off.
class Driver {
 public:
  Driver() = default;
  virtual ~Driver() = default;
  Driver(const Driver&) = delete;
  Driver& operator=(const Driver&) = delete;

  /// Connect to the hardware, on the first subscription (or at start: `alwayson`). May block; clients wait for it.
  virtual Result<> open() { return {}; }
  /// Exchange one round of data with the hardware. Returns within one period.
  virtual Result<> read(const Tick& tick) = 0;
  /// Send what was read through the ports.
  virtual void publish() = 0;
  /// Bring every actuator to rest before returning, within one period. Called after any fault, before close and at
  /// shut-down; harmless when already at rest or never opened.
  virtual void halt() noexcept = 0;
  /// Let go of the hardware, after the last subscription. The next call is open() or the destructor.
  virtual void close() noexcept {}

  /// Readable: an extra beat. Asked after each call; those below 0 are passed over. One that hung up, has nothing left
  /// to read and is still among them after the read() that it led to is a fault.
  [[nodiscard]] virtual std::span<const int> descriptors() const { return {}; }
  /// Stop the hardware although the driver's thread hangs in one of the calls above. On another thread, and alone in
  /// that: no lock, no state, a single write to a descriptor or a pin. False: there is no such way.
  virtual bool stop_out_of_band() noexcept { return false; }
};

}  // namespace regista
