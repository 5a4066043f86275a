// SPDX-License-Identifier: Apache-2.0
// What people and tools can see of a running server.
#include <asio/read_until.hpp>
#include <asio/write.hpp>
#include <nlohmann/json.hpp>
#include <regista/metrics/prometheus.hpp>

#include "impl.hpp"

namespace regista {

namespace {

using nlohmann::ordered_json;

double microseconds(Duration duration) { return 1e6 * seconds(duration); }

}  // namespace

ordered_json Server::Impl::status(Time now) const {
  ordered_json clients = ordered_json::array();
  std::uint64_t dropped = data_dropped_;
  for (const auto& [id, session] : sessions_) {
    dropped += session->data_dropped;
    clients.push_back({{"id", id},
                       {"name", session->name},
                       {"peer", session->peer()},
                       {"priority", session->priority},
                       {"extended", session->extended},
                       {"mode", session->pull() ? "pull" : "push"},
                       {"devices", session->opened.size()},
                       {"pending_bytes", session->pending_bytes()},
                       {"messages_in", session->messages_in},
                       {"messages_refused", session->messages_refused},
                       {"messages_out", session->messages_out},
                       {"data_dropped", session->data_dropped}});
  }
  ordered_json drivers = ordered_json::array();
  for (const Hosted& hosted : drivers_) {
    const HostMetrics& metrics = hosted.host->metrics();
    ordered_json devices = ordered_json::array();
    for (const PortNotes& port : hosted.ports) {
      if (port.device.tcp_port == 0) continue;
      ordered_json groups = ordered_json::array();
      constexpr std::array<const char*, 4> states{"stopped", "driving", "stopping", "fault"};
      for (const auto& [name, motion] : port.motion) {
        groups.push_back({{"group", name},
                          {"state", states[static_cast<std::size_t>(motion.state)]},
                          {"owner", motion.owner.view()},
                          {"owner_priority", motion.priority},
                          {"lease_s", motion.lease_s},
                          {"reason", motion.reason.view()}});
      }
      devices.push_back(
          {{"device", std::string{interface_name(port.device.interface)} + ':' + std::to_string(port.device.index)},
           {"tcp_port", port.device.tcp_port},
           {"subscribers", port.subscribers.size()},
           {"commands_dropped", port.commands_dropped},
           {"motion", std::move(groups)}});
    }
    drivers.push_back({{"name", hosted.name},
                       {"open", metrics.open.load()},
                       {"hung", hosted.hung_since.has_value()},
                       {"rate_hz", hosted.host->rate_hz()},
                       {"beats", metrics.beats.load()},
                       {"beats_missed", metrics.beats_missed.load()},
                       {"jitter_us",
                        {{"p50", microseconds(metrics.jitter.quantile(0.5))},
                         {"p99", microseconds(metrics.jitter.quantile(0.99))},
                         {"max", microseconds(metrics.jitter.quantile(1.0))}}},
                       {"faults", metrics.faults.load()},
                       {"commands", metrics.commands.load()},
                       {"commands_refused", metrics.commands_refused.load()},
                       {"commands_clamped", metrics.commands_clamped.load()},
                       {"commands_replaced", metrics.commands_replaced.load() + hosted.link->down.replaced()},
                       {"requests", metrics.requests.load()},
                       {"queues",
                        {{"down", hosted.link->down.size()},
                         {"down_replaced", hosted.link->down.replaced()},
                         {"down_refused", hosted.link->down.refused()},
                         {"up", hosted.link->up.size()},
                         {"up_replaced", hosted.link->up.replaced()}}},
                       {"devices", std::move(devices)}});
  }
  return {{"version", REGISTA_VERSION},
          {"uptime_s", seconds(now - started_)},
          {"clients_refused", sessions_refused_},
          {"connections_refused", connections_refused_},
          {"data_dropped", dropped},
          {"clients", std::move(clients)},
          {"drivers", std::move(drivers)}};
}

std::string Server::Impl::metrics(Time now) const { return prometheus_text("regista", status(now).dump()); }

void Server::Impl::serve_metrics(asio::ip::tcp::socket socket) {
  // One answer to whatever is asked; HTTP/1.0 (RFC 1945) is enough for a scraper.
  const auto connection = std::make_shared<asio::ip::tcp::socket>(std::move(socket));
  const auto request = std::make_shared<std::string>();
  constexpr std::size_t longest_request = 4096;
  asio::async_read_until(*connection, asio::dynamic_buffer(*request, longest_request), "\r\n\r\n",
                         [this, connection, request](const asio::error_code& error, std::size_t) {
                           if (error) return;
                           const std::string body = metrics(Clock::now());
                           const auto answer = std::make_shared<std::string>(
                               "HTTP/1.0 200 OK\r\nContent-Type: text/plain; version=0.0.4\r\nContent-Length: " +
                               std::to_string(body.size()) + "\r\n\r\n" + body);
                           asio::async_write(*connection, asio::buffer(*answer),
                                             [connection, answer](const asio::error_code&, std::size_t) {});
                         });
}

}  // namespace regista
