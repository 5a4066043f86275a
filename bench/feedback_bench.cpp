// SPDX-License-Identifier: Apache-2.0
// From a drive's feedback on the bus to the position2d that is made from it, at a client: regista-server with can_motor
// and differential over socketcand, beside a thread that passes bytes on.
#include <poll.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <regista/canopen/pump.hpp>
#include <thread>

#include "socket_bench.hpp"
#include "socketcand_daemon.hpp"

namespace regista::bench {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t frame_size = 36;    // of "< frame 186 0.000000 37020000F401 >"
constexpr std::size_t message_size = 92;  // of position2d's state
constexpr double gear = 20;
constexpr double radius_m = 0.1;

/// For each frame that comes on one socket, a message goes out on the other.
class Relay {
 public:
  Relay(const Descriptor& in, const Descriptor& out)
      : from_{accept_from(in)}, to_{accept_from(out)}, thread_{[this] {
          std::array<std::byte, frame_size> frame;
          const std::array<std::byte, message_size> message{};
          try {
            for (;;) {
              receive_all(from_, frame);
              send_all(to_, message);
            }
          } catch (const std::exception&) {  // they have left
          }
        }} {}

  ~Relay() { ::shutdown(from_.get(), SHUT_RDWR); }
  Relay(const Relay&) = delete;
  Relay& operator=(const Relay&) = delete;

 private:
  Descriptor from_;
  Descriptor to_;
  std::jthread thread_;
};

/// The drives' side of the bus. Once muted, their own feedback does not come between what is measured.
class Muted final : public canopen::CanBus {
 public:
  explicit Muted(Daemon& daemon) : daemon_{daemon} {}
  void mute() { muted_ = true; }
  Result<> send(const CanFrame& frame) override {
    if (muted_ && (frame.id == 0x185 || frame.id == 0x186)) return {};
    return daemon_.send(frame);
  }
  Result<std::optional<canopen::ReceivedFrame>> receive() override { return daemon_.receive(); }
  [[nodiscard]] int descriptor() const override { return daemon_.descriptor(); }

 private:
  Daemon& daemon_;
  bool muted_ = false;
};

/// They and what waits for their frames.
class Drives {
 public:
  explicit Drives(canopen::CanBus& bus) : drives_{bus}, pump_{bus, drives_} {}
  void run(Duration duration) {
    for (const Time end = Clock::now() + duration; Clock::now() < end;) {
      if (const auto served = pump_.wait(end - Clock::now()); !served)
        throw std::runtime_error{served.error().message()};
    }
  }
  [[nodiscard]] bool started() { return drives_.started(); }

 private:
  TwoDrives drives_;
  canopen::Pump pump_;
};

CanFrame feedback(canopen::NodeId node, std::int32_t rpm) {
  const canopen::Bytes speed = canopen::le_bytes(static_cast<std::uint32_t>(rpm), 4);
  return canopen::make_frame(0x180U + node, {0x50, 0x02, speed[0], speed[1], speed[2], speed[3]});
}

}  // namespace

void run(const Options& options) {
  std::uint16_t in_port = 0;
  std::uint16_t out_port = 0;
  const Descriptor in = listen_anywhere(in_port);
  const Descriptor out = listen_anywhere(out_port);
  const Descriptor relay_in = connect_to(in_port);
  const Descriptor relay_out = connect_to(out_port);
  Relay relay{in, out};

  std::uint16_t bus_port = 0;
  const Descriptor listener = listen_anywhere(bus_port);
  const std::string plugins = REGISTA_PLUGINS;
  const ServerProcess server = start_server(R"(
driver (name "can_motor" plugin ")" + plugins +
                                            R"(/can_motor.so" provides ["actarray:0"] alwayson true
        bus "socketcand://127.0.0.1:)" + std::to_string(bus_port) +
                                            R"(/can0" nodes [5 6] gear 20 wheel_speed 1200)
driver (name "differential" plugin ")" + plugins +
                                            R"(/differential.so" provides ["position2d:0"] requires ["actarray:0"]
        wheel_radius 0.1 track 0.4))");
  Daemon bus{::accept4(listener.get(), nullptr, nullptr, SOCK_CLOEXEC)};
  Muted muted{bus};
  Drives drives{muted};
  const Time limit = Clock::now() + 10s;
  while (!drives.started()) {
    if (Clock::now() > limit) throw std::runtime_error{"the drives were not started"};
    drives.run(10ms);
  }
  Client client{server.port};
  client.subscribe(position2d_address(0));
  muted.mute();
  const auto speed_of = [](double rpm) { return rpm / gear * 2 * std::numbers::pi / 60 * radius_m; };
  const auto answers = [&](std::int32_t rpm) {
    position2d::State state;
    if (!xdr::decode(client.receive(Kind::data, position2d::State::message.subtype).body, state)) {
      throw std::runtime_error{"bad state"};
    }
    return std::abs(state.velocity.x - speed_of(rpm)) < speed_of(1) / 4;
  };
  // Before both drives are up their feedback is read by nobody. The driver waits for both wheels: whatever it has of
  // them, after this it waits for the left one.
  for (bool up = false; !up;) {
    for (const canopen::NodeId node : std::array<canopen::NodeId, 3>{5, 5, 6}) (void)bus.send(feedback(node, 50));
    drives.run(10ms);
    for (pollfd ready{client.socket().get(), POLLIN, 0}; !up && ::poll(&ready, 1, 0) > 0;) up = answers(50);
    if (Clock::now() > limit) throw std::runtime_error{"the drives were not started"};
  }

  const auto raw = [&] {
    const std::array<std::byte, frame_size> frame{};
    std::array<std::byte, message_size> message{};
    const Time begin = Clock::now();
    send_all(relay_in, frame);
    receive_all(relay_out, message);
    return Clock::now() - begin;
  };
  std::int32_t rpm = 100;
  const auto ours = [&] {
    rpm = rpm == 1000 ? 100 : rpm + 1;  // which tells the answer from that to the frame before
    (void)bus.send(feedback(5, rpm));
    std::this_thread::sleep_for(250us);  // frames follow each other on a bus
    const Time begin = Clock::now();
    (void)bus.send(feedback(6, rpm));
    while (!answers(rpm)) continue;
    return Clock::now() - begin;
  };

  std::vector<double> raw_us;
  std::vector<double> ours_us;
  const int samples = options.quick ? 50 : 5000;
  for (int i = 0; i < samples; ++i) {
    raw_us.push_back(1e6 * seconds(raw()));
    ours_us.push_back(1e6 * seconds(ours()));
    drives.run(2ms);  // heartbeats
  }
  Report report{options};
  std::ranges::sort(raw_us);
  std::ranges::sort(ours_us);
  for (const auto& [name, times] : {std::pair{"two sockets and a thread between", &raw_us},
                                    std::pair{"can_motor, differential, client", &ours_us}}) {
    report.add("From a frame on the bus to position2d at a client [us]",
               {{"what", name},
                {"p50", quantile(*times, 0.5)},
                {"p90", quantile(*times, 0.9)},
                {"p99", quantile(*times, 0.99)},
                {"max", quantile(*times, 1)},
                {"p50 / raw", quantile(*times, 0.5) / quantile(raw_us, 0.5)}});
  }
}

}  // namespace regista::bench
