// SPDX-License-Identifier: Apache-2.0
#include <regista/device/host.hpp>

#include <algorithm>
#include <bit>

#include "finite.hpp"

namespace regista {

namespace {

using namespace std::chrono_literals;

constexpr Duration first_back_off = 1s;  // then doubled, up to the longest
constexpr Duration longest_back_off = 30s;
// [commands] Within `flood_interval`: so many that had no effect are a flood, fewer are a hiccup.
constexpr std::uint64_t least_flood = 500;
constexpr Duration flood_interval = 5s;
// Without a beat of its own a driver's leases and ramps are looked after at this period.
constexpr Duration motion_period = 10ms;
// [items] Of a link whose user does not take them; the answers to one full queue of requests are let in anyway.
constexpr std::size_t longest_backlog = 1024;
constexpr Duration subscription_interval = 1s;  // between attempts
// Half of the shortest lease: what a driver sent to another one stays valid while its own thread goes round.
constexpr Duration keep_alive_interval = 50ms;

template <typename... Fs>
struct Overloaded : Fs... {
  using Fs::operator()...;
};

constexpr std::size_t no_lane = Mailbox<Inbound, 256>::no_lane;

std::string more_before(std::uint64_t count) { return count > 0 ? " (" + std::to_string(count) + " more before)" : ""; }

std::string text_of(const Error& error) { return error.what.empty() ? error.message() : error.what; }

void increment(std::atomic<std::uint64_t>& counter, std::uint64_t by = 1) {
  counter.store(counter.load(std::memory_order_relaxed) + by, std::memory_order_relaxed);  // one writer
}

}  // namespace

void Histogram::add(Duration duration) {
  const auto us = static_cast<std::uint64_t>(std::max<Duration::rep>(duration.count() / 1000, 1));
  const auto octave = static_cast<std::size_t>(std::bit_width(us) - 1);
  const bool upper = us * us >= (std::uint64_t{1} << (2 * octave + 1));  // beyond √2 of the octave
  increment(buckets_[std::min(2 * octave + (upper ? 1 : 0), buckets_.size() - 1)]);
}

std::uint64_t Histogram::count() const {
  std::uint64_t sum = 0;
  for (const auto& bucket : buckets_) sum += bucket.load(std::memory_order_relaxed);
  return sum;
}

Duration Histogram::quantile(double share) const {
  const double wanted = share * static_cast<double>(count());
  double seen = 0;
  for (std::size_t i = 0; i < buckets_.size(); ++i) {
    seen += static_cast<double>(buckets_[i].load(std::memory_order_relaxed));
    if (seen > 0 && seen >= wanted) return from_seconds(1e-6 * std::exp2((static_cast<double>(i) + 1) / 2));
  }
  return {};
}

DriverHost::DriverHost(std::string name, std::unique_ptr<Setup> setup, std::unique_ptr<Driver> driver,
                       HostOptions options)
    : name_{std::move(name)}, options_{std::move(options)}, setup_{std::move(setup)}, driver_{std::move(driver)} {
  period_ = options_.rate_hz > 0 ? from_seconds(1 / options_.rate_hz) : Duration{};
  options_.motion.resize(setup_->ports.size());
  states_.resize(setup_->ports.size());
  for (PortCore& port : setup_->ports) {
    PortState& state = states_[port.number];
    if (port.sensor) options_.motion[port.number].sensor = true;
    for_each_message(AnyCommand::Messages{}, [&]<typename M>(std::size_t alternative) {
      if (M::message.interface != port.interface) return;
      const auto known = std::ranges::find(state.groups, M::message.group, &MotionGroup::group);
      state.group_of[alternative] = static_cast<std::uint8_t>(known - state.groups.begin());
      if (known == state.groups.end()) {
        state.groups.emplace_back(title(port), std::string{M::message.group}, options_.motion[port.number]);
        state.groups.back().on_tell([this, number = port.number](std::uint8_t severity, const std::string& text) {
          broadcast(number, severity, text);
        });
      }
    });
    port.reply = [this](Reply&& reply) {
      Channel& asked_over = channels_[reply.to.link];
      if (reply.to.session != 0) put(asked_over, std::move(reply));
    };
    port.tell = [this, number = port.number](std::uint8_t severity, const std::string& text) {
      broadcast(number, severity, title(setup_->ports[number]) + ": " + text);
    };
    port.stop = [this, number = port.number](const std::string& reason) {
      for (MotionGroup& group : states_[number].groups) group.stop(0, reason, now_);
    };
  }
}

DriverHost::~DriverHost() = default;

std::string DriverHost::title(const PortCore& port) const {
  return (port.host.empty() ? "" : port.host + ':') + std::string{interface_name(port.interface)} + ':' +
         std::to_string(port.index);
}

Link& DriverHost::add_link(const Wakeup* woken) {
  Channel& channel = channels_.emplace_back();
  channel.link.user = woken;
  for (const PortCore& port : setup_->ports) {
    auto& commands = channel.command_lanes.emplace_back();
    for_each_message(AnyCommand::Messages{}, [&]<typename M>(std::size_t alternative) {
      const bool known = M::message.interface == port.interface || std::same_as<M, player::KeepAlive>;
      const bool coalesces = known && M::message.flow == Flow::set_point;
      commands[alternative] = coalesces ? channel.link.down.add_lane() : no_lane;
    });
  }
  // The ports send through one table of lanes: every link has the same, in the same order.
  for (PortCore& port : setup_->ports) {
    for_each_message(AnyData::Messages{}, [&]<typename M>(std::size_t alternative) {
      if (M::message.interface == port.interface) port.lanes[alternative] = channel.link.up.add_lane();
    });
  }
  return channel.link;
}

std::size_t DriverHost::lane(const Link& link, std::size_t port, const AnyCommand& command) const {
  const auto channel = std::ranges::find(channels_, &link, [](const Channel& c) { return &c.link; });
  return channel->command_lanes[port][command.index()];
}

std::span<const int> DriverHost::descriptors() const { return open_ ? driver_->descriptors() : std::span<const int>{}; }

std::optional<Time> DriverHost::busy_since() const {
  const Time::rep since = busy_since_.load(std::memory_order_acquire);
  return since == 0 ? std::nullopt : std::optional{Time{Duration{since}}};
}

bool DriverHost::give_up() {
  given_up_.store(true, std::memory_order_release);
  return driver_->stop_out_of_band();
}

template <typename Call>
void DriverHost::watched(Call&& call) {
  struct Busy {
    std::atomic<Time::rep>& since;
    ~Busy() { since.store(0, std::memory_order_release); }
  } const busy{busy_since_};
  busy_since_.store(now_.time_since_epoch().count(), std::memory_order_release);
  call();
}

void DriverHost::halt() {
  watched([this] { driver_->halt(); });
}

template <typename Call>
bool DriverHost::survives(std::string_view what, Call&& call) {
  std::string thrown;
  try {
    call();
    return true;
  } catch (const std::exception& exception) {
    thrown = exception.what();
  } catch (...) {
    thrown = "something that is no exception";
  }
  fault(std::string{what} + " threw \"" + thrown + '"');
  return false;
}

Time DriverHost::cycle(Time now, bool descriptor_ready) {
  now_ = now;
  for (PortCore& port : setup_->ports) port.now = now;
  for (RequiredCore& device : setup_->required) device.now = now;
  if (given_up_.exchange(false, std::memory_order_acq_rel)) fault("hung and came back");

  if (std::exchange(just_opened_, false)) {  // open() may have taken long: the beats start after it
    last_read_ = now;
    next_beat_ = period_ > Duration{} ? now : Time::max();
  }

  for (std::size_t number = 0; number < channels_.size(); ++number) {
    Channel& channel = channels_[number];
    while (!channel.backlog.empty()) {
      Outbound& oldest = channel.backlog.front();
      if (!channel.link.up.put(no_lane, [&](Outbound& out) { out = std::move(oldest); })) break;
      channel.backlog.pop_front();
      channel.dirty = true;
    }
    if (!channel.backlog.empty()) continue;  // whoever does not take answers may not ask
    channel.link.down.drain([&](Inbound& inbound) {
      inbound.reply_to.link = number;
      process(channel, inbound);
    });
  }
  for (RequiredCore& device : setup_->required) receive(device);

  if (!open_ && wanted() && now >= retry_at_) (void)try_open();
  run_motion();
  warn_of_flood();
  if (open_ && !just_opened_ && (descriptor_ready || now >= next_beat_)) beat();
  publish_changed_motion();
  for (RequiredCore& device : setup_->required) attend(device, open_);

  for (Channel& channel : channels_) {
    if (std::exchange(channel.dirty, false) || channel.link.up.size() > 0) channel.link.user->notify();
  }

  Time due = just_opened_ ? now : open_ ? next_beat_ : wanted() ? retry_at_ : Time::max();
  const Time next_step = period_ > Duration{} ? next_beat_ : now + motion_period;
  for (const PortState& state : states_) {
    for (const MotionGroup& group : state.groups) due = std::min(due, group.due(next_step));
  }
  for (const Channel& channel : channels_) {
    if (!channel.backlog.empty()) due = std::min(due, now + motion_period);
  }
  for (const RequiredCore& device : setup_->required) {
    const bool busy = open_ ? !device.connected || device.commanded : device.subscription != 0;
    if (device.link != nullptr && busy) due = std::min(due, device.due);
  }
  return due;
}

void DriverHost::process(Channel& channel, Inbound& inbound) {
  std::visit(Overloaded{
                 [&](const AnyCommand&) { process_command(channel, inbound); },
                 [&](const AnyRequest&) { process_request(channel, inbound); },
                 [&](const Identity& who) {
                   const bool is_new = identities_.insert_or_assign(inbound.session, who).second;
                   if (!is_new) return;
                   // Whatever others were told: who comes must hear of its own first refusal.
                   for (PortState& state : states_) state.refusals = PortState{}.refusals;
                 },
                 [&](const Gone&) { gone(channel, inbound.session); },
             },
             inbound.message);
}

void DriverHost::process_command(Channel& channel, Inbound& inbound) {
  const auto& command = *std::get_if<AnyCommand>(&inbound.message);
  PortCore& port = setup_->ports[inbound.port];
  PortState& state = states_[inbound.port];
  increment(metrics_.commands);
  if (std::holds_alternative<player::KeepAlive>(command)) {
    for (MotionGroup& group : state.groups) group.keep_alive(inbound.session, inbound.arrived);
    return;
  }
  const auto& handler = port.commands[command.index()];
  const auto refusal = [&]() -> std::optional<Error> {
    if (!open_) return Error{std::errc::not_connected, faulted_ ? fault_text_ : "not open"};
    if (!state.subscribers.contains({&channel.link, inbound.session})) {
      return Error{std::errc::permission_denied, "subscribe to " + title(port) + " first"};
    }
    if (!handler) return Error{std::errc::not_supported, "driver \"" + name_ + "\" does not take this command"};
    MotionGroup& group = state.groups[state.group_of[command.index()]];
    if (group.displaces(command)) tell_driver(state, port);
    if (!open_) return Error{std::errc::not_connected, fault_text_};
    if (Result<> taken = group.command(inbound.session, identity(inbound.session), command, inbound.arrived, now_);
        !taken) {
      return taken.error();
    }
    return std::nullopt;
  }();
  const auto answer = [&](const Result<>& taken) {
    if (inbound.reply_to.session == 0) return;
    put(channel, Reply{.to = inbound.reply_to,
                       .port = inbound.port,
                       .answer = taken ? Result<AnyReply>{AnyReply{}} : Result<AnyReply>{taken.error()}});
  };
  if (refusal) {
    refuse(inbound.port, *refusal);
    return answer(*refusal);
  }
  const bool edge = std::visit([]<typename M>(const M&) { return M::message.flow == Flow::edge; }, command);
  if (!edge && !options_.motion[inbound.port].sensor) return;  // the group has it: told once, after all that waits
  tell_driver(state, port);
  answer(open_ ? call_handler(port, command) : Result<>{Error{std::errc::not_connected, fault_text_}});
}

void DriverHost::refuse(std::size_t port, const Error& error) {
  increment(metrics_.commands_refused);
  PortState& state = states_[port];
  const auto untold = state.refusals.admit(now_);
  if (!untold) return;
  broadcast(port, 1, title(setup_->ports[port]) + " refused: " + text_of(error) + more_before(*untold));
}

void DriverHost::process_request(Channel& channel, Inbound& inbound) {
  const auto& request = *std::get_if<AnyRequest>(&inbound.message);
  PortCore& port = setup_->ports[inbound.port];
  PortState& state = states_[inbound.port];
  increment(metrics_.requests);
  const auto answer = [&](Result<AnyReply> reply) {
    if (inbound.reply_to.session == 0) return;
    put(channel, Reply{.to = inbound.reply_to, .port = inbound.port, .answer = std::move(reply)});
  };
  const auto group_named = [&](const Text& name) -> MotionGroup* {
    const std::string_view wanted = name.view().empty() ? std::string_view{"motion"} : name.view();
    const auto found = std::ranges::find(state.groups, wanted, &MotionGroup::group);
    return found == state.groups.end() ? nullptr : &*found;
  };
  const Error no_group{std::errc::invalid_argument, title(port) + " has no such command group"};

  if (const auto* subscription = std::get_if<player::Subscribe>(&request)) {
    return answer(subscribe(channel, inbound, *subscription));
  }
  if (std::holds_alternative<player::Stop>(request)) {
    for (MotionGroup& group : state.groups) {
      group.stop(inbound.session, "\"" + identity(inbound.session).name + "\" asked for a stop", now_);
    }
    // Nothing is on its way to rest there, but energy is kept ready.
    const AnyCommand uncharge = kicker::ChargeCommand{.on = 0};
    if (open_ && port.commands[uncharge.index()]) (void)call_handler(port, uncharge);
    return answer(AnyReply{});
  }
  if (const auto* motion = std::get_if<player::GetMotion>(&request)) {
    const MotionGroup* group = group_named(motion->group);
    if (group == nullptr) return answer(no_group);
    player::Motion status = group->status();
    status.address = motion->address;
    return answer(AnyReply{std::move(status)});
  }
  if (!state.subscribers.contains({&channel.link, inbound.session})) {
    return answer(Error{std::errc::permission_denied, "subscribe to " + title(port) + " first"});
  }
  if (const auto* take = std::get_if<player::Take>(&request)) {
    MotionGroup* group = group_named(take->group);
    if (group == nullptr) return answer(no_group);
    const Result<> taken = group->take(inbound.session, identity(inbound.session), take->blend != 0, now_);
    return answer(taken ? Result<AnyReply>{AnyReply{}} : Result<AnyReply>{taken.error()});
  }
  if (const auto* release = std::get_if<player::Release>(&request)) {
    MotionGroup* group = group_named(release->group);
    if (group == nullptr) return answer(no_group);
    group->release(inbound.session, now_);
    return answer(AnyReply{});
  }
  if (const auto* capability = std::get_if<property::HasCapability>(&request)) {
    bool supported = false;
    const auto matches = [&](const Message& message) {
      return message.interface == port.interface && static_cast<std::uint32_t>(message.kind) == capability->kind &&
             message.subtype == capability->subtype;
    };
    for_each_message(AnyCommand::Messages{},
                     [&]<typename M>(std::size_t i) { supported |= matches(M::message) && port.commands[i]; });
    for_each_message(AnyRequest::Messages{},
                     [&]<typename M>(std::size_t i) { supported |= matches(M::message) && port.requests[i]; });
    for_each_message(AnyData::Messages{}, [&]<typename M>(std::size_t) { supported |= matches(M::message); });
    if (supported) return answer(AnyReply{});
    return answer(Error{std::errc::not_supported, title(port) + " does not have that capability"});
  }
  const bool universal =
      std::visit([]<typename M>(const M&) { return M::message.interface == any_interface; }, request);
  if (universal) return answer(property(request));

  if (!open_) return answer(Error{std::errc::not_connected, faulted_ ? fault_text_ : "not open"});
  const auto& handler = port.requests[request.index()];
  if (!handler) {
    return answer(Error{std::errc::not_supported, "driver \"" + name_ + "\" does not answer this request"});
  }
  if (std::string found = std::visit([](const auto& message) { return first_not_finite(message); }, request);
      !found.empty()) {
    return answer(Error{std::errc::invalid_argument, std::move(found)});
  }
  tell_driver(state, port);
  if (!open_) return answer(Error{std::errc::not_connected, fault_text_});
  survives("request", [&] { watched([&] { handler(request, inbound.reply_to); }); });
}

Result<AnyReply> DriverHost::subscribe(Channel& channel, const Inbound& inbound, const player::Subscribe& request) {
  PortCore& port = setup_->ports[inbound.port];
  auto& subscribers = states_[inbound.port].subscribers;
  const std::pair subscriber{&channel.link, inbound.session};
  player::Subscribe reply{.address = request.address, .access = request.access, .driver = name_};
  const auto update_listeners = [&] {
    const bool listens = std::ranges::any_of(subscribers, [&](const auto& s) { return s.first == &channel.link; });
    std::erase(port.listeners, &channel.link);
    if (listens) port.listeners.push_back(&channel.link);
  };
  if (request.access == player::Access::open) {
    if (!open_) {
      // A person's attempt is made at once; a driver asks every second, and must not defeat the back-off.
      const bool too_soon = faulted_ && now_ < retry_at_ && inbound.session >= first_driver_session;
      if (too_soon) return Error{std::errc::not_connected, fault_text_};
      if (Result<> opened = try_open(); !opened) return opened.error();
    }
    subscribers.insert(subscriber);
    update_listeners();
  } else if (subscribers.erase(subscriber) > 0 && request.access == player::Access::close) {
    update_listeners();
    tell_driver(states_[inbound.port], port);  // what it said before
    for (MotionGroup& group : states_[inbound.port].groups) group.gone(inbound.session, now_);
    run_motion();
    close_if_unused();
  } else {
    reply.access = player::Access::error;
  }
  return AnyReply{std::move(reply)};
}

void DriverHost::gone(Channel& channel, SessionId session) {
  for (PortCore& port : setup_->ports) {
    PortState& state = states_[port.number];
    tell_driver(state, port);  // what it said before it went
    for (MotionGroup& group : state.groups) group.gone(session, now_);
    state.subscribers.erase({&channel.link, session});
    if (std::ranges::none_of(state.subscribers, [&](const auto& s) { return s.first == &channel.link; })) {
      std::erase(port.listeners, &channel.link);
    }
  }
  identities_.erase(session);
  run_motion();
  close_if_unused();
}

Result<AnyReply> DriverHost::property(const AnyRequest& request) {
  const auto find = [&](const Text& key) -> PropertyCore* {
    const auto found = std::ranges::find(setup_->properties, key.view(), &PropertyCore::name);
    return found == setup_->properties.end() ? nullptr : &*found;
  };
  const auto get = [&]<typename T, typename M>(const M& message, std::type_identity<T>) -> Result<AnyReply> {
    const PropertyCore* found = find(message.key);
    const T* value = found == nullptr ? nullptr : std::get_if<T>(&found->value);
    if (value == nullptr) {
      return Error{std::errc::no_message_available,
                   "driver \"" + name_ + "\" has no property '" + std::string{message.key.view()} + "' of this type"};
    }
    M reply{.key = message.key};
    if constexpr (std::same_as<T, std::string>) {
      reply.value = Text{*value};
    } else {
      reply.value = static_cast<decltype(reply.value)>(*value);
    }
    return AnyReply{std::move(reply)};
  };
  const auto set = [&](const auto& message, PropertyCore::Value value) -> Result<AnyReply> {
    PropertyCore* found = find(message.key);
    if (found == nullptr) {
      return Error{std::errc::no_message_available,
                   "driver \"" + name_ + "\" has no property '" + std::string{message.key.view()} + "'"};
    }
    Result<> done;
    if (!survives("property", [&] { watched([&] { done = found->set(std::move(value)); }); })) {
      return Error{std::errc::state_not_recoverable, fault_text_};
    }
    if (!done) return done.error();
    return AnyReply{};
  };
  return std::visit(
      Overloaded{
          [&](const property::GetInt& m) { return get(m, std::type_identity<std::int32_t>{}); },
          [&](const property::GetDouble& m) { return get(m, std::type_identity<double>{}); },
          [&](const property::GetBool& m) { return get(m, std::type_identity<bool>{}); },
          [&](const property::GetText& m) { return get(m, std::type_identity<std::string>{}); },
          [&](const property::SetInt& m) { return set(m, m.value); },
          [&](const property::SetDouble& m) { return set(m, m.value); },
          [&](const property::SetBool& m) { return set(m, m.value != 0); },
          [&](const property::SetText& m) { return set(m, std::string{m.value.view()}); },
          [&](const auto&) -> Result<AnyReply> { return Error{std::errc::not_supported, "no property request"}; },
      },
      request);
}

void DriverHost::receive(RequiredCore& device) {
  if (device.link == nullptr) return;
  device.link->up.drain([&](Outbound& item) {
    survives("data", [&] {
      watched([&] {
        if (const Sample* sample = std::get_if<Sample>(&item)) {
          if (sample->port == device.port && device.data[sample->data.index()]) {
            device.data[sample->data.index()](sample->data, sample->measured);
          }
        } else if (Reply* reply = std::get_if<Reply>(&item)) {
          if (const auto waiting = device.waiting.extract(reply->to.sequence)) waiting.mapped()(reply->answer);
        }
      });
    });
  });
}

/// Keep what was joined: subscribed while the driver is open, and shown that it is alive.
void DriverHost::attend(RequiredCore& device, bool open) {
  if (device.link == nullptr) return;
  if (!open) {
    device.connected = false;
    device.commanded = false;
    if (device.subscription == 0) return;
    if (device.post(AnyRequest{player::Subscribe{.access = player::Access::close}})) device.subscription = 0;
    device.due = now_ + subscription_interval;
    return;
  }
  if (device.subscription != 0 && now_ < device.due) return;
  if (device.connected) {
    device.due = now_ + keep_alive_interval;
    if (device.commanded) (void)device.command(player::KeepAlive{});
    return;
  }
  device.due = now_ + subscription_interval;
  if (device.waiting.contains(device.subscription)) return;  // the provider is still opening
  const std::uint32_t number = ++device.requests_sent;
  const bool asked = device.post(Identity{.name = name_, .priority = options_.priority, .extended = true}) &&
                     device.post(AnyRequest{player::Subscribe{}}, {.session = device.session, .sequence = number});
  if (!asked) return;
  device.subscription = number;
  device.waiting.emplace(number, [&device, number](const Result<AnyReply>& answer) {
    device.connected = answer && device.subscription == number;
    if (device.connected) device.due = device.now;
  });
}

void join(DriverHost& consumer, RequiredCore& required, DriverHost& provider, std::size_t port, SessionId session) {
  Link& link = provider.add_link(&consumer.wakeup());
  required.link = &link;
  required.port = port;
  required.session = session;
  required.provider = &provider.wakeup();
  for_each_message(AnyCommand::Messages{}, [&]<typename M>(std::size_t alternative) {
    required.lanes[alternative] = provider.lane(link, port, AnyCommand{std::in_place_type<M>});
  });
}

Result<> DriverHost::call_handler(PortCore& port, const AnyCommand& command) {
  Result<> done;
  if (!survives("command", [&] { watched([&] { done = port.commands[command.index()](command); }); })) {
    return Error{std::errc::state_not_recoverable, fault_text_};
  }
  if (!done) refuse(port.number, done.error());
  return done;
}

/// What was refused; empty: nothing.
Result<> DriverHost::tell(PortCore& port, const AnyCommand& command) {
  if (port.commands[command.index()]) return call_handler(port, command);
  // The way to rest of an array is told joint by joint where the driver takes nothing else.
  constexpr std::size_t one_joint = index_in<actarray::SpeedCommand>(AnyCommand::Messages{});
  const auto* all = std::get_if<actarray::MultiSpeedCommand>(&command);
  if (all == nullptr || !port.commands[one_joint]) return Error{std::errc::not_supported, "cannot be told to rest"};
  Result<> told;
  for (std::size_t joint = 0; joint < all->speeds.size() && open_; ++joint) {
    const actarray::SpeedCommand one{.joint = static_cast<std::int32_t>(joint), .speed = all->speeds[joint]};
    if (Result<> done = call_handler(port, one); !done) told = std::move(done);
  }
  return told;
}

void DriverHost::tell_driver(PortState& state, PortCore& port) {
  for (MotionGroup& group : state.groups) {
    const AnyCommand* command = group.step(now_, port.last);
    bool must_halt = group.take_halt_request();
    if (!open_) continue;
    if (command != nullptr) {
      if (const Result<> told = tell(port, *command); !told) {
        const MotionGroup::AfterRefusal then = group.refused(text_of(told.error()), now_);
        const bool rests = then == MotionGroup::AfterRefusal::come_to_rest;  // now, not at the next beat
        command = rests ? group.step(now_, port.last) : nullptr;
        must_halt = then == MotionGroup::AfterRefusal::halt || group.take_halt_request() ||
                    (command != nullptr && !tell(port, *command));
      }
    }
    if (must_halt && open_) {
      halt();
      // All of the driver stands now, also what this group has nothing to do with.
      for (PortState& of_port : states_) {
        for (MotionGroup& other : of_port.groups) {
          if (&other != &group && other.driving()) other.halted("halted to bring " + title(port) + " to rest", false);
        }
      }
    }
    increment(metrics_.commands_clamped, group.take_clamped());
    increment(metrics_.commands_replaced, group.take_replaced());
  }
}

void DriverHost::run_motion() {
  for (PortCore& port : setup_->ports) tell_driver(states_[port.number], port);
}

/// Set-points coalesce, which is as it should be; that a client sends them by the thousand is not.
void DriverHost::warn_of_flood() {
  std::uint64_t replaced = metrics_.commands_replaced.load(std::memory_order_relaxed);
  for (const Channel& channel : channels_) replaced += channel.link.down.replaced();
  const std::uint64_t fresh = replaced - flood_counted_;
  const bool flood = fresh >= least_flood;
  if (flood ? flood_told_ && now_ - *flood_told_ < flood_interval : now_ - flood_since_ < flood_interval) return;
  if (flood) {
    flood_told_ = now_;
    broadcast(0, 1,
              "driver \"" + name_ + "\": " + std::to_string(fresh) + " commands in " +
                  std::to_string((now_ - flood_since_) / 1ms) + " ms were replaced by newer ones before it took them");
  }
  flood_since_ = now_;
  flood_counted_ = replaced;
}

void DriverHost::beat() {
  const bool on_time = now_ >= next_beat_;
  if (on_time) {
    const Duration late = now_ - next_beat_;
    metrics_.jitter.add(late);
    increment(metrics_.beats);
    next_beat_ += period_;
    if (next_beat_ <= now_) {  // skip what was missed, stay on the grid
      const auto missed = (now_ - next_beat_) / period_ + 1;
      increment(metrics_.beats_missed, static_cast<std::uint64_t>(missed));
      if (const auto untold = missed_deadlines_.admit(now_)) {
        broadcast(
            0, 1,
            "driver \"" + name_ + "\": deadline missed: " + std::to_string(late / 1ms) + " ms" + more_before(*untold));
      }
      next_beat_ += missed * period_;
    }
  }
  Result<> read;
  const Tick tick{.now = now_, .dt = now_ - std::exchange(last_read_, now_)};
  if (!survives("read", [&] { watched([&] { read = driver_->read(tick); }); })) return;
  if (!read) return fault(read.error().message());
  if (survives("publish", [&] { watched([&] { driver_->publish(); }); })) back_off_ = {};
}

Result<> DriverHost::try_open() {
  // First, so that open() may ask them.
  for (RequiredCore& device : setup_->required) attend(device, true);
  Result<> opened;
  if (!survives("open", [&] { opened = driver_->open(); })) {
    return Error{std::errc::state_not_recoverable, fault_text_};
  }
  if (!opened) {
    fault(opened.error().message());
    return Error{opened.error().code, fault_text_};
  }
  open_ = true;
  just_opened_ = true;
  if (period_ == Duration{}) back_off_ = {};  // with a beat, the first good one does this
  metrics_.open.store(true, std::memory_order_relaxed);
  faulted_ = false;
  for (PortState& state : states_) {
    for (MotionGroup& group : state.groups) group.recovered();
  }
  return {};
}

void DriverHost::descriptor_left_dead(int descriptor) {
  fault("its descriptor " + std::to_string(descriptor) + " hung up (unplugged, or closed by the other end)");
}

void DriverHost::close_if_unused() {
  if (!open_ || wanted()) return;
  halt();
  watched([this] { driver_->close(); });
  open_ = false;
  metrics_.open.store(false, std::memory_order_relaxed);
  next_beat_ = Time::max();
  for (PortState& state : states_) {
    for (MotionGroup& group : state.groups) group.halted("closed: nobody is subscribed", false);
  }
}

void DriverHost::fault(const std::string& what) {
  halt();
  if (open_) watched([this] { driver_->close(); });
  open_ = false;
  faulted_ = true;
  fault_text_ = "driver \"" + name_ + "\" failed: " + what;
  next_beat_ = Time::max();
  back_off_ = back_off_ == Duration{} ? first_back_off : std::min(back_off_ * 2, longest_back_off);
  retry_at_ = now_ + back_off_;
  increment(metrics_.faults);
  metrics_.open.store(false, std::memory_order_relaxed);
  for (PortCore& port : setup_->ports) {
    for (MotionGroup& group : states_[port.number].groups) group.halted(fault_text_, true);
  }
  broadcast(0, 2, fault_text_ + (wanted() ? "; next try in " + std::to_string(back_off_ / 1s) + " s" : ""));
}

void DriverHost::shut_down(Time now) {
  now_ = now;
  for (PortCore& port : setup_->ports) {
    for (MotionGroup& group : states_[port.number].groups) group.stop(0, "server shutting down", now);
  }
  run_motion();
  halt();
  if (open_) watched([this] { driver_->close(); });
  open_ = false;
  publish_changed_motion();
  for (RequiredCore& device : setup_->required) attend(device, false);
}

void DriverHost::notify_users() const {
  for (const Channel& channel : channels_) channel.link.user->notify();
}

void DriverHost::put(Channel& channel, Outbound&& item) {
  channel.dirty = true;
  if (channel.backlog.empty() && channel.link.up.put(no_lane, [&](Outbound& out) { out = std::move(item); })) return;
  channel.backlog.push_back(std::move(item));
}

void DriverHost::broadcast(std::size_t port, std::uint8_t severity, const std::string& text) {
  if (channels_.empty()) return;
  player::Event event{.severity = severity, .text = text};
  if (port < setup_->ports.size() && setup_->ports[port].host.empty()) {
    event.address.interface = setup_->ports[port].interface;
    event.address.index = setup_->ports[port].index;
  }
  if (channels_.front().backlog.size() >= longest_backlog) return increment(metrics_.events_dropped);
  put(channels_.front(), Notice{.port = port, .message = std::move(event)});
}

void DriverHost::publish_changed_motion() {
  if (channels_.empty() || !channels_.front().backlog.empty()) return;  // only the newest is of interest
  for (PortCore& port : setup_->ports) {
    if (!port.host.empty()) continue;  // its own server tells
    for (MotionGroup& group : states_[port.number].groups) {
      if (!group.take_changed()) continue;
      player::Motion status = group.status();
      status.address.interface = port.interface;
      status.address.index = port.index;
      put(channels_.front(), Notice{.port = port.number, .message = std::move(status)});
    }
  }
}

const Identity& DriverHost::identity(SessionId session) const {
  static const Identity unknown{"unknown", 10, false};
  const auto found = identities_.find(session);
  return found == identities_.end() ? unknown : found->second;
}

bool DriverHost::wanted() const {
  return options_.always_on || std::ranges::any_of(states_, [](const PortState& s) { return !s.subscribers.empty(); });
}

}  // namespace regista
