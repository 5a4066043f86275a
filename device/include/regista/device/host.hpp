// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <deque>
#include <map>
#include <regista/core/rate_limit.hpp>
#include <regista/device/driver.hpp>
#include <regista/device/motion.hpp>
#include <regista/device/plugin.hpp>
#include <set>
#include <thread>

namespace regista {

/// Counts how long things took, in buckets that grow by a factor √2 from 1 µs. One thread adds, any may read.
class Histogram {
 public:
  void add(Duration duration);
  /// Upper edge of the bucket that holds the given share of all; 0 when nothing was added.
  [[nodiscard]] Duration quantile(double share) const;
  [[nodiscard]] std::uint64_t count() const;

 private:
  std::array<std::atomic<std::uint64_t>, 48> buckets_{};
};

/// What a host counts. Written by the driver's thread, read by any.
struct HostMetrics {
  std::atomic<std::uint64_t> beats{0};
  std::atomic<std::uint64_t> beats_missed{0};
  std::atomic<std::uint64_t> faults{0};
  std::atomic<std::uint64_t> commands{0};
  std::atomic<std::uint64_t> commands_refused{0};
  std::atomic<std::uint64_t> commands_clamped{0};
  std::atomic<std::uint64_t> commands_replaced{0};  ///< by newer ones, before the driver was told
  std::atomic<std::uint64_t> requests{0};
  std::atomic<std::uint64_t> events_dropped{0};
  std::atomic<bool> open{false};
  Histogram jitter;  ///< how late beats were
};

struct HostOptions {
  double rate_hz = 50;
  bool always_on = false;
  std::int32_t priority = 10;          ///< with which the driver commands the devices that it requires
  std::vector<MotionPolicy> motion{};  ///< one for each port
};

/// Runs one driver: its beat, its messages, the rules of motion, and what happens when it fails. Everything that a
/// driver is spared is here.
///
/// Passive: `cycle()` does what is due and says when it wants to be called again. HostThread calls it on a thread of
/// its own; a test calls it with times that it made up.
class DriverHost {
 public:
  /// `setup` was given to the driver's constructor. `name`: the driver's, as the .cfg says it.
  DriverHost(std::string name, std::unique_ptr<Setup> setup, std::unique_ptr<Driver> driver, HostOptions options);
  ~DriverHost();
  DriverHost(const DriverHost&) = delete;
  DriverHost& operator=(const DriverHost&) = delete;

  // Before the first cycle.

  /// Join a user of this driver's devices; `woken` when something is put up. The first link is the network's: it is
  /// told events and motion.
  Link& add_link(const Wakeup* woken);
  /// The lane of a set-point in a link's down queue.
  [[nodiscard]] std::size_t lane(const Link& link, std::size_t port, const AnyCommand& command) const;

  // The driver's thread.

  /// Do what is due at `now`. When to call again at the latest, unless a message or a descriptor comes first.
  Time cycle(Time now, bool descriptor_ready = false);
  /// Bring everything to rest, tell why, and close.
  void shut_down(Time now);
  /// The other end of one of its descriptors is gone, and read() left it so: a fault.
  void descriptor_left_dead(int descriptor);
  /// Wake everybody who is joined.
  void notify_users() const;
  [[nodiscard]] std::span<const int> descriptors() const;

  // Any thread.

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] const Section& config() const { return setup_->config; }
  [[nodiscard]] const Wakeup& wakeup() const { return wakeup_; }
  [[nodiscard]] const HostMetrics& metrics() const { return metrics_; }
  [[nodiscard]] double rate_hz() const { return options_.rate_hz; }
  [[nodiscard]] std::int32_t priority() const { return options_.priority; }
  /// Since when a call of the driver has not returned; nothing when it is not in one. open() does not count: it may
  /// take its time.
  [[nodiscard]] std::optional<Time> busy_since() const;
  /// The driver hangs: stop its hardware by the way around it, and treat it as failed when it returns.
  /// False: it has no such way.
  bool give_up();

  /// The devices; not to be changed once the host runs.
  [[nodiscard]] std::deque<PortCore>& ports() { return setup_->ports; }
  [[nodiscard]] std::deque<RequiredCore>& required() { return setup_->required; }

 private:
  struct PortState {
    std::vector<MotionGroup> groups;
    std::array<std::uint8_t, AnyCommand::size> group_of{};  ///< index into groups
    std::set<std::pair<Link*, SessionId>> subscribers;
    Throttle refusals{std::chrono::seconds{5}};
  };
  struct Channel {
    Link link;
    std::vector<std::array<std::size_t, AnyCommand::size>> command_lanes;  ///< by port
    std::deque<Outbound> backlog;  ///< replies and events that found the queue full
    bool dirty = false;
  };

  void process(Channel& channel, Inbound& inbound);
  void process_command(Channel& channel, Inbound& inbound);
  void process_request(Channel& channel, Inbound& inbound);
  Result<AnyReply> subscribe(Channel& channel, const Inbound& inbound, const player::Subscribe& request);
  Result<AnyReply> property(const AnyRequest& request);
  void gone(Channel& channel, SessionId session);
  void receive(RequiredCore& device);
  void attend(RequiredCore& device, bool open);
  Result<> call_handler(PortCore& port, const AnyCommand& command);
  void tell_driver(PortState& state, PortCore& port);
  void run_motion();
  void beat();
  void warn_of_flood();
  Result<> try_open();
  void close_if_unused();
  void fault(const std::string& what);
  void put(Channel& channel, Outbound&& item);
  void broadcast(std::size_t port, std::uint8_t severity, const std::string& text);
  void publish_changed_motion();
  void refuse(std::size_t port, const Error& error);
  [[nodiscard]] std::string title(const PortCore& port) const;
  [[nodiscard]] const Identity& identity(SessionId session) const;
  [[nodiscard]] bool wanted() const;

  /// Call into the driver; what it throws is a fault. False: there was one.
  template <typename Call>
  bool survives(std::string_view what, Call&& call);

  /// Call into the driver, with the watchdog looking.
  template <typename Call>
  void watched(Call&& call);
  void halt();

  std::string name_;
  HostOptions options_;
  Duration period_{};

  Wakeup wakeup_;
  std::deque<Channel> channels_;
  std::vector<PortState> states_;
  std::map<SessionId, Identity> identities_;
  HostMetrics metrics_;

  Time now_{};
  Time next_beat_ = Time::max();
  Time last_read_{};
  Throttle missed_deadlines_{std::chrono::seconds{5}};
  std::optional<Time> flood_told_;
  Time flood_since_{};               ///< when there were `flood_counted_` replaced commands
  std::uint64_t flood_counted_ = 0;  ///< in all
  Time retry_at_ = Time::min();
  Duration back_off_{};
  bool open_ = false;
  bool just_opened_ = false;
  bool faulted_ = false;
  std::string fault_text_;
  std::atomic<Time::rep> busy_since_{0};
  std::atomic<bool> given_up_{false};

  // Last, and so destroyed first: responders in them answer when they go.
  std::unique_ptr<Setup> setup_;
  std::unique_ptr<Driver> driver_;
};

/// Let `required`, a device that the driver of `consumer` stands on, be the provider's port number `port`. Once each,
/// after the network's link was added and before either host's first cycle. Neither host may be destroyed while the
/// other one's thread runs.
void join(DriverHost& consumer, RequiredCore& required, DriverHost& provider, std::size_t port, SessionId session);

/// Gives a host a thread and its wake-ups: messages, descriptors, the beat.
class HostThread {
 public:
  /// `realtime_priority`: 1 to 99 asks for SCHED_FIFO, 0 does not.
  explicit HostThread(DriverHost& host, int realtime_priority = 0);
  /// Brings the driver to rest and joins the thread.
  ~HostThread();
  /// Begin to come to rest; the destructor waits for it.
  void request_stop();
  /// The driver has come to rest and was closed.
  [[nodiscard]] bool stopped() const { return stopped_.load(std::memory_order_acquire); }

 private:
  void run();
  DriverHost& host_;
  int realtime_priority_;
  std::atomic<bool> stop_{false};
  std::atomic<bool> stopped_{false};
  std::thread thread_;
};

}  // namespace regista
