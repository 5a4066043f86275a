// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <regista/canopen/can_bus.hpp>
#include <regista/sim/can_drives.hpp>
#include <string>

namespace regista::can_motor {

/// The seam between the driver and its bus: a real one with a descriptor to wait for, or one in this process that lives
/// in the time of the beats.
class BusLink {
 public:
  virtual ~BusLink() = default;
  /// The bus, closed before if it was open. Fails as it does.
  virtual Result<canopen::CanBus*> open() = 0;
  /// The station that run() is for; it is gone after close().
  virtual void join(canopen::Station& station) = 0;
  virtual Result<> run(Time now) = 0;
  virtual void close() noexcept = 0;
  /// Readable: run(). -1: the beats do.
  [[nodiscard]] virtual int descriptor() const = 0;
};

/// "can0", "socketcand://robot:29536/can0".
std::unique_ptr<BusLink> make_bus_link(const std::string& name);

/// Simulated drives in this process.
class SimulatedBusLink final : public BusLink {
 public:
  SimulatedBusLink(std::span<const canopen::NodeId> nodes, const sim::CanDriveParameters& parameters, int bit_rate)
      : drives_{nodes, parameters, bit_rate} {}
  sim::CanDrives& drives() { return drives_; }

  Result<canopen::CanBus*> open() override { return static_cast<canopen::CanBus*>(&drives_.port()); }
  void join(canopen::Station& station) override { station_ = &station; }
  Result<> run(Time now) override { return drives_.run(*station_, now); }
  void close() noexcept override {
    station_ = nullptr;
    drives_.pause();
  }
  [[nodiscard]] int descriptor() const override { return -1; }

 private:
  sim::CanDrives drives_;
  canopen::Station* station_ = nullptr;
};

}  // namespace regista::can_motor
