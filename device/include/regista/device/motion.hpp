// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <regista/core/result.hpp>
#include <regista/core/time.hpp>
#include <regista/device/config.hpp>
#include <regista/device/link.hpp>
#include <string>

namespace regista {

/// What the `.cfg` says of a device's motion. Limits are infinite unless set.
struct MotionPolicy {
  Duration lease = std::chrono::milliseconds{500};  ///< silence for so long stops the device
  bool sensor = false;                              ///< its commands are measurements: no lease, owner, limits or stop
  bool outlives_owner = false;                      ///< a destination stays valid when its owner has gone
  double max_speed = std::numeric_limits<double>::infinity();              ///< [m/s], of an actuator also [rad/s]
  double max_turn = std::numeric_limits<double>::infinity();               ///< [rad/s]
  double max_acceleration = std::numeric_limits<double>::infinity();       ///< [m/s²]
  double max_turn_acceleration = std::numeric_limits<double>::infinity();  ///< [rad/s²]
  double ramp = std::numeric_limits<double>::infinity();                   ///< [m/s²], of a stop
  double turn_ramp = std::numeric_limits<double>::infinity();              ///< [rad/s²], of a stop

  /// The keys of a driver's section. Throws ConfigError.
  static MotionPolicy read(const Section& config);
};

/// What a change of motion is called: for the log, the events and the state that everybody can read.
using Tell = std::function<void(std::uint8_t severity, const std::string& text)>;

/// The arbiter of one command group of one device: who may move it, how fast, and when it must stand. All rules about
/// motion are here. Passive: time comes in, commands for the driver go out. One thread at a time.
class MotionGroup {
 public:
  /// `device`: how texts name it, "position2d:0". `group`: of its commands.
  MotionGroup(std::string device, std::string group, const MotionPolicy& policy);

  /// A command of `session`. Taken: it is what the driver is to do from now on, within the limits. Refused: not finite,
  /// out of date, or the group is somebody else's.
  Result<> command(SessionId session, const Identity& who, const AnyCommand& command, Time arrived, Time now);
  /// Take over from an owner of at most the same priority. The device comes to rest first, unless `blend`.
  Result<> take(SessionId session, const Identity& who, bool blend, Time now);
  void release(SessionId session, Time now);
  void gone(SessionId session, Time now);
  void keep_alive(SessionId session, Time arrived);
  /// Bring the device to rest, whoever drives it. Nobody but `by` moves it again before everybody has paused for a
  /// lease, or somebody takes it: else whoever streams commands would undo the stop. `reason` follows "stopped: ".
  void stop(SessionId by, const std::string& reason, Time now);
  /// The driver did not take what step() returned. A destination is given up then, for nothing follows it that could be
  /// taken; the owner stays, and may send it again. `reason`: why.
  void refused(const std::string& reason, Time now);
  /// The driver was halted: nothing moves any more, nobody owns it.
  void halted(const std::string& reason, bool fault);
  /// The driver works again.
  void recovered();

  /// What to tell the driver now; null: nothing new. Valid until the next call.
  /// `measured`: what the device does, where a stop ramps from when no set-point says so.
  const AnyCommand* step(Time now, const Measured& measured);
  /// Whether the driver must first be told what waits: `command` is for another joint, and would take its place.
  [[nodiscard]] bool displaces(const AnyCommand& command) const;
  /// `halt()` is needed: a stop of something that no set-point can stop.
  bool take_halt_request() { return std::exchange(halt_requested_, false); }

  /// When step() is due again by itself: a lease that runs out, or the next beat of a ramp. Time::max(): never.
  [[nodiscard]] Time due(Time next_beat) const;

  [[nodiscard]] player::Motion status() const;
  /// True once after the status has changed.
  bool take_changed() { return std::exchange(changed_, false); }
  void on_tell(Tell tell) { tell_ = std::move(tell); }
  [[nodiscard]] const std::string& group() const { return group_; }
  /// How many commands were limited since the last call.
  std::uint64_t take_clamped() { return std::exchange(clamped_, 0); }
  /// How many set-points were replaced by newer ones before the driver was told, since the last call.
  std::uint64_t take_replaced() { return std::exchange(replaced_, 0); }
  [[nodiscard]] bool driving() const { return state_ == player::MotionState::driving; }

 private:
  struct Owner {
    SessionId session = 0;
    Identity who;
  };

  void begin_stop(std::string reason, bool keep_owner, Time now);
  void come_to_rest(std::string reason, Time now);
  void stand(Time now);
  void clamp(AnyCommand& command);
  [[nodiscard]] Error owned_by_other() const;
  [[nodiscard]] bool destination() const;
  [[nodiscard]] bool lapses() const;

  std::string device_;
  std::string group_;
  MotionPolicy policy_;
  Tell tell_;

  player::MotionState state_ = player::MotionState::stopped;
  std::string reason_ = "no command yet";
  std::optional<Owner> owner_;
  SessionId displaced_ = 0;                ///< may not resume before it paused; `everybody` after a stop
  SessionId stopped_by_ = 0;               ///< who may resume although everybody is displaced: who stopped it
  Time displaced_heard_{};                 ///< its last attempt
  Time heard_{};                           ///< arrival of the owner's last command or keep-alive
  Time stepped_{};                         ///< the last step of a ramp
  AnyCommand target_;                      ///< what the owner wants
  AnyCommand output_;                      ///< what the driver was told last
  bool pending_ = false;                   ///< target_ is to be told
  std::optional<AnyCommand> next_output_;  ///< where the next step starts from
  bool taken_over_ = false;                ///< comes to rest for a new owner
  bool queued_ = false;                    ///< whose target_ is to be told then
  bool halt_requested_ = false;
  bool changed_ = true;
  bool untold_ = false;  ///< target_ is new
  std::uint64_t clamped_ = 0;
  std::uint64_t replaced_ = 0;
};

}  // namespace regista
