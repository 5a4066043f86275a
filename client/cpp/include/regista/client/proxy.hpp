// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/client/connection.hpp>

namespace regista::client {

class Robot;

/// What came last of one data message. Until `count` is 1, `value` says nothing.
template <DataType D>
struct Sample {
  D value{};
  std::uint64_t count = 0;  ///< how many have come
  Time arrival{};           ///< when it was read here
  double stamp_s = 0;       ///< the server's: seconds since the epoch
};

/// The same of a type that is known only at run time.
struct AnySample {
  AnyData value{};
  std::uint64_t count = 0;
  Time arrival{};
  double stamp_s = 0;
};

/// What all devices have. Every request blocks for the robot's timeout at most, and throws.
class ProxyBase {
 public:
  virtual ~ProxyBase() = default;
  ProxyBase(const ProxyBase&) = delete;
  ProxyBase& operator=(const ProxyBase&) = delete;

  [[nodiscard]] Address address() const { return address_; }
  [[nodiscard]] const std::string& driver() const { return driver_; }
  [[nodiscard]] Robot& robot() const { return robot_; }

  /// Since any data of this device arrived; Duration::max() when none has.
  [[nodiscard]] Duration age(Time now = Clock::now()) const { return count_ == 0 ? Duration::max() : now - arrival_; }
  /// How many data messages have come: another number after read() means something new.
  [[nodiscard]] std::uint64_t count() const { return count_; }
  /// What came last of the data message of this subtype; empty when the interface has none such.
  [[nodiscard]] virtual std::optional<AnySample> latest_of(std::uint8_t subtype) const = 0;
  /// Of the data message of this subtype: how many have come.
  [[nodiscard]] virtual std::uint64_t count_of(std::uint8_t subtype) const = 0;

  // Properties of the driver by name. T: int, double, bool, std::string. The type must be the driver's own.
  template <typename T>
  [[nodiscard]] T property(std::string_view key);
  void set_property(std::string_view key, int value);
  void set_property(std::string_view key, double value);
  void set_property(std::string_view key, bool value);
  void set_property(std::string_view key, std::string_view value);
  void set_property(std::string_view key, const char* value) { set_property(key, std::string_view{value}); }

  /// Who drives, and why it stands: asks at first, and follows in read() from then on. Empty: a stock Player server,
  /// which does not tell.
  std::optional<player::Motion> motion(std::string_view group = "motion");
  /// The same without asking: what the server has told on this connection. Null: nothing yet.
  [[nodiscard]] const player::Motion* told_motion(std::string_view group = "motion") const;
  /// Drive from now on, taking over from an owner of at most this robot's priority. The group comes to rest first,
  /// unless `blend`. On a stock server everybody may drive, and this does nothing.
  void take(std::string_view group = "motion", bool blend = false);
  /// Leave it to others; the group comes to rest.
  void release(std::string_view group = "motion");

  /// The device has a destination that shall stay valid while this program calls read(), which says so to the server
  /// ten times a second. Position2dProxy does this by itself. Ends when the device stops. Nothing on a stock server.
  void keep_alive(bool on);

 protected:
  ProxyBase(Robot& robot, Address address) : robot_{robot}, address_{address} {}

  [[nodiscard]] Connection& connection() const;
  void send_any(const AnyCommand& command, std::string_view asked);
  [[noreturn]] void raise(std::string_view asked, const regista::Error& cause) const;
  [[nodiscard]] player::DeviceAddress wire_address() const;
  /// It drove and no longer does, since the last keep_alive(true). Why: `motion()`.
  [[nodiscard]] bool was_stopped() const { return was_stopped_; }

  template <RequestType M>
  typename M::Reply ask(Address to, const M& message) {
    Result<typename M::Reply> reply = connection().request(to, message);
    if (!reply) raise(M::message.name, reply.error());
    return *std::move(reply);
  }

 private:
  friend class Robot;

  virtual void take_data(const xdr::Header& header, const AnyData& data, Time arrival) = 0;
  void take_motion(const player::Motion& motion);
  void forget_motions();
  void on_data(const xdr::Header& header, const AnyData& data, Time arrival);
  Time keep_alive_at(Time now);

  Robot& robot_;
  Address address_;
  std::string driver_;
  std::uint64_t count_ = 0;
  Time arrival_{};
  std::map<std::string, player::Motion, std::less<>> motions_;  ///< by group
  std::optional<Time> keep_alive_at_;
  bool drove_ = false;
  bool was_stopped_ = false;
};

/// A device of any interface: `robot.device<Actarray>(0)`. Values change only inside Robot::read().
template <InterfaceType I>
class Proxy : public ProxyBase {
  template <typename List>
  struct SamplesOf;
  template <DataType... Ds>
  struct SamplesOf<TypeList<Ds...>> {
    using Type = std::tuple<Sample<Ds>...>;
  };
  using Samples = typename SamplesOf<typename detail::OfKind<Kind::data, typename I::Messages>::Type>::Type;

 public:
  Proxy(Robot& robot, std::uint16_t index) : ProxyBase{robot, {I::code, index}} {}

  /// The last data message of this type, such as `latest<actarray::State>()`.
  template <DataType D>
  [[nodiscard]] const Sample<D>& latest() const {
    return std::get<Sample<D>>(samples_);
  }

  [[nodiscard]] std::optional<AnySample> latest_of(std::uint8_t subtype) const override {
    std::optional<AnySample> found;
    for_subtype(subtype, [&](const auto& sample) {
      found = AnySample{sample.value, sample.count, sample.arrival, sample.stamp_s};
    });
    return found;
  }
  [[nodiscard]] std::uint64_t count_of(std::uint8_t subtype) const override {
    std::uint64_t count = 0;
    for_subtype(subtype, [&](const auto& sample) { count = sample.count; });
    return count;
  }

  template <CommandType C>
  void send(const C& command) {
    static_assert(C::message.interface == I::code);
    send_any(command, C::message.name);
  }

  template <RequestType M>
  typename M::Reply request(const M& message) {
    static_assert(M::message.interface == I::code || M::message.interface == any_interface);
    return ask(address(), message);
  }

 private:
  template <typename Visit>
  void for_subtype(std::uint8_t subtype, Visit visit) const {
    const auto look = [&]<DataType D>(const Sample<D>& sample) {
      if (D::message.subtype == subtype) visit(sample);
    };
    std::apply([&](const auto&... samples) { (look(samples), ...); }, samples_);
  }

  void take_data(const xdr::Header& header, const AnyData& data, Time arrival) override {
    std::apply([&](auto&... samples) { (void)(store(samples, header, data, arrival) || ...); }, samples_);
  }

  template <DataType D>
  static bool store(Sample<D>& sample, const xdr::Header& header, const AnyData& data, Time arrival) {
    const D* value = std::get_if<D>(&data);
    if (value == nullptr) return false;
    sample.value = *value;
    ++sample.count;
    sample.arrival = arrival;
    sample.stamp_s = header.timestamp_s;
    return true;
  }

  Samples samples_;
};

}  // namespace regista::client
