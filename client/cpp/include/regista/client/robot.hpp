// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/client/proxies.hpp>

namespace regista::client {

/// A connection to a server, ours or a stock Player, and its devices:
///
///     regista::client::Robot robot{"localhost"};
///     auto& base = robot.position2d();
///     while (base.state().pose.x < 1.0) {
///       base.set_velocity({.x = 0.3});  // repeated: silence stops the robot
///       robot.read(100ms);              // values change here, and only here
///     }
///     base.stop();
///
/// No background thread: the caller owns the loop. One thread at a time. Everything that talks to the server throws
/// client::Error: ConnectionError, TimeoutError, RefusedError.
class Robot {
 public:
  explicit Robot(std::string host = "localhost", std::uint16_t port = 6665, Options options = {});

  /// Take in the data that came, waiting up to `timeout` for the first; 0 only looks. False: none came in time.
  /// Throws when the connection broke or the server is silent for good; with `Options::reconnect` it connects again
  /// instead, and commands throw ConnectionError until `connected()`.
  bool read(Duration timeout);

  // Devices; the first use subscribes. References stay valid as long as the robot.
  Position2dProxy& position2d(std::uint16_t index = 0) { return device<Position2d>(index); }
  PowerProxy& power(std::uint16_t index = 0) { return device<Power>(index); }
  KickerProxy& kicker(std::uint16_t index = 0) { return device<Kicker>(index); }
  ImuProxy& imu(std::uint16_t index = 0) { return device<Imu>(index); }
  GpsProxy& gps(std::uint16_t index = 0) { return device<Gps>(index); }
  DioProxy& dio(std::uint16_t index = 0) { return device<Dio>(index); }
  OpaqueProxy& opaque(std::uint16_t index = 0) { return device<Opaque>(index); }
  /// Any other: `robot.device<Actarray>(0)`.
  template <InterfaceType I>
  typename ProxyFor<I>::Type& device(std::uint16_t index = 0) {
    using P = typename ProxyFor<I>::Type;
    if (ProxyBase* known = find({I::code, index})) return static_cast<P&>(*known);
    return static_cast<P&>(open(std::make_unique<P>(*this, index)));
  }

  /// One whose interface is known only at run time. Throws std::invalid_argument when we do not speak it.
  ProxyBase& device(Address address);

  /// The same without waiting: when `on_open` is called, from within a later read(), device() gives it at once.
  void open(Address address, Connection::OnOpen on_open);

  /// Be told of each data message of the devices in use, in the order of arrival, from within read(): for recorders.
  /// What comes while a request waits is told at the next read(), of each device and type the newest. The handler must
  /// not call the robot. An empty one ends it.
  void listen(Connection::OnData on_data) { on_data_ = std::move(on_data); }

  struct Device {
    Address address;
    std::string driver;
  };
  /// All devices of the server.
  [[nodiscard]] std::vector<Device> devices();

  /// Bring every device to rest, whoever drives it. On a stock server: the position2d devices in use.
  void stop();

  /// Connect again and subscribe what was subscribed. Moves nothing: ownership and destinations are to be taken and
  /// given anew.
  void reconnect();
  [[nodiscard]] bool connected() const { return connection_.connected(); }

  /// What happened since the last call: refused commands, stops, faults. The newest 256. A stock server tells none.
  [[nodiscard]] std::vector<player::Event> events();
  /// Clients, queues, ages, beats, owners, as JSON. Not from a stock server.
  [[nodiscard]] std::string status();

  /// For poll, select, asyncio: call read(0ms) when it is readable.
  [[nodiscard]] int fileno() const { return connection_.fileno(); }
  /// When read() is due although nothing came: a keep-alive, a time-out.
  [[nodiscard]] Time wake_time() const;

  /// The layer below, for what is not here.
  [[nodiscard]] Connection& connection() { return connection_; }
  [[nodiscard]] const Connection& connection() const { return connection_; }

 private:
  friend class ProxyBase;

  ProxyBase* find(Address address);
  ProxyBase& open(std::unique_ptr<ProxyBase> proxy);
  std::unique_ptr<ProxyBase> make_proxy(Address address);
  Connection::OnData handler(ProxyBase& proxy);
  void note_generation();
  void take_notice(const AnyData& data);
  [[noreturn]] void raise(std::string_view device, std::string_view asked, const regista::Error& cause) const;

  std::vector<std::shared_ptr<ProxyBase>> proxies_;
  std::deque<player::Event> events_;
  Connection::OnData on_data_;
  std::uint64_t generation_ = 0;
  Connection connection_;  // the last: its handlers use all of the above
};

}  // namespace regista::client
