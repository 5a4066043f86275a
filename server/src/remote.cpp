// SPDX-License-Identifier: Apache-2.0
#include "remote.hpp"

#include <regista/device/setup.hpp>

namespace regista {

namespace {

using namespace std::chrono_literals;

// Below the longest shut-down of the server, so that a peer that froze does not make it overrun.
constexpr Duration timeout = 1500ms;
// Half of the shortest lease.
constexpr Duration keep_alive_interval = 50ms;
constexpr std::size_t most_questions = 64;

player::DeviceAddress on_wire(client::Address address) {
  return {.interface = address.interface, .index = address.index};
}

Result<AnyReply> decode_reply(const AnyRequest& request, std::span<const std::byte> body) {
  return std::visit(
      [&]<typename M>(const M&) -> Result<AnyReply> {
        typename M::Reply reply;
        if (const Result<> decoded = xdr::decode(body, reply); !decoded) return decoded.error();
        return AnyReply{std::move(reply)};
      },
      request);
}

}  // namespace

Remote::Remote(Setup& setup, const std::string& host, std::uint16_t port, std::span<const client::Address> devices,
               const std::string& name, std::int32_t priority)
    : connection_{host, port, {.timeout = timeout, .name = name, .priority = priority}},
      name_{host + ':' + std::to_string(port)} {
  for (const client::Address address : devices) add(setup, address);
}

void Remote::add(Setup& setup, client::Address address) {
  PortCore& port = setup.ports.emplace_back();
  port.number = setup.ports.size() - 1;
  port.host = name_;
  port.interface = address.interface;
  port.index = address.index;
  Device& device = devices_.emplace_back(Device{.port = &port, .address = address});
  for_each_message(AnyCommand::Messages{}, [&]<typename M>(std::size_t alternative) {
    if (M::message.interface != address.interface) return;
    port.commands[alternative] = [this, &device](const AnyCommand& command) { return send(device, command); };
  });
  for_each_message(AnyRequest::Messages{}, [&]<typename M>(std::size_t alternative) {
    if (M::message.interface != address.interface) return;
    port.requests[alternative] = [this, &device](const AnyRequest& request, const ReplyTo& to) {
      ask({.port = device.port, .to = device.address, .request = request, .reply_to = to});
    };
  });
  (void)connection_.subscribe(address, [&port](const xdr::Header&, const AnyData& data, Time arrival) {
    std::visit([&](const auto& d) { port.send(d, arrival); }, data);
  });
}

Result<> Remote::open() {
  if (Result<> connected = connection_.connect(); !connected) return connected;
  descriptor_ = connection_.fileno();
  return {};
}

Result<> Remote::read(const Tick& tick) {
  if (const Result<std::size_t> taken = connection_.read(Duration{}); !taken) return taken.error();
  // The local host sees to it that the requiring driver is alive: it stops what that one does not keep up.
  if (connection_.extended() && tick.now - kept_alive_ >= keep_alive_interval) {
    kept_alive_ = tick.now;
    for (const Device& device : devices_) {
      if (!device.commanded) continue;
      (void)connection_.send(client::server_address, player::KeepAlive{on_wire(device.address)});
    }
  }
  ask_next();
  return {};
}

void Remote::halt() noexcept {
  for (Device& device : devices_) {
    if (!std::exchange(device.commanded, false) || !connection_.connected()) continue;
    if (connection_.extended()) {
      ask({.port = device.port, .to = client::server_address, .request = player::Stop{on_wire(device.address)}});
    } else {
      connection_.close();  // a stock server has no stop for every device, but lets go of what nobody has open
    }
  }
}

void Remote::close() noexcept {
  connection_.close();
  descriptor_ = -1;
  for (const Question& question : std::exchange(questions_, {})) {
    question.port->reply({.to = question.reply_to,
                          .port = question.port->number,
                          .answer = Error{std::errc::not_connected, "the connection to " + name_ + " was closed"}});
  }
}

Result<> Remote::send(Device& device, const AnyCommand& command) {
  device.commanded = true;
  return connection_.send(device.address, command);
}

void Remote::ask(Question question) {
  if (questions_.size() >= most_questions) {
    question.port->reply({.to = question.reply_to,
                          .port = question.port->number,
                          .answer = Error{std::errc::device_or_resource_busy,
                                          std::to_string(most_questions) + " requests wait for " + name_}});
    return;
  }
  questions_.push_back(std::move(question));
  ask_next();
}

void Remote::ask_next() {
  while (!questions_.empty() && !connection_.request_pending()) {
    const Question question = std::move(questions_.front());
    questions_.pop_front();
    const auto answer = [this, port = question.port, to = question.reply_to](Result<AnyReply> reply) {
      // A refusal has the other server's words; what went wrong between the servers needs all that is known.
      if (!reply && reply.error().code.category() != client::refusal_category()) {
        reply = Error{reply.error().code, name_ + ": " + reply.error().message()};
      }
      port->reply({.to = to, .port = port->number, .answer = std::move(reply)});
    };
    const Result<> posted =
        connection_.post(question.to, question.request,
                         [answer, request = question.request](const Result<std::span<const std::byte>>& body) {
                           answer(body ? decode_reply(request, *body) : Result<AnyReply>{body.error()});
                         });
    if (!posted) answer(posted.error());
  }
}

}  // namespace regista
