// SPDX-License-Identifier: Apache-2.0
// What it costs to tell many, and who is told late: the server beside a loop of one send() per message in the same run.
#include <sys/epoll.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <thread>

#include "socket_bench.hpp"

namespace regista::bench {
namespace {

using namespace std::chrono_literals;

/// The clock of data stamps: the wall clock asked once, then the steady one.
double epoch_s(Time time) {
  static const double offset_s =
      std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count() -
      seconds(Clock::now().time_since_epoch());
  return offset_s + seconds(time.time_since_epoch());
}

/// Waits like a beat: for a point in time, not for a while.
void sleep_until(Time time) {
  const Duration since = time.time_since_epoch();
  const timespec until{.tv_sec = since / 1s, .tv_nsec = (since % 1s).count()};
  ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
}

/// The baseline, a process of its own: a position2d state to each of its peers on each beat, by one send() each.
Child start_raw_loop(const Descriptor& listener, std::size_t peers, double rate_hz) {
  const pid_t pid = ::fork();
  if (pid < 0) throw std::runtime_error{"fork"};
  if (pid > 0) return Child{pid};
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  ::prctl(PR_SET_TIMERSLACK, 1);
  std::vector<Descriptor> sockets;
  for (std::size_t i = 0; i < peers; ++i) sockets.push_back(accept_from(listener));
  std::array<std::byte, 256> bytes;
  for (Time beat = Clock::now();; beat += from_seconds(1 / rate_hz)) {
    sleep_until(beat);
    const xdr::Header header{
        .address = position2d_address(0), .kind = Kind::data, .subtype = 1, .timestamp_s = epoch_s(Clock::now())};
    const std::size_t size = xdr::encode_message(header, position2d::State{}, bytes);
    for (const Descriptor& socket : sockets) ::send(socket.get(), bytes.data(), size, MSG_DONTWAIT | MSG_NOSIGNAL);
  }
}

struct Received {
  std::uint64_t bytes = 0;
  std::vector<double> ages_us;  ///< a message each; sorted
};

/// Reads what all have to say, for so long.
Received receive(std::vector<Client>& clients, Duration how_long) {
  const Descriptor epoll{::epoll_create1(EPOLL_CLOEXEC)};
  for (Client& client : clients) {
    epoll_event event{.events = EPOLLIN, .data = {.ptr = &client}};
    ::epoll_ctl(epoll.get(), EPOLL_CTL_ADD, client.socket().get(), &event);
  }
  Received received;
  std::array<epoll_event, 64> events;
  for (const Time end = Clock::now() + how_long; Clock::now() < end;) {
    const int ready = ::epoll_wait(epoll.get(), events.data(), static_cast<int>(events.size()), 10);
    for (int i = 0; i < ready; ++i) {
      Client& client = *static_cast<Client*>(events[static_cast<std::size_t>(i)].data.ptr);
      const std::span<std::byte> space = client.framer().space();
      const ssize_t size = ::recv(client.socket().get(), space.data(), space.size(), MSG_DONTWAIT);
      if (size == 0) throw std::runtime_error{"a subscriber was disconnected"};
      if (size < 0) continue;
      const double now_s = epoch_s(Clock::now());
      received.bytes += static_cast<std::uint64_t>(size);
      client.framer().commit(static_cast<std::size_t>(size));
      for (auto frame = client.framer().next(); frame && *frame; frame = client.framer().next()) {
        if ((*frame)->header.kind == Kind::data)
          received.ages_us.push_back(1e6 * (now_s - (*frame)->header.timestamp_s));
      }
    }
  }
  std::ranges::sort(received.ages_us);
  return received;
}

struct Load {
  std::size_t subscribers;
  double rate_hz;
  std::int32_t coalesce_ms = 0;
};

struct Measured {
  std::vector<double> delivered_share;
  std::vector<double> age_p50_us;
  std::vector<double> age_p99_us;
  std::vector<double> cpu_us;  ///< of the sender, for each message that arrived
};

void measure(Measured& measured, const Child& sender, std::vector<Client>& clients, const Load& load,
             Duration how_long) {
  receive(clients, how_long / 10);  // what gathered while they subscribed
  const Duration before = sender.cpu_time();
  const Received received = receive(clients, how_long);
  const auto messages = static_cast<double>(received.ages_us.size());
  measured.cpu_us.push_back(1e6 * seconds(sender.cpu_time() - before) / messages);
  measured.delivered_share.push_back(messages /
                                     (static_cast<double>(load.subscribers) * load.rate_hz * seconds(how_long)));
  measured.age_p50_us.push_back(quantile(received.ages_us, 0.5));
  measured.age_p99_us.push_back(quantile(received.ages_us, 0.99));
}

double median(std::vector<double> values) {
  std::ranges::sort(values);
  return quantile(values, 0.5);
}

std::string base(double rate_hz, int samples = 1) {
  return "driver (name \"fake_base\" provides [\"position2d:0\"] rate " + std::to_string(rate_hz) + " samples " +
         std::to_string(samples) + ")\n";
}

std::vector<Client> subscribers(std::uint16_t port, std::size_t count, std::int32_t coalesce_ms = 0,
                                int receive_buffer = 0) {
  std::vector<Client> clients;
  for (std::size_t i = 0; i < count; ++i) {
    Client& client = clients.emplace_back(port, true, receive_buffer);
    if (coalesce_ms > 0) {
      client.request(server_address, property::SetInt{.key = Text{"coalesce_ms"}, .value = coalesce_ms});
    }
    client.subscribe(position2d_address(0));
  }
  return clients;
}

std::uint64_t dropped(std::uint16_t port) { return Client{port}.status().at("data_dropped").get<std::uint64_t>(); }

void fan_out(Report& report, const Load& load, bool quick) {
  const int times = quick ? 1 : 5;
  const Duration how_long = quick ? 200ms : 2s;
  std::array<Measured, 2> measured;  // raw, server
  std::uint64_t drops = 0;
  for (int i = 0; i < times; ++i) {  // in turn, so that a change of the machine's speed meets both alike
    {
      std::uint16_t port = 0;
      const Descriptor listener = listen_anywhere(port);
      const Child raw = start_raw_loop(listener, load.subscribers, load.rate_hz);
      std::vector<Client> clients;
      for (std::size_t k = 0; k < load.subscribers; ++k) clients.emplace_back(connect_to(port));
      measure(measured[0], raw, clients, load, how_long);
    }
    const ServerProcess server = start_server(base(load.rate_hz));
    std::vector<Client> clients = subscribers(server.port, load.subscribers, load.coalesce_ms);
    measure(measured[1], server.child, clients, load, how_long);
    drops += dropped(server.port);
  }
  std::array<char, 64> name{};
  std::snprintf(name.data(), name.size(), "%zu x %.0f Hz", load.subscribers, load.rate_hz);
  if (load.coalesce_ms > 0)
    std::snprintf(name.data(), name.size(), "%zu x %.0f Hz, coalesce %d ms", load.subscribers, load.rate_hz,
                  load.coalesce_ms);
  const auto add = [&](const std::string& what, const Measured& m, std::uint64_t dropped_by_it) {
    report.add("Fan-out: one position2d state to each subscriber; medians of " + std::to_string(times) + " runs",
               {{"what", what},
                {"delivered %", 100 * median(m.delivered_share)},
                {"dropped", dropped_by_it},
                {"age p50 us", median(m.age_p50_us)},
                {"age p99 us", median(m.age_p99_us)},
                {"CPU us/msg", median(m.cpu_us)},
                {"CPU / raw", median(m.cpu_us) / median(measured[0].cpu_us)}});
  };
  add(std::string{name.data()} + ": raw", measured[0], 0);
  add(std::string{name.data()} + ": server", measured[1], drops);
}

/// Round trips of commands at 20 Hz, beside what else goes on.
std::vector<double> command_at_20_hz(Client& client, Duration how_long) {
  std::vector<double> times_us;
  double velocity = 0;
  Time due = Clock::now();
  for (const Time end = due + how_long; due < end; due += 50ms) {
    sleep_until(due);
    velocity += 1e-3;
    const Time begin = Clock::now();
    client.send(position2d_address(1), position2d::VelocityCommand{.velocity = {.x = velocity}});
    for (position2d::State state; state.velocity.x != velocity;) {
      if (!xdr::decode(client.receive(Kind::data, position2d::State::message.subtype).body, state)) break;
    }
    times_us.push_back(1e6 * seconds(Clock::now() - begin));
  }
  std::ranges::sort(times_us);
  return times_us;
}

void overload(Report& report, int samples, bool quick) {
  const ServerProcess server = start_server(base(1000, samples) + R"(
driver (name "fake_base" provides ["position2d:1"] rate 0 samples 0 echo 1))");
  Client commander{server.port};
  commander.subscribe(position2d_address(1));
  std::vector<Client> clients = subscribers(server.port, 100, 0, 16 * 1024);  // data age in there too
  const Duration how_long = quick ? 200ms : 10s;
  receive(clients, how_long / 10);
  std::vector<double> times_us;
  Received received;
  {
    const std::jthread thread{[&] { times_us = command_at_20_hz(commander, how_long); }};
    received = receive(clients, how_long);
  }
  const auto status = Client{server.port}.status();
  const auto& queues = status.at("drivers").at(0).at("queues");
  report.add("Overload: 100 subscribers with SO_RCVBUF 16384, and a commander at 20 Hz",
             {{"what", "100 x " + std::to_string(samples) + " kHz: server"},
              {"kmsg/s", 1e-3 * static_cast<double>(received.ages_us.size()) / seconds(how_long)},
              {"age p50 us", quantile(received.ages_us, 0.5)},
              {"age p99 us", quantile(received.ages_us, 0.99)},
              {"age max us", quantile(received.ages_us, 1)},
              {"dropped", status.at("data_dropped").get<std::uint64_t>()},
              {"replaced", queues.at("up_replaced").get<std::uint64_t>()},
              {"RTT p50 us", quantile(times_us, 0.5)},
              {"RTT p99 us", quantile(times_us, 0.99)}});
}

/// What a subscriber that reads nothing costs those who read.
void beside_a_stopped_reader(Report& report, bool quick) {
  const int times = quick ? 1 : 5;
  const Duration how_long = quick ? 200ms : 2s;
  constexpr Load load{.subscribers = 20, .rate_hz = 500};
  std::array<Measured, 2> measured;  // without it, with it
  std::uint64_t drops = 0;
  for (int i = 0; i < times; ++i) {
    for (const bool with : {false, true}) {
      const ServerProcess server = start_server(base(load.rate_hz));
      std::vector<Client> stopped;
      if (with) stopped = subscribers(server.port, 1, 0, 4096);
      std::vector<Client> clients = subscribers(server.port, load.subscribers);
      measure(measured[with ? 1 : 0], server.child, clients, load, how_long);
      if (with) drops += dropped(server.port);
    }
  }
  const double p99_without = median(measured[0].age_p99_us);
  const auto add = [&](const char* what, const Measured& m, std::uint64_t dropped_by_it) {
    report.add("20 x 500 Hz, medians of " + std::to_string(times) + " runs",
               {{"what", what},
                {"delivered %", 100 * median(m.delivered_share)},
                {"dropped", dropped_by_it},
                {"age p50 us", median(m.age_p50_us)},
                {"age p99 us", median(m.age_p99_us)},
                {"p99 / without", median(m.age_p99_us) / p99_without}});
  };
  add("by themselves", measured[0], 0);
  add("beside one that reads nothing", measured[1], drops);
}

/// A subscriber that reads a third of what it is sent.
void slow_reader(Report& report, bool quick) {
  const ServerProcess server = start_server(base(1000));
  Client client{server.port, true, 4096};
  client.subscribe(position2d_address(0));
  std::vector<double> ages_us;
  Time due = Clock::now();
  for (const Time end = due + (quick ? 300ms : 5s); due < end; due += 10ms) {
    sleep_until(due);
    const std::span<std::byte> space = client.framer().space().first(300);
    const ssize_t size = ::recv(client.socket().get(), space.data(), space.size(), MSG_DONTWAIT);
    client.framer().commit(static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
    for (auto frame = client.framer().next(); frame && *frame; frame = client.framer().next()) {
      ages_us.push_back(1e6 * (epoch_s(Clock::now()) - (*frame)->header.timestamp_s));
    }
  }
  std::ranges::sort(ages_us);
  report.add("Latest wins: 1 kHz to a subscriber that reads 30 kB/s, with SO_RCVBUF 4096",
             {{"what", "server"},
              {"age p50 us", quantile(ages_us, 0.5)},
              {"age p99 us", quantile(ages_us, 0.99)},
              {"age max us", quantile(ages_us, 1)},
              {"delivered", ages_us.size()},
              {"dropped", dropped(server.port)}});
}

void idle(Report& report) {
  constexpr std::size_t count = 500;
  const ServerProcess server = start_server(base(100));
  std::vector<Client> clients;
  clients.emplace_back(server.port);
  const std::size_t before = server.child.resident_bytes();
  std::vector<double> times_us;
  for (std::size_t i = 0; i < count; ++i) {
    const Time begin = Clock::now();
    clients.emplace_back(server.port);
    times_us.push_back(1e6 * seconds(Clock::now() - begin));
  }
  clients.back().status();  // all were accepted
  std::ranges::sort(times_us);
  report.add("Idle clients", {{"what", std::to_string(count)},
                              {"KiB each", static_cast<double>(server.child.resident_bytes() - before) / 1024 / count},
                              {"accept p50 us", quantile(times_us, 0.5)},
                              {"accept p99 us", quantile(times_us, 0.99)}});
}

void jitter(Report& report, bool quick) {
  const ServerProcess server = start_server(base(1000));
  std::vector<Client> clients = subscribers(server.port, 1);
  std::vector<double> late_us;
  std::jthread raw{[&] {
    ::prctl(PR_SET_TIMERSLACK, 1);
    Time beat = Clock::now();
    for (const Time end = beat + (quick ? 200ms : 10s); beat < end; beat += 1ms) {
      sleep_until(beat);
      late_us.push_back(1e6 * seconds(Clock::now() - beat));
    }
  }};
  receive(clients, quick ? 200ms : 10s);
  raw.join();
  std::ranges::sort(late_us);
  const nlohmann::json driver = Client{server.port}.status().at("drivers").at(0);
  const auto add = [&](const char* what, double p50, double p99, double max) {
    report.add("Beat at 1 kHz: how late [us]", {{"what", what}, {"p50", p50}, {"p99", p99}, {"max", max}});
  };
  add("raw clock_nanosleep", quantile(late_us, 0.5), quantile(late_us, 0.99), quantile(late_us, 1));
  const auto& host = driver.at("jitter_us");  // upper edges of buckets that grow by a factor of 1.41
  add("server", host.at("p50").get<double>(), host.at("p99").get<double>(), host.at("max").get<double>());
}

}  // namespace

void run(const Options& options) {
  epoch_s(Clock::now());  // for the children too
  Report report{options};
  const bool quick = options.quick;
  fan_out(report, {.subscribers = 100, .rate_hz = 1000}, quick);
  fan_out(report, {.subscribers = 100, .rate_hz = 1000, .coalesce_ms = 5}, quick);
  fan_out(report, {.subscribers = 100, .rate_hz = 100}, quick);
  fan_out(report, {.subscribers = 10, .rate_hz = 1000}, quick);
  fan_out(report, {.subscribers = 1000, .rate_hz = 10}, quick);
  overload(report, 1, quick);
  overload(report, 8, quick);
  beside_a_stopped_reader(report, quick);
  slow_reader(report, quick);
  idle(report);
  jitter(report, quick);
}

}  // namespace regista::bench
