// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/device/driver.hpp>

#include "bus_link.hpp"
#include "drive_group.hpp"

namespace regista {

/// Drives on one CAN bus, each with a wheel: CiA 402 in profile velocity mode, or Sevcon Gen4.
///
/// `actarray:0` has one rotary actuator for each node, in the order of `nodes`: rad/s at the wheel, rad since the
/// driver was made, which roll over from 256 turns to -256. POWER 1 resets faults, enables all drives at rest, and is
/// answered when they are enabled; nothing else enables them. Whatever befalls one of them (fault, EMCY, silence,
/// boot-up) stops all, until POWER 1 is asked for again. `power:0` is the supply as the drives measure it. `dio:0` has
/// the outputs of `relays`: a command is taken when their drives are up, and written then. What a drive refuses of it,
/// or does not answer, is an event, and the data of `dio:0` say which outputs their drives have confirmed.
///
/// A drive that would go on driving when this process dies is not enabled: see `can_motor::DriveNode`.
///
/// Properties, for people, renewed four times a second: `bus`, and for each node N `nodeN` and `nodeN.emcy`.
///
/// | Key                       | Value                                                              | Default       |
/// |---------------------------|--------------------------------------------------------------------|---------------|
/// | `bus`                     | "can0", "socketcand://robot:29536/can0", "simulated"               | must be there |
/// | `bit_rate`                | [bit/s] for the bus load; the system sets up a real interface      | 500000        |
/// | `nodes`                   | node ids of the drives, up to eight                                | must be there |
/// | `master`                  | our own node id                                                    | 127           |
/// | `profile`                 | "cia402", "sevcon"                                                 | "cia402"      |
/// | `vendor`, `product`       | 1018:01 and :02 that the drives must have, "0x1E"                  | any           |
/// | `dcf`                     | what is to be written to the drives: one file, or one for each     | nothing       |
/// | `gear`                    | turns of the motor for one of the wheel                            | 1             |
/// | `reversed`                | nodes whose motor turns backwards when the wheel goes forward      | none          |
/// | `velocity_unit`           | [rpm of the motor] of 60FF and 606C                                | 1             |
/// | `increments`              | of 6064 in a turn of the motor; 0: angles integrate the speed      | 0             |
/// | `wheel_speed`             | [angle/s] largest                                                  | must be there |
/// | `wheel_accel`, `wheel_decel`, `quick_stop` | [angle/s²] of the drive's own ramps               | the drive's   |
/// | `torque`                  | [%] largest (6072)                                                 | 100           |
/// | `cycle`                   | [s] between two set-points                                         | 0.02          |
/// | `feedback`                | [s] between two messages of a drive                                | 0.02          |
/// | `relays`                  | outputs, each "NODE OBJECT BIT", as "5 60FE:01 16"                 | none          |
class CanMotor final : public Driver {
 public:
  /// The bus that the `.cfg` names.
  explicit CanMotor(Setup& setup);
  /// With this bus.
  CanMotor(Setup& setup, std::unique_ptr<can_motor::BusLink> link);
  ~CanMotor() override;

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override;
  void close() noexcept override;
  [[nodiscard]] std::span<const int> descriptors() const override { return {&descriptor_, 1}; }

  /// An output of a drive: a bit of an object.
  struct Relay {
    canopen::NodeId node = 0;
    canopen::ObjectIndex object{};
    unsigned bit = 0;
  };

 private:
  struct Diagnosis {
    Property<std::string> state;
    Property<std::string> emcy;
  };

  Result<> set_speeds(std::span<const float> radps);
  [[nodiscard]] const can_motor::DriveNode& drive_of(const Relay& relay) const;
  Result<> switch_relays(const dio::OutputCommand& command);
  Result<> switch_object(const Relay& relay);
  void diagnose(Time now);
  [[nodiscard]] double radps_of(std::size_t drive) const;

  Port<Actarray> wheels_;
  Port<Power> power_;
  Port<Dio> relays_port_;
  Property<std::string> bus_text_;
  std::vector<Diagnosis> diagnoses_;

  // As configured.
  std::vector<canopen::NodeId> nodes_;
  can_motor::DriveSettings settings_;
  can_motor::DriveGroup::Options options_;
  std::vector<std::vector<canopen::SdoWrite>> dcf_;
  std::vector<Relay> relays_;
  std::vector<double> units_per_radps_;    ///< of each wheel, signed
  std::vector<double> rad_per_increment_;  ///< likewise
  double fastest_radps_;

  std::unique_ptr<can_motor::BusLink> link_;
  std::unique_ptr<can_motor::DriveGroup> group_;
  int descriptor_ = -1;
  std::vector<std::int32_t> targets_;
  std::vector<double> angles_rad_;  ///< until the drives were made anew
  std::uint32_t wanted_outputs_ = 0;
  std::uint32_t outputs_ = 0;  ///< as they were confirmed
  actarray::State state_;
  Time now_;
  Time diagnosed_;
};

}  // namespace regista
