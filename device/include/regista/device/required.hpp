// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <regista/device/port.hpp>

namespace regista {

/// The type-less inside of a required device.
struct RequiredCore {
  std::string key;
  std::uint16_t interface = 0;
  std::uint16_t index = 0;
  std::size_t number = 0;  ///< among this driver's required devices

  // Set by join().
  Link* link = nullptr;   ///< to the provider's host
  std::size_t port = 0;   ///< which of the provider's ports
  SessionId session = 0;  ///< under which this driver commands
  const Wakeup* provider = nullptr;
  std::array<std::size_t, AnyCommand::size> lanes{};

  // The consumer's host's.
  Time now;                        ///< of its cycle: when what is sent is sent
  Time due;                        ///< of the next attempt to subscribe, or of the next keep-alive
  std::uint32_t subscription = 0;  ///< number of the last attempt; 0: closed
  bool connected = false;
  bool commanded = false;  ///< something was sent since the subscription: it takes keep-alives

  std::array<std::function<void(const AnyData&, Time)>, AnyData::size> data;
  std::map<std::uint32_t, std::function<void(const Result<AnyReply>&)>> waiting;  ///< requests by number
  std::uint32_t requests_sent = 0;

  Spares<AnyCommand> spare_commands;  ///< of `link->down`

  /// False: the queue is full.
  template <typename Message>
  bool post(Message&& message, const ReplyTo& to = {}) {
    return put(Mailbox<Inbound, 256>::no_lane, to, [&](auto& place) { place = std::forward<Message>(message); });
  }
  template <CommandType M>
  bool command(const M& command, const ReplyTo& to = {}) {
    return put(lanes[index_in<M>(AnyCommand::Messages{})], to, [&](auto& place) {
      AnyCommand* any = std::get_if<AnyCommand>(&place);
      if (any == nullptr) any = &place.template emplace<AnyCommand>();
      spare_commands.assign(*any, command);
    });
  }

 private:
  template <typename Fill>
  bool put(std::size_t lane, const ReplyTo& to, Fill&& fill) {
    if (link == nullptr) return false;
    const bool posted = link->down.put(lane, [&](Inbound& inbound) {
      inbound.session = session;
      inbound.port = port;
      inbound.arrived = now;
      inbound.reply_to = to;
      fill(inbound.message);
    });
    if (posted) provider->notify();
    return posted;
  }
};

/// A device of another driver that this one stands on; in this server or in another one, it looks the same. Its data
/// arrive at the handlers, on this driver's own thread. The driver's own thread only.
template <InterfaceType I>
class Required {
 public:
  explicit Required(RequiredCore& core) : core_{&core} {}

  /// Call `handle(const D&, Time measured)` with each data message D that arrives.
  template <DataType D, typename Handle>
  void on_data(Handle handle) {
    static_assert(detail::contains<D, typename I::Messages>, "data of another interface");
    core_->data[index_in<D>(AnyData::Messages{})] = [handle = std::move(handle)](const AnyData& data,
                                                                                 Time measured) mutable {
      handle(*std::get_if<D>(&data), measured);
    };
  }

  /// Command the device, under this driver's name and priority. False: its queue is full.
  template <CommandType M>
  bool send(const M& command) {
    static_assert(detail::contains<M, typename I::Messages>, "a command of another interface");
    core_->commanded = true;
    return core_->command(command);
  }

  /// The same, and `handle(const Result<>&)` is told whether its driver took it, once. Not when this returns false. For
  /// edges: a set-point that is refused comes again. A device of another server counts as having taken what was sent.
  template <CommandType M, typename Handle>
  bool send(const M& command, Handle handle) {
    static_assert(detail::contains<M, typename I::Messages>, "a command of another interface");
    static_assert(M::message.flow == Flow::edge, "only edges are answered");
    core_->commanded = true;
    const std::uint32_t number = ++core_->requests_sent;
    if (!core_->command(command, {.session = core_->session, .sequence = number})) return false;
    core_->waiting.emplace(number, [handle = std::move(handle)](const Result<AnyReply>& answer) mutable {
      handle(answer ? Result<>{} : Result<>{answer.error()});
    });
    return true;
  }

  /// Ask the device; `handle(const Result<M::Reply>&)` has the answer, once. Not when this returns false: queue full.
  template <RequestType M, typename Handle>
  bool request(const M& request, Handle handle) {
    static_assert(detail::contains<M, typename I::Messages>, "a request of another interface");
    const std::uint32_t number = ++core_->requests_sent;
    const ReplyTo to{.session = core_->session,
                     .address = {.interface = core_->interface, .index = core_->index},
                     .subtype = M::message.subtype,
                     .sequence = number};
    if (!core_->post(AnyRequest{request}, to)) return false;
    core_->waiting.emplace(number, [handle = std::move(handle)](const Result<AnyReply>& answer) mutable {
      if (!answer) {
        handle(Result<typename M::Reply>{answer.error()});
      } else {
        handle(Result<typename M::Reply>{std::get<typename M::Reply>(*answer)});
      }
    });
    return true;
  }

  /// Ask for a stop, as any client may: whoever drives it loses it. False: its queue is full.
  bool stop() { return core_->post(AnyRequest{player::Stop{{.interface = core_->interface, .index = core_->index}}}); }

  /// The device accepted the subscription that the host made before open(). It may fail later and come back: what
  /// tells is the age of its data.
  [[nodiscard]] bool connected() const { return core_->connected; }

 private:
  RequiredCore* core_;
};

}  // namespace regista
