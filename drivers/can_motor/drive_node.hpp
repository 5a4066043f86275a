// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/canopen/cia402.hpp>
#include <regista/canopen/master.hpp>

#include "drive_profile.hpp"

namespace regista::can_motor {

/// One drive as its master sees it: brought up in the manner of CiA 302-2, then led through the states of CiA 402.
///
/// The way up: ask what it is, write target 0 and take the voltage away, check that it can do profile velocity, write
/// what differs from the DCF and from the settings, find a way in which it stops by itself when we die, map the PDOs,
/// start it. What fails is told once and tried again every second.
class DriveNode {
 public:
  struct Events {
    /// It cannot be relied on from now on: all have to stop.
    std::function<void(const std::string& reason)> trouble;
    std::function<void(std::uint8_t severity, const std::string& text)> tell;
  };

  DriveNode(canopen::Master& master, canopen::NodeId node, const DriveSettings& settings,
            std::vector<canopen::SdoWrite> dcf, Events events);
  DriveNode(const DriveNode&) = delete;
  DriveNode& operator=(const DriveNode&) = delete;

  void on_time(Time now);
  [[nodiscard]] Time next_wake() const;
  void on_node(canopen::NodeMonitor::Event event, Time now);
  void on_emcy(const canopen::Emcy& emcy);

  /// Towards operation enabled with target 0, resetting a fault that is there now; or a quick stop and then no voltage.
  void want(bool enabled);
  /// In the drive's unit; only while it is wanted enabled.
  void set_target(std::int32_t target) { target_ = target; }
  /// Sends controlword and target. Nothing while it is not up.
  void send(Time now);

  [[nodiscard]] canopen::NodeId node() const { return node_; }
  /// Up, and tells its state.
  [[nodiscard]] bool ready() const { return step_ == Step::up; }
  /// Why it must not be enabled, though it is up: nothing would stop it without us. Empty: it may.
  [[nodiscard]] const std::string& unguarded() const { return unguarded_; }
  [[nodiscard]] std::optional<canopen::Cia402State> state() const { return state_; }
  [[nodiscard]] bool enabled() const { return ready() && state_ == canopen::Cia402State::operation_enabled; }
  /// What it does, or what is awaited: "waits for an answer to 1000:00". For people.
  [[nodiscard]] std::string describe() const;

  [[nodiscard]] std::int32_t velocity() const { return velocity_; }
  /// Since it was made, in the drive's increments; only with `position` in the settings.
  [[nodiscard]] std::int64_t increments() const { return increments_; }
  /// Integral of velocity, in its unit times seconds.
  [[nodiscard]] double way() const { return way_; }
  [[nodiscard]] const Measured& measured() const { return measured_; }
  /// True once after each message with speed, and position if it has one.
  [[nodiscard]] bool take_fresh() { return std::exchange(fresh_, false); }
  [[nodiscard]] bool fresh() const { return fresh_; }

 private:
  enum class Step : std::uint8_t {
    resting,  ///< until it is tried again
    device_type,
    identity,
    target,
    rest,
    modes,
    rated_current,
    settings,
    mode_display,
    producer,
    consumer,
    option,
    option_readback,
    deadline,
    command,
    feedback,
    position,
    readings,
    starting,
    up,
  };

  void begin(Time now);
  void enter(Step step);
  void fail(const std::string& why);
  void fail(const Error& error);
  [[nodiscard]] std::string reason(const Error& error) const;
  void lose(const std::string& why);
  void read(canopen::ObjectIndex object, std::function<void(const Result<canopen::Bytes>&)> done);
  void configure(std::vector<canopen::SdoWrite> writes, std::function<void(const Result<>&)> done);
  void map(const canopen::PdoSettings& settings, std::function<void(const Result<>&)> done);
  void subscribe();
  void judge_guard();
  [[nodiscard]] canopen::PdoSettings transmitted(int number, canopen::PdoMapping mapping) const;
  [[nodiscard]] Duration feedback_limit() const;
  void on_feedback(canopen::ByteView bytes, Time now);
  [[nodiscard]] std::string title() const { return "node " + std::to_string(node_); }

  canopen::Master& master_;
  canopen::NodeId node_;
  const DriveSettings& settings_;
  std::vector<canopen::SdoWrite> dcf_;
  Events events_;
  canopen::PdoMapping command_map_;
  canopen::PdoMapping feedback_map_;
  std::size_t command_;
  std::vector<std::vector<Reading>> readings_;
  std::vector<canopen::PdoMapping> reading_maps_;

  Step step_ = Step::resting;
  std::uint32_t attempt_ = 0;  ///< answers to another one are not for us
  Time due_ = Time::min();     ///< of the next attempt, or the end of this step
  std::string failed_;         ///< why, the last time
  std::size_t reading_ = 0;

  bool watched_ = false;  ///< it has a heartbeat
  std::string unguarded_;
  std::string no_consumer_, no_option_, no_deadline_;  ///< why not; empty: it has

  bool wanted_ = false;
  bool may_reset_ = false;  ///< a fault that was there when it was asked for
  std::int32_t target_ = 0;
  std::optional<canopen::Cia402State> state_;
  std::int32_t velocity_ = 0;
  double way_ = 0;
  std::optional<std::int32_t> position_;
  std::int64_t increments_ = 0;
  std::optional<Time> heard_;  ///< the last feedback
  bool fresh_ = false;
  Measured measured_;
};

}  // namespace regista::can_motor
