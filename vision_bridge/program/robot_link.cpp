// SPDX-License-Identifier: Apache-2.0
#include "robot_link.hpp"

#include <linux/tcp.h>  // which knows tcpi_min_rtt
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>

namespace regista::vision {

namespace {

using namespace std::chrono_literals;

constexpr client::Address base{position2d::code, 0};
constexpr Duration stale = 200ms;  ///< a pose that waited longer is not sent
constexpr Duration first_back_off = 100ms;
constexpr Duration longest_back_off = 1s;
constexpr Duration ask_again = 3s;  ///< for a device that did not open in time

}  // namespace

double Quantiles::at(double share) const {
  const std::size_t size = std::min(count_, values_.size());
  if (size == 0) return 0;
  auto sorted = values_;
  const auto nth = sorted.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(size - 1));
  std::nth_element(sorted.begin(), nth, sorted.begin() + static_cast<std::ptrdiff_t>(size));
  return *nth;
}

RobotLink::RobotLink(const RobotAddress& address, Log log, OnTurn on_turn)
    : address_{address},
      device_{position2d::code, address.index},
      log_{std::move(log)},
      on_turn_{std::move(on_turn)},
      connection_{address.host, address.port, client::Options{.timeout = 1s, .name = "vision-bridge"}} {
  // Only who has subscribed a device may command it.
  (void)connection_.subscribe(device_, [](const xdr::Header&, const AnyData&, Time) {});
}

void RobotLink::offer(const Pose2d& pose, Time captured, Time arrival) {
  if (!connected()) {
    ++counters_.unsent;
    return;
  }
  if (pending_) ++counters_.superseded;
  pending_ = {.pose = pose, .captured = captured, .arrival = arrival};
  flush();
}

void RobotLink::flush() {
  if (!pending_ || !connected()) return;
  // Writable means, by TCP_NOTSENT_LOWAT, that nothing waits in the kernel to be sent first.
  pollfd writable{.fd = connection_.fileno(), .events = POLLOUT, .revents = 0};
  if (::poll(&writable, 1, 0) != 1 || (writable.revents & POLLOUT) == 0) return;
  const Pending pose = *std::exchange(pending_, std::nullopt);
  const Time now = Clock::now();
  if (now - pose.arrival > stale) {
    ++counters_.superseded;
    return;
  }
  const position2d::VelocityCommand command{.velocity = {.x = pose.pose.x, .y = pose.pose.y, .w = pose.pose.heading},
                                            .motors_on = 1,
                                            .age_s = seconds(now - pose.captured)};
  if (const Result<> sent = connection_.send(device_, command); !sent) {
    ++counters_.unsent;
    return;
  }
  ++counters_.sent;
  ages_s_.add(*command.age_s);
  latencies_s_.add(seconds(now - pose.arrival));
}

void RobotLink::halt() {
  is_halt_ = true;
  if (!connected()) return;
  if (!connection_.extended()) {
    if (connection_.send(base, position2d::VelocityCommand{})) ++counters_.halts;
    return;
  }
  stop_waits_ = connection_.request_pending();
  if (stop_waits_) return;
  (void)connection_.post(client::server_address, player::Stop{}, [this](Result<std::span<const std::byte>> body) {
    if (body) ++counters_.halts;
  });
}

void RobotLink::service() {
  if (retry_at_) {
    if (Clock::now() < *retry_at_) return;
    retry_at_.reset();
    connection_.start();
  }
  if (const auto taken = connection_.read(0ms); !taken) return lose(taken.error().message());
  if (connected() && !greeted_) greet();
  if (stop_waits_) halt();
  if (greeted_ && on_turn_ && ask_motion_at_ <= Clock::now() && !is_halt_ && !connection_.request_pending())
    ask_motion();
  flush();
}

void RobotLink::greet() {
  greeted_ = true;
  ++counters_.connects;
  back_off_ = {};
  last_failure_.clear();
  constexpr int nothing = 1;  // bytes that may wait to be sent: fewer than one
  (void)::setsockopt(connection_.fileno(), IPPROTO_TCP, TCP_NOTSENT_LOWAT, &nothing, sizeof nothing);
  // What the device publishes is of no interest here.
  (void)connection_.post(client::server_address,
                         player::AddReplaceRule{.interface = device_.interface, .index = device_.index, .replace = 2},
                         [](Result<std::span<const std::byte>>) {});
  log_(false, to_string(address_.id) + ": connected to " + address_.host + ':' + std::to_string(address_.port) +
                  (connection_.extended() ? "" : ", a stock server"));
}

/// Not while connecting: a robot without that device takes poses all the same. Nor during a HALT: a driver may take
/// long to open, and no stop is sent meanwhile.
void RobotLink::ask_motion() {
  ask_motion_at_ = Time::max();
  if (!address_.motion) return;
  const client::Address motion{position2d::code, *address_.motion};
  const auto take = [this](const xdr::Header& header, const AnyData& data, Time arrival) {
    if (const auto* state = std::get_if<position2d::State>(&data))
      on_turn_(state->velocity.w, header.timestamp_s, arrival, way());
  };
  (void)connection_.subscribe(motion, take, [this, motion](const Result<std::string>& driver) {
    if (driver || !connected()) return;  // lose() says why
    if (driver.error().code == client::Errc::no_answer) ask_motion_at_ = Clock::now() + ask_again;
    say_once(to_string(motion) + ": " + driver.error().message());
  });
}

Duration RobotLink::way() const {
  tcp_info info{};
  socklen_t size = sizeof info;
  if (::getsockopt(connection_.fileno(), IPPROTO_TCP, TCP_INFO, &info, &size) != 0) return {};
  return std::chrono::microseconds{info.tcpi_min_rtt} / 2;
}

void RobotLink::lose(const std::string& why) {
  greeted_ = stop_waits_ = false;
  ask_motion_at_ = {};
  if (address_.motion) (void)connection_.unsubscribe({position2d::code, *address_.motion});
  pending_.reset();
  back_off_ = std::clamp(2 * back_off_, first_back_off, longest_back_off);
  retry_at_ = Clock::now() + back_off_;
  say_once(why);
}

/// Once for each reason.
void RobotLink::say_once(const std::string& why) {
  if (why == last_failure_) return;
  last_failure_ = why;
  log_(true, to_string(address_.id) + ": " + why);
}

pollfd RobotLink::poll() const {
  short events = connection_.poll_events();
  if (pending_) events = static_cast<short>(events | POLLOUT);
  return {.fd = connection_.fileno(), .events = events, .revents = 0};
}

}  // namespace regista::vision
