// SPDX-License-Identifier: Apache-2.0
#include "drive_group.hpp"

#include <algorithm>

namespace regista::can_motor {

using namespace std::chrono_literals;

namespace {

constexpr Duration up_limit = 1s;      // who asked waits for the answer, and may not wait for long
constexpr Duration enable_limit = 3s;  // brakes and pre-charging of the DC link take their time

}  // namespace

DriveGroup::DriveGroup(canopen::CanBus& bus, std::span<const canopen::NodeId> nodes, const DriveSettings& settings,
                       const std::vector<std::vector<canopen::SdoWrite>>& dcf, const Options& options, Events events)
    : options_{options},
      events_{std::move(events)},
      // Five beats of ours fit into the time after which a drive stops by itself.
      master_{bus,
              {.id = options.master, .heartbeat = 50ms, .bit_rate = options.bit_rate},
              {.node =
                   [this](canopen::NodeId node, canopen::NodeMonitor::Event event) {
                     if (DriveNode* drive = find(node)) drive->on_node(event, master_.now());
                   },
               .emcy =
                   [this](canopen::NodeId node, const canopen::Emcy& emcy) {
                     if (DriveNode* drive = find(node)) drive->on_emcy(emcy);
                   },
               .bus =
                   [this](canopen::BusState state) {
                     const std::string text = "CAN bus " + canopen::to_string(state);
                     if (state != canopen::BusState::off && state != canopen::BusState::down) {
                       return events_.tell(state == canopen::BusState::active ? 0 : 1, text);
                     }
                     broken_ = Error{std::errc::network_down, text};
                     trouble(text);
                   }}} {
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    drives_.emplace_back(
        master_, nodes[i], settings, dcf[i],
        DriveNode::Events{.trouble = [this](const std::string& reason) { trouble(reason); }, .tell = events_.tell});
  }
}

DriveNode* DriveGroup::find(canopen::NodeId node) {
  const auto found = std::ranges::find(drives_, node, &DriveNode::node);
  return found == drives_.end() ? nullptr : &*found;
}

void DriveGroup::on_frame(const canopen::CanFrame& frame, Time now) {
  master_.on_frame(frame, now);
  check_enabling(now);
}

void DriveGroup::on_time(Time now) {
  master_.on_time(now);
  for (DriveNode& drive : drives_) drive.on_time(now);
  check_enabling(now);
  if (now < send_at_) return;
  // On a grid without drift; what was missed is left out.
  send_at_ = now - send_at_ > options_.cycle ? now + options_.cycle : send_at_ + options_.cycle;
  send_all(now);
}

Time DriveGroup::next_wake() const {
  Time next = std::min(master_.next_wake(), send_at_);
  for (const DriveNode& drive : drives_) next = std::min(next, drive.next_wake());
  return mode_ == Mode::awaiting || mode_ == Mode::enabling ? std::min(next, enable_by_) : next;
}

void DriveGroup::send_all(Time now) {
  for (DriveNode& drive : drives_) drive.send(now);
}

void DriveGroup::trouble(const std::string& reason) {
  const bool moved = mode_ == Mode::enabling || mode_ == Mode::enabled;
  stop(reason, master_.now());
  if (moved) {
    events_.stopped(reason);
  } else {
    events_.tell(1, reason);
  }
}

void DriveGroup::stop(const std::string& reason, Time now) { stop(Error{std::errc::operation_canceled, reason}, now); }

void DriveGroup::stop(const Error& why, Time now) {
  stopped_because_ = why.what;
  mode_ = Mode::stopped;
  master_.discard_pdos();
  for (DriveNode& drive : drives_) drive.want(false);
  send_all(now);
  finish(why);
}

void DriveGroup::power_off(Time now) {
  stop(mode_ == Mode::stopped ? std::string{stopped_because_} : "the drives are off: ask for POWER 1", now);
}

void DriveGroup::finish(Result<> result) {
  if (const auto done = std::exchange(done_, {})) done(std::move(result));
}

void DriveGroup::enable(std::function<void(Result<>)> done, Time now) {
  if (mode_ == Mode::enabled) return done({});
  finish(Error{std::errc::operation_canceled, "asked again"});
  done_ = std::move(done);
  if (mode_ == Mode::enabling) return;
  mode_ = Mode::awaiting;
  enable_by_ = now + up_limit;
  check_enabling(now);
}

void DriveGroup::check_enabling(Time now) {
  if (mode_ == Mode::awaiting && std::ranges::all_of(drives_, &DriveNode::ready)) {
    for (const DriveNode& drive : drives_) {
      if (drive.unguarded().empty()) continue;
      return stop(Error{std::errc::operation_not_permitted, drive.unguarded()}, now);
    }
    mode_ = Mode::enabling;
    enable_by_ = now + enable_limit;
    for (DriveNode& drive : drives_) drive.want(true);
    send_all(now);
  }
  if (mode_ == Mode::enabling && std::ranges::all_of(drives_, &DriveNode::enabled)) {
    mode_ = Mode::enabled;
    return finish({});
  }
  if (now < enable_by_) return;
  if (mode_ == Mode::awaiting) {
    const auto late = std::ranges::find_if_not(drives_, &DriveNode::ready);
    return stop({std::errc::not_connected, "node " + std::to_string(late->node()) + ": " + late->describe()}, now);
  }
  if (mode_ != Mode::enabling) return;
  const auto late = std::ranges::find_if_not(drives_, &DriveNode::enabled);
  stop("node " + std::to_string(late->node()) + " stays in '" + late->describe() + "'", now);
}

Result<> DriveGroup::set_targets(std::span<const std::int32_t> targets, Time now) {
  if (mode_ != Mode::enabled) return Error{std::errc::operation_not_permitted, stopped_because_};
  for (std::size_t i = 0; i < drives_.size(); ++i) drives_[i].set_target(targets[i]);
  send_all(now);
  return {};
}

}  // namespace regista::can_motor
