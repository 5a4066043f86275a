// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <regista/device/config_file.hpp>
#include <regista/device/host.hpp>
#include <string>
#include <vector>

namespace regista::testing {

/// The drivers of a .cfg in their hosts, joined as a server joins them, on the caller's thread and in a time that it
/// makes up: an hour takes what computing it takes, and twice the same. For skills, which stand on other drivers.
/// A client is there from the start: it has all devices open, and is whoever commands and asks.
class Rig {
 public:
  using Create = std::function<std::unique_ptr<Driver>(Setup&)>;
  static constexpr SessionId client = 1;

  /// `drivers`: how to make those that the .cfg names. Throws ConfigError; devices of other servers are none here.
  Rig(const std::string& config, const std::map<std::string, Create>& drivers);

  void run(Duration duration);
  [[nodiscard]] Time now() const { return now_; }

  template <CommandType M>
  void send(const M& command, std::uint16_t index = 0, SessionId session = client) {
    put(find(M::message.interface, index), AnyCommand{command}, session);
    run({});
  }
  template <RequestType M>
  Result<typename M::Reply> ask(const M& request, std::uint16_t index = 0, SessionId session = client) {
    return ask(M::message.interface, request, index, session);
  }
  /// A request that any interface takes: a property, a stop.
  template <RequestType M>
  Result<typename M::Reply> ask(std::uint16_t interface, const M& request, std::uint16_t index,
                                SessionId session = client) {
    const Result<AnyReply> reply = put_request(find(interface, index), AnyRequest{request}, session);
    if (!reply) return reply.error();
    return std::get<typename M::Reply>(*reply);
  }
  /// Of a text property.
  [[nodiscard]] std::string text(std::uint16_t interface, std::uint16_t index, std::string_view key);

  /// What came last; null: nothing since forget().
  template <DataType D>
  [[nodiscard]] const D* latest(std::uint16_t index = 0) const {
    const auto found = data_.find({D::message.interface, index, D::message.subtype});
    return found == data_.end() ? nullptr : std::get_if<D>(&found->second);
  }
  void forget() { data_.clear(); }
  /// What was told to the clients since the last call, a line each.
  std::string events() { return std::exchange(events_, {}); }

  /// A client opens all devices, or is gone.
  void arrive(SessionId session, const Identity& who = {"another", 10, false});
  void leave(SessionId session);

 private:
  struct Hosted {
    std::unique_ptr<DriverHost> host;
    Link* link = nullptr;             ///< of the clients
    std::vector<const Link*> users;   ///< drivers that stand on it
    std::vector<const Link*> stands;  ///< on these
    Time due{};
    [[nodiscard]] bool is_spoken_to() const;
  };
  struct Device {
    Hosted* hosted = nullptr;
    std::size_t port = 0;
  };

  Device find(std::uint16_t interface, std::uint16_t index);
  void put(const Device& device, const AnyCommand& command, SessionId session);
  Result<AnyReply> put_request(const Device& device, AnyRequest request, SessionId session);
  void cycle();
  void take(Hosted& hosted);

  Wakeup woken_;
  std::deque<Hosted> hosts_;
  std::map<std::pair<std::uint16_t, std::uint16_t>, Device> devices_;
  Time now_ = Time{std::chrono::seconds{1000}};
  std::map<std::tuple<std::uint16_t, std::uint16_t, std::uint8_t>, AnyData> data_;
  std::optional<Result<AnyReply>> reply_;
  std::string events_;
};

}  // namespace regista::testing
