// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <asio/executor_work_guard.hpp>
#include <asio/posix/stream_descriptor.hpp>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <regista/device/host.hpp>
#include <regista/server/server.hpp>

#include "connection_limiter.hpp"
#include "listener.hpp"
#include "plugins.hpp"
#include "session.hpp"

namespace regista {

/// The router: which driver a message is for, who is to have what a driver says. Everything here runs on the network
/// thread; drivers are reached through their links only.
class Server::Impl final : public SessionOwner {
 public:
  Impl(const ConfigFile& config, ServerOptions options);
  ~Impl() override;

  bool run();
  void stop();
  [[nodiscard]] std::uint16_t port() const;
  [[nodiscard]] std::vector<std::string> endpoints() const;

  std::function<void()> on_ready;
  std::function<void()> on_hang;

 private:
  struct Device {
    std::uint16_t tcp_port = 0;
    std::uint16_t interface = 0;
    std::uint16_t index = 0;
    auto operator<=>(const Device&) const = default;
  };
  struct PortNotes {
    Device device;
    std::vector<Session*> subscribers;
    double last_stamp_s = 0;                                    ///< of data: strictly increasing
    std::map<std::string, player::Motion, std::less<>> motion;  ///< by command group
    std::uint64_t commands_dropped = 0;  ///< of clients that had not subscribed, or to a full queue
  };
  struct Hosted {
    std::size_t number = 0;
    std::string name;
    std::unique_ptr<DriverHost> host;
    Link* link = nullptr;
    std::vector<PortNotes> ports;
    std::deque<Inbound> undelivered;  ///< must not be lost, and found the queue full
    std::optional<Time> hung_since;
    bool stops_by_itself = false;  ///< Plugin::stops_by_itself
    std::unique_ptr<HostThread> thread;
  };
  struct Target {
    std::size_t driver = 0;
    std::size_t port = 0;
  };

  // Set-up.
  void read_server_section(const Section& section, const ServerOptions& options);
  void make_driver(const Section& section);
  void join_required();
  /// 0: the default one, even when the name of a device says its number.
  [[nodiscard]] std::uint16_t listener_of(std::uint16_t port) const { return port == default_port_ ? 0 : port; }
  void join_remote(std::size_t consumer, const std::string& host, std::uint16_t port,
                   std::span<RequiredCore* const> required, SessionId& next_session);
  void listen(const Section& section, const ServerOptions& options);

  // Messages of clients.
  void on_message(Session& session, const xdr::Frame& frame) override;
  void on_end_of_input(Session& session) override;
  void on_closed(Session& session, const std::string& reason) override;
  void on_command(Session& session, const xdr::Frame& frame);
  void on_request(Session& session, const xdr::Frame& frame);
  void ask_server(Session& session, const xdr::Header& header, AnyRequest& request);
  void ask_driver(Session& session, const xdr::Header& header, const Target& target, AnyRequest&& request);
  bool answer_for_host(Session& session, const xdr::Header& header, const Target& target, const AnyRequest& request);
  void subscribe(Session& session, const xdr::Header& header, const player::Subscribe& request);
  [[nodiscard]] std::optional<Target> find(const Session& session, const player::DeviceAddress& address) const;

  // To clients.
  template <typename Body>
  void acknowledge(Session& session, const xdr::Header& header, const Body& body);
  void refuse(Session& session, const xdr::Header& header, const Error& error);
  template <typename Body>
  void send(Session& session, const xdr::Header& header, const Body& body);
  [[nodiscard]] xdr::Header reply_header(const Session& session, const xdr::Header& request, Kind kind) const;

  // From drivers.
  /// Take some of what the driver has put up. True: there may be more.
  bool drain(Hosted& hosted);
  void on_sample(Hosted& hosted, const Sample& sample);
  void on_reply(Hosted& hosted, Reply& reply);
  void on_notice(Hosted& hosted, Notice& notice);
  void wait_for_drivers();
  void tell(Session& session, const player::Motion& motion);
  void event(std::uint8_t severity, const std::string& text, const player::DeviceAddress& address = {});

  // To drivers.
  /// It learns whose requests these are.
  void introduce(const Session& session, Hosted& hosted);
  /// What must not be lost waits here when the driver's queue is full.
  void must_deliver(Hosted& hosted, Inbound&& inbound);
  void deliver_undelivered(Hosted& hosted);

  void accept(asio::ip::tcp::socket socket);
  void turn_away(asio::ip::tcp::socket socket, std::string_view banner, const std::string& why, Time now);
  void serve_metrics(asio::ip::tcp::socket socket);
  void housekeep();
  void check_sessions(Time now);
  void watch_wall_clock();
  void watch(Hosted& hosted, Time now);
  void begin_shutdown();
  void finish_shutdown_if_done();

  [[nodiscard]] nlohmann::ordered_json status(Time now) const;
  [[nodiscard]] std::string metrics(Time now) const;
  [[nodiscard]] double epoch_s(Time time) const { return epoch_offset_s_ + seconds(time.time_since_epoch()); }
  void log(LogLevel level, const std::string& text) const {
    if (options_.log) options_.log(level, text);
  }

  ServerOptions options_;
  Plugins plugins_;
  SessionLimits limits_;
  std::size_t max_clients_ = 2048;
  std::size_t max_pending_ = std::size_t{256} << 20;
  std::uint16_t default_port_ = 6665;
  Duration hang_exit_ = std::chrono::seconds{10};
  int realtime_ = 0;
  double epoch_offset_s_;

  asio::io_context io_{1};
  Wakeup wakeup_;  ///< drivers have put something up
  asio::posix::stream_descriptor wakeup_descriptor_{io_};
  asio::steady_timer housekeeping_{io_};
  std::vector<std::unique_ptr<Listener>> listeners_;
  std::unique_ptr<Listener> metrics_listener_;

  std::deque<Hosted> drivers_;
  std::map<Device, Target> devices_;
  std::map<SessionId, std::shared_ptr<Session>> sessions_;
  SessionId last_session_ = 0;
  std::uint64_t sessions_refused_ = 0;     ///< beyond max_clients
  std::uint64_t connections_refused_ = 0;  ///< that came too fast
  ConnectionLimiter connection_limiter_{20};
  Throttle refusals_{std::chrono::seconds{5}};
  std::uint64_t data_dropped_ = 0;  ///< by sessions that are gone
  Time started_{};
  Time watchdog_kicked_{};
  Time sessions_checked_{};
  std::optional<Duration> wall_offset_;  ///< of the wall clock from the monotonic one
  Throttle wall_clock_jumps_{std::chrono::seconds{5}};
  std::optional<Time> shutting_down_since_;
  bool all_stopped_ = false;
  AnyCommand command_;              ///< scratch, so that its memory is used again
  std::vector<std::byte> encoded_;  ///< scratch
  std::vector<std::byte>
      encoded_data_;  ///< scratch; its own, because delivering data may close a client, which is told
};

}  // namespace regista
