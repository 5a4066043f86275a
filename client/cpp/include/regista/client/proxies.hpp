// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/client/position2d.hpp>

namespace regista::client {

/// Battery or supply. What the device does not measure is empty.
class PowerProxy final : public Proxy<Power> {
 public:
  using Proxy::Proxy;

  [[nodiscard]] const power::State& state() const { return latest<power::State>().value; }
  [[nodiscard]] std::optional<double> voltage_v() const { return valid(power::volts, state().voltage_v); }
  [[nodiscard]] std::optional<double> charge_percent() const { return valid(power::percent, state().charge_percent); }
  [[nodiscard]] std::optional<double> energy_j() const { return valid(power::joules, state().energy_j); }
  [[nodiscard]] std::optional<double> power_w() const { return valid(power::watts, state().power_w); }

  /// May it be charged, and charge others?
  void set_charging_policy(bool input, bool output) { (void)request(power::SetChargingPolicy{input, output}); }

 private:
  [[nodiscard]] std::optional<double> valid(power::Valid bit, double value) const {
    return (state().valid & bit) != 0 ? std::optional{value} : std::nullopt;
  }
};

/// Kicker and dribbler of a soccer robot.
class KickerProxy final : public Proxy<Kicker> {
 public:
  using Proxy::Proxy;

  [[nodiscard]] const kicker::State& state() const { return latest<kicker::State>().value; }
  void kick(float speed_mps) { send(kicker::KickCommand{speed_mps}); }
  void chip(float speed_mps, float angle_rad) { send(kicker::ChipCommand{speed_mps, angle_rad}); }
  void dribble(float speed_radps) { send(kicker::DribblerCommand{speed_radps}); }  ///< positive holds the ball
  void charge(bool on) { send(kicker::ChargeCommand{on}); }
  [[nodiscard]] kicker::Geometry geometry() { return request(kicker::GetGeometry{}); }
  [[nodiscard]] kicker::Limits limits() { return request(kicker::GetLimits{}); }
};

/// Inertial measurement unit. Which of its messages come is set with `set_data_type<imu::Calibrated>()`.
class ImuProxy final : public Proxy<Imu> {
 public:
  using Proxy::Proxy;

  [[nodiscard]] const imu::State& state() const { return latest<imu::State>().value; }
  [[nodiscard]] const imu::Calibrated& calibrated() const { return latest<imu::Calibrated>().value; }
  [[nodiscard]] const imu::Quaternion& quaternion() const { return latest<imu::Quaternion>().value; }
  [[nodiscard]] const imu::Euler& euler() const { return latest<imu::Euler>().value; }
  [[nodiscard]] const imu::FullState& full_state() const { return latest<imu::FullState>().value; }

  template <DataType D>
  void set_data_type() {
    static_assert(D::message.interface == imu::code);
    (void)request(imu::SetDataType{D::message.subtype});
  }
  void reset_orientation() { (void)request(imu::ResetOrientation{}); }
};

/// Satellite receiver.
class GpsProxy final : public Proxy<Gps> {
 public:
  using Proxy::Proxy;

  [[nodiscard]] const gps::State& state() const { return latest<gps::State>().value; }
  [[nodiscard]] double latitude_deg() const { return state().latitude / 1e7; }
  [[nodiscard]] double longitude_deg() const { return state().longitude / 1e7; }
  [[nodiscard]] double altitude_m() const { return state().altitude_mm / 1e3; }
};

/// Digital inputs and outputs; bit 0 is number 0.
class DioProxy final : public Proxy<Dio> {
 public:
  using Proxy::Proxy;

  [[nodiscard]] const dio::State& state() const { return latest<dio::State>().value; }
  [[nodiscard]] bool input(unsigned number) const {
    return number < 32 && number < state().count && (state().bits >> number & 1u) != 0;
  }
  /// The first `count` outputs.
  void set_outputs(std::uint32_t count, std::uint32_t bits) { send(dio::OutputCommand{count, bits}); }
};

/// Bytes that only the driver and its client understand.
class OpaqueProxy final : public Proxy<Opaque> {
 public:
  using Proxy::Proxy;

  [[nodiscard]] const std::vector<std::uint8_t>& bytes() const { return latest<opaque::State>().value.bytes; }
  void send_bytes(std::vector<std::uint8_t> bytes) { send(opaque::Command{std::move(bytes)}); }
  [[nodiscard]] std::vector<std::uint8_t> request_bytes(std::vector<std::uint8_t> bytes) {
    return request(opaque::Request{std::move(bytes)}).bytes;
  }
};

/// Which proxy stands for an interface: the one above, or else Proxy<I>.
template <InterfaceType I>
struct ProxyFor {
  using Type = Proxy<I>;
};
template <>
struct ProxyFor<Position2d> {
  using Type = Position2dProxy;
};
template <>
struct ProxyFor<Power> {
  using Type = PowerProxy;
};
template <>
struct ProxyFor<Kicker> {
  using Type = KickerProxy;
};
template <>
struct ProxyFor<Imu> {
  using Type = ImuProxy;
};
template <>
struct ProxyFor<Gps> {
  using Type = GpsProxy;
};
template <>
struct ProxyFor<Dio> {
  using Type = DioProxy;
};
template <>
struct ProxyFor<Opaque> {
  using Type = OpaqueProxy;
};

}  // namespace regista::client
