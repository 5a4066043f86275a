// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/canopen/nmt.hpp>
#include <utility>

namespace regista::canopen {

std::string to_string(NmtCommand command) {
  switch (command) {
    case NmtCommand::start:
      return "start";
    case NmtCommand::stop:
      return "stop";
    case NmtCommand::pre_operational:
      return "pre-operational";
    case NmtCommand::reset_node:
      return "reset";
    case NmtCommand::reset_communication:
      return "reset-communication";
  }
  return "unknown";
}

std::string to_string(NmtState state) {
  switch (state) {
    case NmtState::boot_up:
      return "boot-up";
    case NmtState::stopped:
      return "stopped";
    case NmtState::operational:
      return "operational";
    case NmtState::pre_operational:
      return "pre-operational";
  }
  return "unknown";
}

CanFrame nmt_frame(NmtCommand command, NodeId node) {
  return make_frame(nmt_id, {static_cast<std::uint8_t>(command), node});
}

NodeMonitor::Event NodeMonitor::on_frame(const CanFrame& frame, Time now) {
  if (frame.id != heartbeat_id + node_ || frame.extended || frame.remote || frame.error || frame.size != 1) {
    return Event::none;
  }
  const auto state = static_cast<NmtState>(frame.data[0] & 0x7FU);
  const bool toggle = (frame.data[0] & 0x80U) != 0;
  if (state != NmtState::boot_up && state != NmtState::stopped && state != NmtState::operational &&
      state != NmtState::pre_operational) {
    return Event::none;
  }
  if (state == NmtState::boot_up) {
    // Supervision begins with the first heartbeat: a node that has just come up has perhaps not been told to send any.
    deadline_.reset();
    toggle_.reset();
    unanswered_ = 0;
    lost_ = false;
    last_heard_ = now;
    state_ = NmtState::pre_operational;  // by itself, right after the message
    return Event::boot_up;
  }
  if (options_.guard_time > Duration::zero()) {
    if (toggle_ && *toggle_ != toggle) return Event::none;  // an answer to nothing that we asked
    toggle_ = !toggle;
    unanswered_ = 0;
  }
  if (options_.heartbeat_timeout > Duration::zero()) deadline_ = now + options_.heartbeat_timeout;
  last_heard_ = now;
  const bool was_lost = std::exchange(lost_, false);
  const bool changed = state_ != state;
  state_ = state;
  if (was_lost) return Event::back;
  return changed ? Event::state_changed : Event::none;
}

NodeMonitor::Event NodeMonitor::on_time(Time now) {
  bool silent = deadline_ && now >= *deadline_;
  if (options_.guard_time > Duration::zero() && now >= ask_at_) {
    if (unanswered_ >= options_.life_time_factor) silent = true;
    unanswered_ = std::min(unanswered_ + 1, options_.life_time_factor);
    ask_ = true;
    ask_at_ = now + options_.guard_time;
  }
  if (!silent) return Event::none;
  deadline_.reset();
  if (std::exchange(lost_, true) || !last_heard_) return Event::none;
  return Event::lost;
}

Time NodeMonitor::next_wake() const {
  const Time guard = options_.guard_time > Duration::zero() ? ask_at_ : Time::max();
  return std::min(deadline_.value_or(Time::max()), guard);
}

std::optional<CanFrame> NodeMonitor::take_question() {
  if (!std::exchange(ask_, false)) return {};
  return CanFrame{.id = heartbeat_id + node_, .remote = true, .size = 1};
}

}  // namespace regista::canopen
