// SPDX-License-Identifier: Apache-2.0
// A server's life: it starts its drivers, accepts clients, keeps house, and comes to rest.
#include <algorithm>
#include <asio/post.hpp>

#include "impl.hpp"
#include "notify.hpp"

namespace regista {

namespace {

using namespace std::chrono_literals;

// Leases and hung drivers are noticed within so much.
constexpr Duration tick = 10ms;
// Sessions have time-outs of seconds; to look after a thousand of them on each tick would cost more than a microsecond
// for each message at 10 Hz.
constexpr Duration session_tick = 50ms;
constexpr Duration longest_shutdown = 1900ms;
constexpr int beats_until_hung = 5;
constexpr Duration least_hang = 50ms;

}  // namespace

bool Server::Impl::run() {
  started_ = Clock::now();
  wakeup_descriptor_.assign(::dup(wakeup_.descriptor()));
  wait_for_drivers();
  for (Hosted& hosted : drivers_) {
    const bool moves = std::ranges::any_of(hosted.host->ports(), [](const PortCore& port) {
      return std::ranges::any_of(port.commands, [](const auto& handler) { return static_cast<bool>(handler); });
    });
    if (moves && !hosted.stops_by_itself) {
      log(LogLevel::warning,
          "driver \"" + hosted.name +
              "\" has no hardware watchdog: if this server is killed, what it drives is not stopped");
    }
    hosted.thread = std::make_unique<HostThread>(*hosted.host, realtime_);
  }
  for (const auto& listener : listeners_) {
    const std::string endpoint = listener->endpoint();
    if (!endpoint.starts_with("127.") && !endpoint.starts_with("[::1]")) {
      log(LogLevel::warning, "listening on " + endpoint + ": whoever reaches it may drive; there is no authentication");
    }
    listener->start();
  }
  if (metrics_listener_) {
    metrics_listener_->start();
    log(LogLevel::info, "metrics on http://" + metrics_listener_->endpoint() + "/metrics");
  }
  housekeep();
  asio::post(io_, [this] {
    notify_service_manager("READY=1");
    if (on_ready) on_ready();
  });
  io_.run();
  return all_stopped_;
}

void Server::Impl::stop() {
  asio::post(io_, [this] { begin_shutdown(); });
}

void Server::Impl::accept(asio::ip::tcp::socket socket) {
  asio::error_code error;
  const auto remote = socket.remote_endpoint(error);
  if (error) return;  // gone already
  const Time now = Clock::now();
  if (!connection_limiter_.admit(remote.address(), now)) {
    ++connections_refused_;
    return turn_away(std::move(socket), "Player v. refused: too often",
                     "more than " + std::to_string(connection_limiter_.rate()) + " connections a second", now);
  }
  if (sessions_.size() >= max_clients_) {
    ++sessions_refused_;
    return turn_away(std::move(socket), "Player v. refused: max_clients",
                     "max_clients " + std::to_string(max_clients_) + " reached", now);
  }
  while (last_session_ + 1 >= first_driver_session || sessions_.contains(last_session_ + 1) || last_session_ + 1 == 0) {
    last_session_ = (last_session_ + 1) % first_driver_session;
  }
  const SessionId id = ++last_session_;
  const auto session = std::make_shared<Session>(*this, id, std::move(socket), limits_);
  sessions_.emplace(id, session);
  std::array<char, xdr::banner_size> banner{};
  constexpr std::string_view text = "Player v.3.1.0 (regista " REGISTA_VERSION ")";
  static_assert(text.size() < banner.size());
  std::ranges::copy(text, banner.begin());
  session->start({banner.data(), banner.size()});
}

void Server::Impl::turn_away(asio::ip::tcp::socket socket, std::string_view banner, const std::string& why, Time now) {
  asio::error_code error;
  std::array<char, xdr::banner_size> refusal{};
  std::ranges::copy(banner, refusal.begin());
  if (const auto untold = refusals_.admit(now)) {
    log(LogLevel::warning, "client " + socket.remote_endpoint(error).address().to_string() + " refused: " + why +
                               (*untold > 0 ? " (" + std::to_string(*untold) + " more before)" : ""));
  }
  socket.non_blocking(true, error);
  socket.write_some(asio::buffer(refusal), error);
}

void Server::Impl::housekeep() {
  const Time now = Clock::now();
  if (now - sessions_checked_ > session_tick) {
    sessions_checked_ = now;
    check_sessions(now);
    watch_wall_clock();
  }
  for (Hosted& hosted : drivers_) {
    deliver_undelivered(hosted);
    watch(hosted, now);
  }
  if (now - watchdog_kicked_ > 500ms) {
    watchdog_kicked_ = now;
    notify_service_manager("WATCHDOG=1");
  }
  if (shutting_down_since_ && now - *shutting_down_since_ > longest_shutdown) {
    for (const Hosted& hosted : drivers_) {
      if (!hosted.thread->stopped()) log(LogLevel::error, "driver \"" + hosted.name + "\" did not come to rest");
    }
    io_.stop();
    return;
  }
  housekeeping_.expires_after(tick);
  housekeeping_.async_wait([this](const asio::error_code& error) {
    if (!error) housekeep();
  });
}

void Server::Impl::check_sessions(Time now) {
  std::size_t pending = 0;
  std::shared_ptr<Session> largest;
  std::vector<std::shared_ptr<Session>> all;
  for (const auto& [id, session] : sessions_) all.push_back(session);
  for (const auto& session : all) {
    session->check(now);
    if (session->closed()) continue;
    pending += session->pending_bytes();
    if (largest == nullptr || session->pending_bytes() > largest->pending_bytes()) largest = session;
  }
  if (pending > max_pending_)
    largest->close("the server holds " + std::to_string(pending >> 20) +
                   " MiB for clients (max_pending), most for this one");
}

void Server::Impl::watch_wall_clock() {
  const Time before = Clock::now();
  const auto wall = std::chrono::system_clock::now().time_since_epoch();
  const Time after = Clock::now();
  if (after - before > 1ms) return;  // interrupted between the two
  const Duration offset = wall - before.time_since_epoch();
  const Duration jump = offset - std::exchange(wall_offset_, offset).value_or(offset);
  constexpr Duration least_jump = 100ms;  // what is less is slewed, by half a millisecond a second
  if (std::chrono::abs(jump) < least_jump) return;
  if (const auto untold = wall_clock_jumps_.admit(after)) {
    event(1, "the wall clock jumped " + std::to_string(std::chrono::abs(jump) / 1ms) +
                 (jump > Duration{} ? " ms ahead" : " ms back") +
                 (*untold > 0 ? " (" + std::to_string(*untold) + " more before)" : "") +
                 "; leases, time-outs and the stamps of data follow the monotonic clock");
  }
}

void Server::Impl::watch(Hosted& hosted, Time now) {
  const std::optional<Time> since = hosted.host->busy_since();
  if (!since) {
    hosted.hung_since.reset();
    return;
  }
  const Duration period = hosted.host->rate_hz() > 0 ? from_seconds(1 / hosted.host->rate_hz()) : Duration{};
  const Duration limit = std::max<Duration>(beats_until_hung * period, least_hang);
  if (!hosted.hung_since && now - *since > limit) {
    hosted.hung_since = since;
    const bool stopped = hosted.host->give_up();
    event(2, "driver \"" + hosted.name + "\" did not return for " + std::to_string((now - *since) / 1ms) + " ms" +
                 (stopped ? "; its hardware was stopped" : "; it has no way to be stopped from outside"));
    for (PortNotes& port : hosted.ports) {
      for (auto& [group, motion] : port.motion) {
        motion.state = player::MotionState::fault;
        motion.reason = "driver \"" + hosted.name + "\" did not return";
      }
    }
  }
  if (hosted.hung_since && now - *since > hang_exit_ && on_hang) on_hang();
}

void Server::Impl::begin_shutdown() {
  if (shutting_down_since_) return;
  shutting_down_since_ = Clock::now();
  notify_service_manager("STOPPING=1");
  for (Hosted& hosted : drivers_) hosted.thread->request_stop();
  event(0, "server shutting down");
  for (const auto& listener : listeners_) listener->stop();
  if (metrics_listener_) metrics_listener_->stop();
  finish_shutdown_if_done();
}

void Server::Impl::finish_shutdown_if_done() {
  if (!shutting_down_since_ || all_stopped_) return;
  if (!std::ranges::all_of(drivers_, [](const Hosted& hosted) { return hosted.thread->stopped(); })) return;
  all_stopped_ = true;
  for (Hosted& hosted : drivers_) {
    while (drain(hosted)) {
    }
  }
  std::vector<std::shared_ptr<Session>> all;
  for (const auto& [id, session] : sessions_) all.push_back(session);
  for (const auto& session : all) session->close("");
  io_.stop();
}

}  // namespace regista
