// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>

#include "drive_node.hpp"

namespace regista::can_motor {

/// The drives of one bus, and the master that leads them: all are enabled together, and the trouble of one stops all.
///
/// They are only ever enabled on request, with target 0. A target counts while all are enabled, the newest wins, and
/// nothing that was meant for before a stop is sent after it.
class DriveGroup final : public canopen::Station {
 public:
  struct Options {
    canopen::NodeId master = 127;
    int bit_rate = 0;                                ///< [bit/s], for the bus load only
    Duration cycle = std::chrono::milliseconds{20};  ///< between two set-points
  };
  struct Events {
    /// All have been told to stop.
    std::function<void(const std::string& reason)> stopped;
    std::function<void(std::uint8_t severity, const std::string& text)> tell;
  };

  /// The bus outlives the group. `dcf[i]` is written to `nodes[i]`.
  DriveGroup(canopen::CanBus& bus, std::span<const canopen::NodeId> nodes, const DriveSettings& settings,
             const std::vector<std::vector<canopen::SdoWrite>>& dcf, const Options& options, Events events);

  void on_frame(const canopen::CanFrame& frame, Time now) override;
  void on_time(Time now) override;
  [[nodiscard]] Time next_wake() const override;

  /// Resets faults and enables all, at rest, once all are up: they have a second for that, so that who opens them
  /// and asks at once need not ask again. `done` is called once: when all are enabled, or with the reason.
  void enable(std::function<void(Result<>)> done, Time now);
  /// A quick stop of all, then no voltage. `reason` is what commands are refused with.
  void stop(const std::string& reason, Time now);
  /// The same, because POWER 0 or the server says so; the reason of an earlier stop stays.
  void power_off(Time now);
  [[nodiscard]] bool enabled() const { return mode_ == Mode::enabled; }
  /// In the drives' own unit, one for each; sent at once. Fails with the reason of the last stop.
  Result<> set_targets(std::span<const std::int32_t> targets, Time now);

  /// The bus is gone: it has to be opened anew.
  [[nodiscard]] const std::optional<Error>& broken() const { return broken_; }
  [[nodiscard]] std::deque<DriveNode>& drives() { return drives_; }
  [[nodiscard]] const std::deque<DriveNode>& drives() const { return drives_; }
  canopen::Master& master() { return master_; }
  [[nodiscard]] const canopen::Master& master() const { return master_; }

 private:
  /// awaiting: that all are up; until then none is enabled.
  enum class Mode : std::uint8_t { stopped, awaiting, enabling, enabled };

  void stop(const Error& why, Time now);
  void trouble(const std::string& reason);
  void finish(Result<> result);
  void send_all(Time now);
  void check_enabling(Time now);
  DriveNode* find(canopen::NodeId node);

  Options options_;
  Events events_;
  canopen::Master master_;
  std::deque<DriveNode> drives_;
  Mode mode_ = Mode::stopped;
  std::string stopped_because_ = "the drives are off: ask for POWER 1";
  std::function<void(Result<>)> done_;
  Time enable_by_;
  Time send_at_;
  std::optional<Error> broken_;
};

}  // namespace regista::can_motor
