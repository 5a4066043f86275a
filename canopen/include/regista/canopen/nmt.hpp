// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/canopen/can_frame.hpp>

namespace regista::canopen {

/// Services of the NMT master, with the numbers that they have on the bus (CiA 301, 7.2.8.2).
enum class NmtCommand : std::uint8_t {
  start = 1,
  stop = 2,
  pre_operational = 128,
  reset_node = 129,
  reset_communication = 130,
};
std::string to_string(NmtCommand command);

/// States as a heartbeat tells them; `boot_up` is the message of a node that has just come up (CiA 301, 7.2.8.3).
enum class NmtState : std::uint8_t { boot_up = 0, stopped = 4, operational = 5, pre_operational = 127 };
std::string to_string(NmtState state);

/// To one node, or to all with 0.
CanFrame nmt_frame(NmtCommand command, NodeId node);

/// Identifiers of the pre-defined connection set (CiA 301, 7.3.5).
inline constexpr std::uint32_t nmt_id = 0x000, sync_id = 0x080, time_id = 0x100, heartbeat_id = 0x700;
inline constexpr std::uint32_t emcy_id = 0x080;  ///< plus the node id

/// Watches one node: by its heartbeat or by asking for its state (node guarding).
class NodeMonitor {
 public:
  struct Options {
    /// Without a heartbeat for so long the node counts as lost. 0: not watched by heartbeat.
    Duration heartbeat_timeout = std::chrono::milliseconds{250};
    /// Ask for the state so often, with a remote frame; 0: never. For nodes that have no heartbeat.
    Duration guard_time{};
    int life_time_factor = 3;  ///< unanswered questions until the node counts as lost
  };
  enum class Event : std::uint8_t { none, boot_up, state_changed, lost, back };

  NodeMonitor(NodeId node, const Options& options) : node_{node}, options_{options} {}

  /// Of the frames with the node's heartbeat id.
  Event on_frame(const CanFrame& frame, Time now);
  Event on_time(Time now);
  [[nodiscard]] Time next_wake() const;
  /// The question for the node's state, when it is due; asked once.
  std::optional<CanFrame> take_question();

  /// As the node told last; empty: never heard of it.
  [[nodiscard]] std::optional<NmtState> state() const { return state_; }
  [[nodiscard]] bool lost() const { return lost_; }
  [[nodiscard]] std::optional<Time> last_heard() const { return last_heard_; }
  [[nodiscard]] const Options& options() const { return options_; }

 private:
  NodeId node_;
  Options options_;
  std::optional<NmtState> state_;
  std::optional<Time> last_heard_;
  std::optional<bool> toggle_;    ///< that the next answer of a guarded node is to have
  std::optional<Time> deadline_;  ///< of the next heartbeat
  Time ask_at_ = Time::min();
  int unanswered_ = 0;
  bool ask_ = false;
  bool lost_ = false;
};

}  // namespace regista::canopen
