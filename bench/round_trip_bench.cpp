// SPDX-License-Identifier: Apache-2.0
// How long a message and its answer take through the server, beside a bare echo over TCP in the same run.
#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <thread>

#include "socket_bench.hpp"

namespace regista::bench {
namespace {

constexpr std::size_t message_size = 92;  // of position2d's state

/// Echoes what one peer sends, until that leaves.
class Echo {
 public:
  explicit Echo(Descriptor listener)
      : thread_{[listener = std::move(listener)] {
          const Descriptor peer = accept_from(listener);
          std::array<std::byte, message_size> message;
          try {
            for (;;) {
              receive_all(peer, message);
              send_all(peer, message);
            }
          } catch (const std::exception&) {  // it has left
          }
        }} {}
  void put(const cpu_set_t& where) { ::pthread_setaffinity_np(thread_.native_handle(), sizeof where, &where); }

 private:
  std::jthread thread_;
};

/// A command with a velocity of its own, until the state with that velocity comes.
class Driving {
 public:
  Driving(Client& client, std::uint16_t index) : client_{&client}, index_{index} {}
  void command() {
    velocity_ = velocity_ > 1 ? 1e-3 : velocity_ + 1e-3;
    client_->send(position2d_address(index_), position2d::VelocityCommand{.velocity = {.x = velocity_}});
  }
  bool answered() {
    position2d::State state;
    if (!xdr::decode(client_->receive(Kind::data, position2d::State::message.subtype).body, state)) {
      throw std::runtime_error{"bad state"};
    }
    return state.velocity.x == velocity_;
  }

 private:
  Client* client_;
  std::uint16_t index_;
  double velocity_ = 0;
};

/// Where the client runs, and where whoever answers it: both decide what a wake-up costs.
struct Placement {
  std::string name;
  cpu_set_t client;
  cpu_set_t peers;
};

std::vector<Placement> placements() {
  cpu_set_t allowed;
  if (::sched_getaffinity(0, sizeof allowed, &allowed) != 0) throw std::runtime_error{"sched_getaffinity"};
  std::vector<cpu_set_t> each;
  for (std::size_t cpu = 0; cpu < CPU_SETSIZE && each.size() < 2; ++cpu) {
    if (!CPU_ISSET(cpu, &allowed)) continue;
    CPU_ZERO(&each.emplace_back());
    CPU_SET(cpu, &each.back());
  }
  std::vector<Placement> all{{"wherever the scheduler puts them", allowed, allowed}};
  all.push_back({"client and peers on one processor", each[0], each[0]});
  if (each.size() > 1) all.push_back({"client and peers on two processors", each[0], each[1]});
  return all;
}

/// All threads of a process.
void put_process(pid_t process, const cpu_set_t& where) {
  for (const auto& task : std::filesystem::directory_iterator{"/proc/" + std::to_string(process) + "/task"}) {
    ::sched_setaffinity(std::stoi(task.path().filename()), sizeof where, &where);
  }
}

struct Case {
  std::string name;
  std::function<void()> once;
  std::vector<double> times_us{};
};

}  // namespace

void run(const Options& options) {
  std::uint16_t echo_port = 0;
  Descriptor listener = listen_anywhere(echo_port);
  // A device for each that drives: it belongs to one client at a time.
  const ServerProcess server = start_server(R"(
driver (name "fake_base" provides ["position2d:0"] rate 0 samples 0 echo 1)
driver (name "fake_base" provides ["position2d:1"] rate 0 samples 0 echo 1))");
  Echo echo{std::move(listener)};
  const Descriptor raw = connect_to(echo_port);
  std::array<std::byte, message_size> message{};

  Client push{server.port};
  push.subscribe(position2d_address(0));
  Driving pushed{push, 0};
  // As libplayerc: no TCP_NODELAY, and data only when asked for.
  Client pull{server.port, false};
  pull.request(server_address, player::SetDataMode{player::DataMode::pull});
  pull.subscribe(position2d_address(1));
  Driving pulled{pull, 1};

  std::vector<Case> cases{{"raw TCP", [&] {
                             send_all(raw, message);
                             receive_all(raw, message);
                           }}};
  cases.push_back({"command, driver, data", [&] {
                     pushed.command();
                     while (!pushed.answered()) {
                     }
                   }});
  cases.push_back({"request, reply", [&] { push.request(position2d_address(0), position2d::GetGeometry{}); }});
  cases.push_back({"command, driver, data in PULL mode", [&] {
                     pulled.command();
                     for (bool answered = false; !answered;) {
                       pull.send(server_address, player::GetData{});
                       answered = pulled.answered();
                       pull.receive(Kind::synch, player::SynchOk::message.subtype);
                     }
                   }});

  const int rounds = options.quick ? 3 : 100;
  const int first_of_a_round = 20;  // not counted: caches, and data that the others' commands left behind
  const int in_a_round = options.quick ? 50 : 200;
  Report report{options};
  for (const Placement& placement : placements()) {
    put_process(server.child.pid(), placement.peers);
    echo.put(placement.peers);
    ::sched_setaffinity(0, sizeof placement.client, &placement.client);
    for (Case& each : cases) each.times_us.clear();
    // In turn, so that a change of the machine's speed meets all alike.
    for (int round = 0; round < rounds; ++round) {
      for (Case& each : cases) {
        for (int i = -first_of_a_round; i < in_a_round; ++i) {
          const Time begin = Clock::now();
          each.once();
          if (i >= 0) each.times_us.push_back(1e6 * seconds(Clock::now() - begin));
        }
      }
    }
    for (Case& each : cases) std::ranges::sort(each.times_us);
    const double raw_p50 = quantile(cases.front().times_us, 0.5);
    for (const Case& each : cases) {
      report.add("Round trips [us], " + placement.name, {{"what", each.name},
                                                         {"p50", quantile(each.times_us, 0.5)},
                                                         {"p90", quantile(each.times_us, 0.9)},
                                                         {"p99", quantile(each.times_us, 0.99)},
                                                         {"max", quantile(each.times_us, 1)},
                                                         {"p50 / raw", quantile(each.times_us, 0.5) / raw_p50}});
    }
  }
}

}  // namespace regista::bench
