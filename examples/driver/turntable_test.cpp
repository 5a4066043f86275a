// SPDX-License-Identifier: Apache-2.0
// Tests of the turntable, without hardware. docs/testing-a-driver.md goes through it.
#include <cstdio>
#include <regista/device/host.hpp>
#include <regista/testing/fault_proxy.hpp>
#include <regista/testing/raw_client.hpp>
#include <regista/testing/test_server.hpp>

using namespace regista;
using namespace regista::testing;
using namespace std::chrono_literals;

namespace {

void check(bool holds, const char* what) {
  if (!holds) throw std::runtime_error{what};
}

/// In a server, over a network that fails.
void stops_when_the_cable_is_pulled() {
  TestServer server{R"(driver ( name "turntable" provides ["position1d:0"] rate 100 ))", {&regista_plugin}};
  FaultProxy network{server.port()};
  RawClient client{network.port()};

  // Open position1d:0 (interface 52), as docs/protocol.md describes it.
  client.send(RawMessage{
      .interface = 1, .type = 3, .subtype = 3, .body = Pack{}.u32(0).u32(0).u32(52).u32(0).u32(1).u32(0).u32(0).bytes});
  check(client.receive_message().type == 4, "it opens");

  // A velocity of 1 rad/s, and never again.
  client.send(RawMessage{.interface = 52, .type = 2, .subtype = 1, .body = Pack{}.u32(0x3f800000).u32(1).bytes});
  while (client.receive_message().u32(4) == 0) {
  }  // until the data tell that it turns
  network.to_server.swallow = true;                                   // the cable is pulled
  const std::string told = server.logged("stopped: no command for");  // or throws, with the whole log
  check(told.starts_with("position1d:0 stopped"), "it says why it stands");
}

/// By itself, with times that are made up: half a second takes no time at all.
void turns_as_it_is_told() {
  auto setup = std::make_unique<Setup>(Section{});
  auto driver = regista_plugin.create(*setup);
  DriverHost host{"turntable", std::move(setup), std::move(driver), {.rate_hz = 100}};
  Wakeup wakeup;
  Link& client = host.add_link(&wakeup);
  Time now{1s};
  const auto post = [&](decltype(Inbound::message) message) {
    client.down.put(client.down.no_lane,
                    [&](Inbound& in) { in = {.session = 1, .arrived = now, .message = std::move(message)}; });
  };

  post(AnyRequest{player::Subscribe{}});
  host.cycle(now);
  post(AnyCommand{position1d::VelocityCommand{.velocity = 1}});
  for (int i = 0; i < 50; ++i) host.cycle(now += 10ms);  // does what is due
  double position = 0;
  client.up.drain([&](const Outbound& item) {
    const auto* sample = std::get_if<Sample>(&item);
    if (sample != nullptr) position = std::get<position1d::State>(sample->data).position;
  });
  check(position > 0.45 && position < 0.55, "it turned by half a radian in half a second");
}

}  // namespace

int main() {
  try {
    stops_when_the_cable_is_pulled();
    turns_as_it_is_told();
  } catch (const std::exception& failed) {
    std::fprintf(stderr, "%s\n", failed.what());
    return 1;
  }
}
