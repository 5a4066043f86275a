// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <regista/device/link.hpp>

namespace regista {

/// The type-less inside of a port: the host and the server see this, a driver sees Port<I>.
struct PortCore {
  using CommandHandler = std::function<Result<>(const AnyCommand&)>;
  using RequestHandler = std::function<void(const AnyRequest&, const ReplyTo&)>;

  std::uint16_t interface = 0;
  std::uint16_t index = 0;
  std::uint16_t tcp_port = 0;  ///< 0: the server's
  std::string key;
  std::string host;        ///< "robot7:6665": it stands for a device of that server; empty: it is here
  bool offered = false;    ///< named in `provides`
  std::size_t number = 0;  ///< among the driver's ports
  bool sensor = false;     ///< its commands are measurements, whatever the .cfg says

  std::array<CommandHandler, AnyCommand::size> commands;
  std::array<RequestHandler, AnyRequest::size> requests;

  /// The host's: which links want this port's data, and the lane of each data message in them.
  std::vector<Link*> listeners;
  std::array<std::size_t, AnyData::size> lanes{};
  std::function<void(Reply&&)> reply;
  std::function<void(std::uint8_t severity, const std::string& text)> tell;
  std::function<void(const std::string& reason)> stop;
  Time now;  ///< of the present call, for samples without a time of their own
  Measured last{};

  template <DataType D>
  void send(const D& data, Time measured) {
    constexpr std::size_t alternative = index_in<D>(AnyData::Messages{});
    if constexpr (std::same_as<D, position2d::State>) last.velocity = data.velocity;
    if constexpr (std::same_as<D, position1d::State>) last.velocity.x = data.velocity;
    if constexpr (std::same_as<D, actarray::State>) {
      last.speeds.clear();
      for (const actarray::Actuator& actuator : data.actuators) last.speeds.push_back(actuator.speed);
    }
    for (Link* link : listeners) {
      link->up.put(lanes[alternative], [&](Outbound& out) {
        Sample* sample = std::get_if<Sample>(&out);
        if (sample == nullptr) sample = &out.emplace<Sample>();
        sample->port = number;
        sample->measured = measured;
        link->spare_data.assign(sample->data, data);
      });
    }
  }
};

/// The right to answer one request, once. Dropped without an answer, it refuses. The driver's own thread only.
template <typename ReplyMessage>
class Responder {
 public:
  Responder(PortCore& port, const ReplyTo& to) : port_{&port}, to_{to} {}
  Responder(Responder&& other) noexcept : port_{std::exchange(other.port_, nullptr)}, to_{other.to_} {}
  Responder& operator=(Responder&& other) noexcept {
    std::swap(port_, other.port_);
    std::swap(to_, other.to_);
    return *this;
  }
  ~Responder() {
    if (port_ != nullptr) answer(Error{std::errc::operation_canceled, "the driver dropped the request"});
  }

  void answer(Result<ReplyMessage> result) {
    if (port_ == nullptr) return;
    PortCore& port = *std::exchange(port_, nullptr);
    if (result) {
      port.reply({.to = to_, .port = port.number, .answer = AnyReply{*std::move(result)}});
    } else {
      port.reply({.to = to_, .port = port.number, .answer = result.error()});
    }
  }

 private:
  PortCore* port_;
  ReplyTo to_;
};

namespace detail {
template <typename M, typename List>
inline constexpr bool contains = false;
template <typename M, typename... Ms>
inline constexpr bool contains<M, TypeList<Ms...>> = (std::same_as<M, Ms> || ...);
}  // namespace detail

/// One device of a driver: what it is told arrives at the handlers, what it has to say is sent. A driver has a port for
/// each device it offers; two batteries are two ports. The driver's own thread only.
template <InterfaceType I>
class Port {
 public:
  explicit Port(PortCore& core) : core_{&core} {}

  /// Call `handle(const M&)` for each command M, when it is owned, within limits and fresh: the host has seen to that.
  /// `handle` returns nothing or a Result<>; a failure is counted and told to whoever asked.
  template <CommandType M, typename Handle>
  void on(Handle handle) {
    static_assert(detail::contains<M, typename I::Messages>, "a command of another interface");
    core_->commands[index_in<M>(AnyCommand::Messages{})] =
        [handle = std::move(handle)](const AnyCommand& command) mutable -> Result<> {
      if constexpr (std::is_void_v<std::invoke_result_t<Handle&, const M&>>) {
        handle(*std::get_if<M>(&command));
        return {};
      } else {
        return handle(*std::get_if<M>(&command));
      }
    };
  }

  /// Answer each request M: by what `handle(const M&)` returns, a Result<M::Reply>; or later, by the responder that
  /// `handle(const M&, Responder<M::Reply>)` is given. A request without a handler is refused by the host.
  template <RequestType M, typename Handle>
  void on(Handle handle) {
    static_assert(detail::contains<M, typename I::Messages>, "a request of another interface");
    core_->requests[index_in<M>(AnyRequest::Messages{})] = [core = core_, handle = std::move(handle)](
                                                               const AnyRequest& request, const ReplyTo& to) mutable {
      Responder<typename M::Reply> responder{*core, to};
      if constexpr (std::is_invocable_v<Handle&, const M&>) {
        responder.answer(handle(*std::get_if<M>(&request)));
      } else {
        handle(*std::get_if<M>(&request), std::move(responder));
      }
    };
  }

  /// Publish to every subscriber. `measured`: when the data were true, unless that is now.
  template <DataType D>
  void send(const D& data) {
    send(data, core_->now);
  }
  template <DataType D>
  void send(const D& data, Time measured) {
    static_assert(detail::contains<D, typename I::Messages>, "data of another interface");
    core_->send(data, measured);
  }

  /// Of the present call, for handlers: when the command came, within the time that it takes to wake a thread.
  [[nodiscard]] Time now() const { return core_->now; }

  /// An event for the clients and the log: 0 to know, 1 to beware of, 2 a failure. Seldom: every one is delivered.
  void tell(std::uint8_t severity, const std::string& text) { core_->tell(severity, text); }
  /// Bring the device to rest by the rules of motion, as if somebody had asked for it; `reason` follows "stopped: ".
  void stop(const std::string& reason) { core_->stop(reason); }
  /// Commands to this device are measurements: no lease, owner, limits, or stop made up for them. In the constructor.
  void takes_measurements() { core_->sensor = true; }

  /// Whether the `.cfg` offers this device; sending to nobody is harmless.
  [[nodiscard]] bool offered() const { return core_->offered; }

 private:
  PortCore* core_;
};

}  // namespace regista
