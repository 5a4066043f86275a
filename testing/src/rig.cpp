// SPDX-License-Identifier: Apache-2.0
#include <regista/testing/rig.hpp>

#include <algorithm>

namespace regista::testing {

namespace {

constexpr std::size_t no_lane = Mailbox<Inbound, 256>::no_lane;

const PlacedName* named(const std::vector<PlacedName>& names, std::vector<bool>& used, std::uint16_t interface,
                        const std::string& key) {
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (used[i] || names[i].name.interface != interface || (!key.empty() && names[i].name.key != key)) continue;
    used[i] = true;
    return &names[i];
  }
  return nullptr;
}

}  // namespace

Rig::Rig(const std::string& config, const std::map<std::string, Create>& drivers) {
  for (const Section& section : parse_config(config, "rig.cfg").drivers) {
    auto setup = std::make_unique<Setup>(section);
    const Section& keys = setup->config;
    const std::string name = keys.text("name");
    const auto create = drivers.find(name);
    if (create == drivers.end()) throw keys.error("name", "is none of this rig's drivers");
    HostOptions options{.rate_hz = keys.number("rate", 50, {.min = 0, .max = 10'000}),
                        .always_on = keys.boolean("alwayson", false),
                        .priority = static_cast<std::int32_t>(keys.integer("priority", 10, {.min = 0, .max = 100}))};
    const MotionPolicy policy = MotionPolicy::read(keys);
    const auto provides = keys.device_names("provides");
    (void)keys.has("requires");
    auto driver = create->second(*setup);
    keys.check_unused();
    Hosted& hosted = hosts_.emplace_back();
    std::vector<bool> used(provides.size(), false);
    for (PortCore& port : setup->ports) {
      const PlacedName* offer = named(provides, used, port.interface, port.key);
      if (offer == nullptr) continue;
      port.offered = true;
      port.index = offer->name.index;
      devices_[{port.interface, port.index}] = {&hosted, port.number};
    }
    options.motion.assign(setup->ports.size(), policy);
    hosted.host = std::make_unique<DriverHost>(name, std::move(setup), std::move(driver), std::move(options));
    hosted.link = &hosted.host->add_link(&woken_);
  }
  SessionId next = first_driver_session;
  for (Hosted& hosted : hosts_) {
    const auto names = hosted.host->config().device_names("requires");
    std::vector<bool> used(names.size(), false);
    for (RequiredCore& required : hosted.host->required()) {
      const PlacedName* wanted = named(names, used, required.interface, required.key);
      if (wanted == nullptr) throw hosted.host->config().error("requires", "lacks a device that the driver needs");
      required.index = wanted->name.index;
      const Device device = find(required.interface, required.index);
      join(*hosted.host, required, *device.hosted->host, device.port, next++);
      device.hosted->users.push_back(required.link);
      hosted.stands.push_back(required.link);
    }
  }
  arrive(client, {"client", 10, false});
}

Rig::Device Rig::find(std::uint16_t interface, std::uint16_t index) {
  const auto found = devices_.find({interface, index});
  if (found != devices_.end()) return found->second;
  throw std::out_of_range{"the rig has no " + std::string{interface_name(interface)} + ':' + std::to_string(index)};
}

void Rig::put(const Device& device, const AnyCommand& command, SessionId session) {
  Link& link = *device.hosted->link;
  (void)link.down.put(device.hosted->host->lane(link, device.port, command), [&](Inbound& inbound) {
    inbound = {.session = session, .port = device.port, .arrived = now_, .reply_to = {}, .message = command};
  });
}

Result<AnyReply> Rig::put_request(const Device& device, AnyRequest request, SessionId session) {
  reply_.reset();
  (void)device.hosted->link->down.put(no_lane, [&](Inbound& inbound) {
    inbound = {.session = session,
               .port = device.port,
               .arrived = now_,
               .reply_to = {.session = session},
               .message = std::move(request)};
  });
  run({});
  return reply_.value_or(Error{std::errc::timed_out, "no reply"});
}

std::string Rig::text(std::uint16_t interface, std::uint16_t index, std::string_view key) {
  const auto reply = ask(interface, property::GetText{.key = Text{key}}, index);
  return reply ? std::string{reply->value.view()} : "error: " + reply.error().message();
}

void Rig::arrive(SessionId session, const Identity& who) {
  for (const auto& [address, device] : devices_) {
    (void)device.hosted->link->down.put(no_lane, [&](Inbound& inbound) {
      inbound = {.session = session, .port = device.port, .arrived = now_, .reply_to = {}, .message = who};
    });
    (void)put_request(device, player::Subscribe{.access = player::Access::open}, session);
  }
}

void Rig::leave(SessionId session) {
  for (Hosted& hosted : hosts_) {
    (void)hosted.link->down.put(no_lane, [&](Inbound& inbound) {
      inbound = {.session = session, .port = 0, .arrived = now_, .reply_to = {}, .message = Gone{}};
    });
  }
  run({});
}

void Rig::run(Duration duration) {
  const Time end = now_ + duration;
  for (cycle(); now_ < end; cycle()) {
    now_ = end;
    for (const Hosted& hosted : hosts_) now_ = std::min(now_, hosted.due);
  }
}

bool Rig::Hosted::is_spoken_to() const {
  const auto waits = [](const auto& queue) { return queue.size() > 0; };
  return waits(link->down) || std::ranges::any_of(users, [&](const Link* user) { return waits(user->down); }) ||
         std::ranges::any_of(stands, [&](const Link* below) { return waits(below->up); });
}

/// What is due now, until nobody has anything to say to anybody.
void Rig::cycle() {
  for (bool again = true; again;) {
    again = false;
    for (Hosted& hosted : hosts_) {
      if (hosted.due > now_ && !hosted.is_spoken_to()) continue;
      hosted.due = std::max(hosted.host->cycle(now_), now_ + Duration{1});
      take(hosted);
      again = true;
    }
  }
}

void Rig::take(Hosted& hosted) {
  const auto& ports = hosted.host->ports();
  hosted.link->up.drain([&](Outbound& out) {
    if (const Sample* sample = std::get_if<Sample>(&out)) {
      const PortCore& port = ports[sample->port];
      const std::uint8_t subtype = std::visit([]<typename D>(const D&) { return D::message.subtype; }, sample->data);
      data_[{port.interface, port.index, subtype}] = sample->data;
    } else if (const Reply* reply = std::get_if<Reply>(&out)) {
      reply_ = reply->answer;
    } else if (const auto* event = std::get_if<player::Event>(&std::get<Notice>(out).message)) {
      events_ += std::string{event->text.view()} + '\n';
    }
  });
}

}  // namespace regista::testing
