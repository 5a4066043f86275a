// SPDX-License-Identifier: Apache-2.0
#include <regista/client/robot.hpp>

namespace regista::client {

namespace {

using namespace std::chrono_literals;

// Five times within the usual lease of 0.5 s.
constexpr Duration keep_alive_interval = 100ms;
constexpr std::size_t most_groups = 16;

}  // namespace

Connection& ProxyBase::connection() const { return robot_.connection(); }

void ProxyBase::raise(std::string_view asked, const regista::Error& cause) const {
  robot_.raise(to_string(address_), asked, cause);
}

player::DeviceAddress ProxyBase::wire_address() const {
  return {.interface = address_.interface, .index = address_.index};
}

void ProxyBase::send_any(const AnyCommand& command, std::string_view asked) {
  if (const Result<> sent = connection().send(address_, command); !sent) raise(asked, sent.error());
}

void ProxyBase::on_data(const xdr::Header& header, const AnyData& data, Time arrival) {
  ++count_;
  arrival_ = arrival;
  take_data(header, data, arrival);
}

// ---- Properties

template <>
int ProxyBase::property<int>(std::string_view key) {
  return ask(address_, property::GetInt{.key = key}).value;
}
template <>
double ProxyBase::property<double>(std::string_view key) {
  return ask(address_, property::GetDouble{.key = key}).value;
}
template <>
bool ProxyBase::property<bool>(std::string_view key) {
  return ask(address_, property::GetBool{.key = key}).value != 0;
}
template <>
std::string ProxyBase::property<std::string>(std::string_view key) {
  return std::string{ask(address_, property::GetText{.key = key}).value.view()};
}

void ProxyBase::set_property(std::string_view key, int value) {
  (void)ask(address_, property::SetInt{.key = key, .value = value});
}
void ProxyBase::set_property(std::string_view key, double value) {
  (void)ask(address_, property::SetDouble{.key = key, .value = value});
}
void ProxyBase::set_property(std::string_view key, bool value) {
  (void)ask(address_, property::SetBool{.key = key, .value = value});
}
void ProxyBase::set_property(std::string_view key, std::string_view value) {
  (void)ask(address_, property::SetText{.key = key, .value = value});
}

// ---- Ownership

std::optional<player::Motion> ProxyBase::motion(std::string_view group) {
  if (!connection().extended()) return std::nullopt;
  if (const auto known = motions_.find(group); known != motions_.end()) return known->second;
  player::Motion motion = ask(server_address, player::GetMotion{.address = wire_address(), .group = group});
  if (motions_.size() < most_groups) motions_.emplace(group, motion);
  return motion;
}

const player::Motion* ProxyBase::told_motion(std::string_view group) const {
  const auto known = motions_.find(group);
  return known == motions_.end() ? nullptr : &known->second;
}

void ProxyBase::take(std::string_view group, bool blend) {
  if (!connection().extended()) return;
  (void)ask(server_address, player::Take{.address = wire_address(), .group = group, .blend = blend});
}

void ProxyBase::release(std::string_view group) {
  keep_alive(false);
  if (!connection().extended()) return;
  (void)ask(server_address, player::Release{.address = wire_address(), .group = group});
}

void ProxyBase::take_motion(const player::Motion& motion) {
  const std::string group{motion.group.view()};
  if (motions_.size() < most_groups || motions_.contains(group)) motions_[group] = motion;
  // What was under way before the destination was given does not end it.
  if (motion.state == player::MotionState::driving) {
    drove_ = true;
  } else if (drove_ && keep_alive_at_) {
    keep_alive_at_.reset();
    was_stopped_ = true;
  }
}

void ProxyBase::forget_motions() {
  motions_.clear();
  was_stopped_ = was_stopped_ || keep_alive_at_;
  keep_alive_at_.reset();
}

void ProxyBase::keep_alive(bool on) {
  drove_ = drove_ && on && keep_alive_at_;  // from one destination to the next it just goes on driving
  was_stopped_ = false;
  if (on && connection().extended()) {
    keep_alive_at_ = Clock::now() + keep_alive_interval;
  } else {
    keep_alive_at_.reset();
  }
}

/// Say so if it is time; when it is time again.
Time ProxyBase::keep_alive_at(Time now) {
  if (!keep_alive_at_) return Time::max();
  if (now >= *keep_alive_at_) {
    // A server that takes no bytes gets none: its lease runs out, as it should.
    (void)connection().send(server_address, player::KeepAlive{wire_address()});
    keep_alive_at_ = now + keep_alive_interval;
  }
  return *keep_alive_at_;
}

}  // namespace regista::client
