// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <optional>
#include <regista/canopen/slave.hpp>
#include <regista/canopen/virtual_bus.hpp>
#include <regista/sim/cia402_drive.hpp>

namespace regista::sim {

struct CanDriveParameters {
  Cia402DriveParameters motion = {};
  std::uint32_t vendor = 0x52454741;  ///< 1018:01
  std::uint32_t product = 0x402;      ///< 1018:02
  bool sevcon = false;                ///< with the objects of a Gen4 instead of those of CiA 402 that it lacks
  bool watches_master = true;         ///< has 1016, 6007 and 1400:05, in a Gen4 5902: what stops it by itself
  std::int32_t increments = 4096;     ///< of 6064 in a turn of the motor
  double volts = 48;                  ///< of the supply
  double rpm_per_unit = 1;            ///< of its speeds and ramps: 60FF, 606C, 6080, 6083 to 6085
  /// Makes another drive of it: objects that it lacks, or does not let be written.
  std::function<void(canopen::ObjectDictionary&)> change = {};
};

/// A CiA 402 drive in profile velocity mode as a node on a bus: canopen::Slave with a Cia402Drive behind its objects.
/// Without the master, set-points or NMT operational it does what 6007 says.
class CanDrive final : public canopen::Station {
 public:
  CanDrive(canopen::CanBus& bus, canopen::NodeId node, const CanDriveParameters& parameters);

  void on_frame(const canopen::CanFrame& frame, Time now) override;
  void on_time(Time now) override;
  [[nodiscard]] Time next_wake() const override;
  /// Time until the next of these does not pass for it.
  void pause() { stepped_.reset(); }

  /// The power goes and comes back.
  void power_cycle(Time now);
  /// Something broke: an EMCY, and the drive brakes and stays in fault.
  void fail(std::uint16_t code, Time now);

  [[nodiscard]] const Cia402Drive& drive() const { return drive_; }
  canopen::Slave& slave() { return slave_; }

 private:
  std::optional<canopen::SdoAbort> written(canopen::ObjectIndex object, canopen::ByteView bytes);
  void reading(canopen::ObjectIndex object);
  void abort_connection(std::uint16_t code);
  void step(Time now);

  CanDriveParameters parameters_;
  Cia402Drive drive_;
  canopen::Slave slave_;
  std::optional<Time> stepped_;
  bool faulted_ = false;
};

/// Drives and whoever commands them on a bus in memory, in one process: time passes only in run().
class CanDrives {
 public:
  /// One drive for each of the nodes.
  CanDrives(std::span<const canopen::NodeId> nodes, const CanDriveParameters& parameters, int bit_rate = 500'000);

  /// Where the master is attached.
  canopen::VirtualBus::Port& port() { return *port_; }
  canopen::VirtualBus& bus() { return bus_; }
  [[nodiscard]] std::size_t size() const { return drives_.size(); }
  CanDrive& drive(std::size_t i) { return drives_[i]; }
  canopen::VirtualBus::Port& port_of(std::size_t i) { return *drive_ports_[i]; }

  /// From event to event, frames and what everybody wants to be woken for, until `now`. Fails as the master's port
  /// does.
  Result<> run(canopen::Station& master, Time now);
  /// Time until the next run() does not pass for the drives, but for what they are waiting for.
  void pause() {
    now_.reset();
    for (CanDrive& drive : drives_) drive.pause();
  }

 private:
  Result<> settle(canopen::Station& master, Time now);

  canopen::VirtualBus bus_;
  canopen::VirtualBus::Port* port_;
  std::vector<canopen::VirtualBus::Port*> drive_ports_;
  std::deque<CanDrive> drives_;
  std::optional<Time> now_;
};

}  // namespace regista::sim
