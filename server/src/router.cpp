// SPDX-License-Identifier: Apache-2.0
// Messages between clients and drivers.
#include <algorithm>
#include <asio/post.hpp>
#include <nlohmann/json.hpp>

#include "impl.hpp"

namespace regista {

namespace {

// The server's address as stock Player writes it: 127.0.0.1, bytes reversed.
constexpr std::uint32_t player_host = 0x0100007f;
constexpr std::size_t no_lane = Mailbox<Inbound, 256>::no_lane;

bool is_server_request(const AnyRequest& request) {
  return std::visit([]<typename M>(const M&) { return M::message.interface == player::code; }, request);
}

}  // namespace

std::optional<Server::Impl::Target> Server::Impl::find(const Session& session,
                                                       const player::DeviceAddress& address) const {
  const auto found = devices_.find({session.local_port(), address.interface, address.index});
  return found == devices_.end() ? std::nullopt : std::optional{found->second};
}

xdr::Header Server::Impl::reply_header(const Session& session, const xdr::Header& request, Kind kind) const {
  xdr::Header header{
      .address = request.address, .kind = kind, .subtype = request.subtype, .timestamp_s = epoch_s(Clock::now())};
  header.address.host = player_host;
  header.address.robot = session.local_port();
  // The stock server copies it back in its own replies, and its drivers answer 0; ours tells old answers from new.
  if (request.address.interface == player::code || session.extended) header.sequence = request.sequence;
  return header;
}

template <typename Body>
void Server::Impl::send(Session& session, const xdr::Header& header, const Body& body) {
  encoded_.resize(xdr::header_size + xdr::encoded_size(body));
  xdr::encode_message(header, body, encoded_);
  session.send(encoded_);
}

template <typename Body>
void Server::Impl::acknowledge(Session& session, const xdr::Header& request, const Body& body) {
  send(session, reply_header(session, request, Kind::ack), body);
}

void Server::Impl::refuse(Session& session, const xdr::Header& request, const Error& error) {
  const xdr::Header header = reply_header(session, request, Kind::nack);
  if (session.extended) {
    const std::error_condition condition = error.code.default_error_condition();
    const int number = condition.category() == std::generic_category() ? condition.value() : EPROTO;
    std::string text = error.what.empty() ? error.message() : error.what;
    text.resize(std::min<std::size_t>(text.size(), 1000));
    send(session, header, player::Reason{.error = number, .text = text});
  } else if (request.address.interface == player::code && request.subtype == player::Subscribe::message.subtype) {
    send(session, header, player::Subscribe{.access = player::Access::error});
  } else {
    send(session, header, Empty{});
  }
}

void Server::Impl::on_message(Session& session, const xdr::Frame& frame) {
  switch (frame.header.kind) {
    case Kind::command:
      return on_command(session, frame);
    case Kind::request:
      return on_request(session, frame);
    default:
      ++session.messages_refused;  // clients have no data, and answer nothing
  }
}

void Server::Impl::on_command(Session& session, const xdr::Frame& frame) {
  const Result<> decoded = xdr::decode_any(frame.header, frame.body, command_);
  const auto* keep_alive = std::get_if<player::KeepAlive>(&command_);
  const std::optional<Target> target =
      decoded ? find(session, keep_alive != nullptr ? keep_alive->address : frame.header.address) : std::nullopt;
  if (!target || !session.opened.contains({target->driver, target->port})) {
    // Commands are never refused by a message: stock clients take an answer that they did not ask for as fatal.
    ++session.messages_refused;
    if (target) ++drivers_[target->driver].ports[target->port].commands_dropped;
    return;
  }
  Hosted& hosted = drivers_[target->driver];
  const Time now = Clock::now();
  const std::size_t lane = keep_alive != nullptr ? no_lane : hosted.host->lane(*hosted.link, target->port, command_);
  const bool posted = hosted.link->down.put(lane, [&](Inbound& inbound) {
    inbound.session = session.id();
    inbound.port = target->port;
    inbound.arrived = now;
    inbound.reply_to = {};
    inbound.message = command_;
  });
  if (posted) {
    hosted.host->wakeup().notify();
  } else {
    ++hosted.ports[target->port].commands_dropped;
  }
}

void Server::Impl::on_request(Session& session, const xdr::Frame& frame) {
  AnyRequest request;
  if (const Result<> decoded = xdr::decode_any(frame.header, frame.body, request); !decoded) {
    ++session.messages_refused;
    return refuse(session, frame.header, decoded.error());
  }
  if (is_server_request(request) || frame.header.address.interface == player::code) {
    return ask_server(session, frame.header, request);
  }
  const std::optional<Target> target = find(session, frame.header.address);
  if (!target) {
    return refuse(session, frame.header,
                  {std::errc::no_such_device, std::string{interface_name(frame.header.address.interface)} + ':' +
                                                  std::to_string(frame.header.address.index) + " does not exist here"});
  }
  if (!answer_for_host(session, frame.header, *target, request)) {
    ask_driver(session, frame.header, *target, std::move(request));
  }
}

/// Who drives a device and why it stands, as text properties: also for stock clients.
bool Server::Impl::answer_for_host(Session& session, const xdr::Header& header, const Target& target,
                                   const AnyRequest& request) {
  const auto* get = std::get_if<property::GetText>(&request);
  if (get == nullptr || !get->key.view().starts_with("motion.")) return false;
  const auto& motions = drivers_[target.driver].ports[target.port].motion;
  const auto motion = motions.find(std::string_view{"motion"});
  if (motion == motions.end()) return false;
  property::GetText reply{.key = get->key, .value = {}};
  constexpr std::array<std::string_view, 4> states{"stopped", "driving", "stopping", "fault"};
  const std::string_view what = get->key.view().substr(7);
  if (what == "owner") {
    reply.value = motion->second.owner;
  } else if (what == "state") {
    reply.value = states[static_cast<std::size_t>(motion->second.state)];
  } else if (what == "reason") {
    reply.value = motion->second.reason;
  } else {
    return false;
  }
  acknowledge(session, header, reply);
  return true;
}

void Server::Impl::ask_driver(Session& session, const xdr::Header& header, const Target& target, AnyRequest&& request) {
  Hosted& hosted = drivers_[target.driver];
  if (hosted.hung_since) {
    return refuse(session, header, {std::errc::timed_out, "driver \"" + hosted.name + "\" does not return"});
  }
  const bool posted = hosted.link->down.put(no_lane, [&](Inbound& inbound) {
    inbound.session = session.id();
    inbound.port = target.port;
    inbound.arrived = Clock::now();
    inbound.reply_to = {
        .session = session.id(), .address = header.address, .subtype = header.subtype, .sequence = header.sequence};
    inbound.message = std::move(request);
  });
  if (!posted) {
    return refuse(session, header,
                  {std::errc::device_or_resource_busy, "driver \"" + hosted.name + "\" is busy: its queue is full"});
  }
  ++session.requests_waiting;
  hosted.host->wakeup().notify();
}

void Server::Impl::subscribe(Session& session, const xdr::Header& header, const player::Subscribe& request) {
  const std::optional<Target> target = find(session, request.address);
  if (!target) {
    const std::string_view name = interface_name(request.address.interface);
    return refuse(session, header,
                  {std::errc::no_such_device,
                   (name.empty() ? "interface " + std::to_string(request.address.interface) : std::string{name}) + ':' +
                       std::to_string(request.address.index) + " does not exist here"});
  }
  introduce(session, drivers_[target->driver]);
  ask_driver(session, header, *target, AnyRequest{request});
}

void Server::Impl::ask_server(Session& session, const xdr::Header& header, AnyRequest& request) {
  const auto forward = [&](const player::DeviceAddress& address) {
    const std::optional<Target> target = find(session, address);
    if (!target) return refuse(session, header, {std::errc::no_such_device, "no such device here"});
    ask_driver(session, header, *target, std::move(request));
  };
  const auto name_of = [&](const player::DeviceAddress& address) -> const std::string* {
    const std::optional<Target> target = find(session, address);
    return target ? &drivers_[target->driver].name : nullptr;
  };
  if (const auto* subscription = std::get_if<player::Subscribe>(&request))
    return subscribe(session, header, *subscription);
  if (std::holds_alternative<player::GetData>(request)) {
    acknowledge(session, header, Empty{});
    return session.send_data();
  }
  if (const auto* mode = std::get_if<player::SetDataMode>(&request)) {
    // An unknown mode is acknowledged and changes nothing, as in Player.
    if (mode->mode == player::DataMode::push || mode->mode == player::DataMode::pull) session.set_mode(mode->mode);
    return acknowledge(session, header, Empty{});
  }
  if (std::holds_alternative<player::GetDeviceList>(request)) {
    player::DeviceList list;
    for (const Hosted& hosted : drivers_) {  // in the order of the .cfg
      for (const PortNotes& notes : hosted.ports) {
        if (notes.device.tcp_port != session.local_port()) continue;
        list.devices.push_back({player_host, notes.device.tcp_port, notes.device.interface, notes.device.index});
      }
    }
    return acknowledge(session, header, list);
  }
  if (auto* info = std::get_if<player::GetDriverInfo>(&request)) {
    const std::string* name = name_of(info->address);
    if (name == nullptr) return refuse(session, header, {std::errc::no_such_device, "no such device here"});
    info->address.host = player_host;
    info->address.robot = session.local_port();
    info->driver = *name;
    return acknowledge(session, header, *info);
  }
  if (const auto* rule = std::get_if<player::AddReplaceRule>(&request)) {
    session.add_rule(*rule);
    return acknowledge(session, header, Empty{});
  }
  if (std::holds_alternative<player::Extend>(request)) {
    session.extended = true;
    acknowledge(session, header, player::Extension{.version = 1, .server = "regista " REGISTA_VERSION});
    for (const Hosted& hosted : drivers_) {
      for (const PortNotes& notes : hosted.ports) {
        for (const auto& [group, motion] : notes.motion) tell(session, motion);
      }
    }
    return;
  }
  if (const auto* who = std::get_if<player::Identify>(&request)) {
    session.name = who->name.view();
    session.priority = who->priority;
    std::set<std::size_t> told;
    for (const auto& [driver, port] : session.opened) told.insert(driver);
    for (const std::size_t driver : told) introduce(session, drivers_[driver]);
    return acknowledge(session, header, Empty{});
  }
  if (const auto* stop = std::get_if<player::Stop>(&request)) {
    if (stop->address.interface != 0) return forward(stop->address);
    session.known_to_all = true;
    for (Hosted& hosted : drivers_) {
      introduce(session, hosted);
      for (std::size_t port = 0; port < hosted.ports.size(); ++port) {
        must_deliver(hosted,
                     {.session = session.id(), .port = port, .arrived = Clock::now(), .message = AnyRequest{*stop}});
      }
    }
    return acknowledge(session, header, Empty{});
  }
  if (const auto* take = std::get_if<player::Take>(&request)) return forward(take->address);
  if (const auto* release = std::get_if<player::Release>(&request)) return forward(release->address);
  if (const auto* motion = std::get_if<player::GetMotion>(&request)) return forward(motion->address);
  if (std::holds_alternative<player::GetStatus>(request)) {
    return acknowledge(session, header, player::Status{status(Clock::now()).dump()});
  }
  if (const auto* set = std::get_if<property::SetInt>(&request); set != nullptr && set->key.view() == "coalesce_ms") {
    constexpr std::int32_t longest_ms = 1000;
    if (set->value < 0 || set->value > longest_ms) {
      return refuse(session, header, {std::errc::result_out_of_range, "coalesce_ms must be within [0, 1000]"});
    }
    session.set_coalescing(std::chrono::milliseconds{set->value});
    return acknowledge(session, header, Empty{});
  }
  refuse(session, header, {std::errc::not_supported, "the server does not answer this request"});
}

void Server::Impl::on_end_of_input(Session& session) {
  std::set<std::size_t> hosts;
  for (const auto& [driver, port] : session.opened) {
    std::erase(drivers_[driver].ports[port].subscribers, &session);
    hosts.insert(driver);
  }
  session.opened.clear();
  // Also to drivers that it asked without success, or stopped: they know its name.
  for (std::size_t i = 0; i < drivers_.size(); ++i) {
    if (hosts.contains(i) || session.requests_waiting > 0 || session.known_to_all) {
      must_deliver(drivers_[i], {.session = session.id(), .arrived = Clock::now(), .message = Gone{}});
    }
  }
}

void Server::Impl::on_closed(Session& session, const std::string& reason) {
  if (!reason.empty()) event(1, "client " + std::to_string(session.id()) + " closed: " + reason);
  data_dropped_ += session.data_dropped;
  asio::post(io_, [this, id = session.id()] { sessions_.erase(id); });
}

void Server::Impl::introduce(const Session& session, Hosted& hosted) {
  must_deliver(hosted, {.session = session.id(),
                        .arrived = Clock::now(),
                        .message = Identity{session.name, session.priority, session.extended}});
}

void Server::Impl::must_deliver(Hosted& hosted, Inbound&& inbound) {
  hosted.undelivered.push_back(std::move(inbound));
  deliver_undelivered(hosted);
}

void Server::Impl::deliver_undelivered(Hosted& hosted) {
  bool any = false;
  while (!hosted.undelivered.empty()) {
    Inbound& oldest = hosted.undelivered.front();
    if (!hosted.link->down.put(no_lane, [&](Inbound& inbound) { inbound = std::move(oldest); })) break;
    hosted.undelivered.pop_front();
    any = true;
  }
  if (any) hosted.host->wakeup().notify();
}

void Server::Impl::wait_for_drivers() {
  wakeup_descriptor_.async_wait(asio::posix::stream_descriptor::wait_read, [this](const asio::error_code& error) {
    if (error) return;
    wakeup_.clear();
    bool more = false;
    for (Hosted& hosted : drivers_) more |= drain(hosted);
    if (more) wakeup_.notify();  // after whatever else is ready
    finish_shutdown_if_done();
    if (!all_stopped_) wait_for_drivers();
  });
}

bool Server::Impl::drain(Hosted& hosted) {
  // A flood for many subscribers must not keep the others waiting: 100 messages take about half a millisecond.
  constexpr std::size_t most_at_once = 100;
  bool more = true;
  for (std::size_t sent = 0; more && sent < most_at_once;) {
    more = hosted.link->up.drain_some(1, [&](Outbound& item) {
      if (Sample* sample = std::get_if<Sample>(&item)) {
        sent += 1 + hosted.ports[sample->port].subscribers.size();
        on_sample(hosted, *sample);
      } else if (Reply* reply = std::get_if<Reply>(&item)) {
        ++sent;
        on_reply(hosted, *reply);
      } else {
        sent += sessions_.size();
        on_notice(hosted, *std::get_if<Notice>(&item));
      }
    });
  }
  deliver_undelivered(hosted);
  return more;
}

void Server::Impl::on_sample(Hosted& hosted, const Sample& sample) {
  PortNotes& port = hosted.ports[sample.port];
  if (port.subscribers.empty()) return;
  // libplayerc++ takes data as fresh only when their stamp increases; the wall clock is asked once, at start.
  constexpr double least_step_s = 1e-6;
  port.last_stamp_s = std::max(epoch_s(sample.measured), port.last_stamp_s + least_step_s);
  const Time now = Clock::now();
  std::visit(
      [&]<typename D>(const D& data) {
        const xdr::Header header{
            .address = {player_host, port.device.tcp_port, port.device.interface, port.device.index},
            .kind = Kind::data,
            .subtype = D::message.subtype,
            .timestamp_s = port.last_stamp_s};
        encoded_data_.resize(xdr::header_size + xdr::encoded_size(data));
        xdr::encode_message(header, data, encoded_data_);
        DataMessage message{encoded_data_, header.address, header.subtype};
        // A subscriber that fails while it is served leaves the list.
        for (std::size_t i = 0; i < port.subscribers.size();) {
          Session* subscriber = port.subscribers[i];
          subscriber->deliver(message, now);
          if (i < port.subscribers.size() && port.subscribers[i] == subscriber) ++i;
        }
      },
      sample.data);
}

void Server::Impl::on_reply(Hosted& hosted, Reply& reply) {
  const auto found = sessions_.find(reply.to.session);
  if (found == sessions_.end()) return;
  Session& session = *found->second;
  --session.requests_waiting;
  const xdr::Header request{.address = reply.to.address, .subtype = reply.to.subtype, .sequence = reply.to.sequence};
  if (!reply.answer) return refuse(session, request, reply.answer.error());
  if (auto* subscription = std::get_if<player::Subscribe>(&*reply.answer)) {
    PortNotes& port = hosted.ports[reply.port];
    const std::pair opened{hosted.number, reply.port};
    subscription->address.host = player_host;
    subscription->address.robot = session.local_port();
    if (subscription->access == player::Access::open && !session.input_ended()) {
      if (session.opened.insert(opened).second) port.subscribers.push_back(&session);
    } else if (subscription->access == player::Access::close) {
      session.opened.erase(opened);
      std::erase(port.subscribers, &session);
    }
  } else if (auto* motion = std::get_if<player::Motion>(&*reply.answer)) {
    motion->address.host = player_host;
    motion->address.robot = session.local_port();
  }
  std::visit([&](const auto& body) { acknowledge(session, request, body); }, *reply.answer);
}

void Server::Impl::on_notice(Hosted& hosted, Notice& notice) {
  if (const auto* happened = std::get_if<player::Event>(&notice.message)) {
    return event(happened->severity, std::string{happened->text.view()}, happened->address);
  }
  auto& motion = *std::get_if<player::Motion>(&notice.message);
  PortNotes& port = hosted.ports[notice.port];
  if (port.device.tcp_port == 0) return;  // the driver could offer it, and the configuration does not
  motion.address.host = player_host;
  motion.address.robot = port.device.tcp_port;
  player::Motion& kept = port.motion[std::string{motion.group.view()}] = motion;
  for (const auto& [id, session] : sessions_) {
    if (session->extended && !session->closed()) tell(*session, kept);
  }
}

void Server::Impl::tell(Session& session, const player::Motion& motion) {
  const xdr::Header header{.address = {player_host, session.local_port(), player::code, 0},
                           .kind = Kind::data,
                           .subtype = player::Motion::message.subtype,
                           .timestamp_s = epoch_s(Clock::now())};
  send(session, header, motion);
}

void Server::Impl::event(std::uint8_t severity, const std::string& text, const player::DeviceAddress& address) {
  log(static_cast<LogLevel>(severity), text);
  const player::Event happened{.address = address, .severity = severity, .text = text.substr(0, 1000)};
  std::vector<std::shared_ptr<Session>> listeners;
  for (const auto& [id, session] : sessions_) {
    if (session->extended && !session->closed()) listeners.push_back(session);
  }
  for (const auto& session : listeners) {  // one that cannot take it is closed, which is an event again
    const xdr::Header header{.address = {player_host, session->local_port(), player::code, 0},
                             .kind = Kind::data,
                             .subtype = player::Event::message.subtype,
                             .timestamp_s = epoch_s(Clock::now())};
    send(*session, header, happened);
  }
}

}  // namespace regista
