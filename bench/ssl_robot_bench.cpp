// SPDX-License-Identifier: Apache-2.0
// What one beat of a soccer robot costs: telemetry in, estimate, plan, command out, publish. The baseline is the cable
// alone: parse and unpack the telemetry, pack the command. At 500 Hz a beat may take 2 ms, and is to take 100 µs at
// most.
//   build/release/bin/bench_ssl_robot

#include <benchmark/benchmark.h>
#include <regista/motor_board/frame.h>

#include <array>
#include <chrono>
#include <memory>

#include "ssl_robot.hpp"

namespace {

using namespace regista;
using namespace std::chrono_literals;

constexpr Duration beat = 2ms;

using Frame = std::array<std::uint8_t, motor_board_telemetry_size>;

/// A board that answers at once, and whose wheels turn as they did in its last answer and an edge more.
class Board final : public motor_board::BoardLink {
 public:
  explicit Board(bool moves) : moves_{moves} {
    telemetry_.status = motor_board_driving | motor_board_imu;
    telemetry_.accel_mmps2[2] = 9807;
  }
  Result<> open() override { return {}; }
  void close() noexcept override {}
  Result<> send(std::span<const std::uint8_t> bytes) override {
    benchmark::DoNotOptimize(bytes.data());
    return {};
  }
  Result<std::size_t> receive(const Tick&, std::span<std::uint8_t> bytes) override {
    telemetry_.time_us += 2000;
    if (moves_) {
      for (std::int32_t& count : telemetry_.count) ++count;
    }
    motor_board_pack_telemetry(&telemetry_, bytes.data());
    return std::size_t{motor_board_telemetry_size};
  }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  bool moves_;
  std::string name_ = "bench";
  MotorBoardTelemetry telemetry_{};
};

/// The driver without its host.
class Robot {
 public:
  explicit Robot(bool moves = true) : driver_{setup_, std::make_unique<Board>(moves), nullptr} { (void)driver_.open(); }
  void read_and_publish() {
    now_ += beat;
    for (PortCore& port : setup_.ports) port.now = now_;
    if (!driver_.read({.now = now_, .dt = beat})) failed_ = true;
    driver_.publish();
  }
  template <typename Command>
  void send(std::size_t port, const Command& command) {
    const AnyCommand any{command};
    if (!setup_.ports[port].commands[any.index()](any)) failed_ = true;
  }
  [[nodiscard]] bool failed() const { return failed_; }

 private:
  Setup setup_{Section{"driver", Place{}}};
  SslRobot driver_;
  Time now_{1000s};
  bool failed_ = false;
};

void cable_alone(benchmark::State& state) {
  MotorBoardParser parser;
  motor_board_parse_telemetry(&parser);
  MotorBoardTelemetry telemetry{};
  Frame frame{};
  motor_board_pack_telemetry(&telemetry, frame.data());
  MotorBoardCommand command{};
  std::array<std::uint8_t, motor_board_command_size> out{};
  for (auto _ : state) {
    for (const std::uint8_t byte : frame) {
      if (motor_board_parse(&parser, byte)) (void)motor_board_unpack_telemetry(parser.frame, &telemetry);
    }
    command.sequence = telemetry.sequence;
    motor_board_pack_command(&command, out.data());
    benchmark::DoNotOptimize(out);
  }
}
BENCHMARK(cable_alone)->Name("beat/cable_alone");

/// `late`: how old the camera's poses are; they come in every seventh beat, 71 times a second.
void to_a_pose(benchmark::State& state, Duration late) {
  Robot robot{false};
  const auto see = [&] { robot.send(1, position2d::VelocityCommand{.velocity = {}, .age_s = seconds(late)}); };
  see();
  for (int i = 0; i < 600; ++i) {  // the IMU is calibrated at rest
    if (i % 7 == 0) see();
    robot.read_and_publish();
  }
  robot.send(0, position2d::PositionCommand{.pose = {.x = 1}});
  int beats = 0;
  for (auto _ : state) {
    if (++beats % 7 == 0) see();
    robot.read_and_publish();
  }
  if (robot.failed()) state.SkipWithError("the driver failed");
}

void at_a_velocity(benchmark::State& state) {
  Robot robot;
  robot.send(0, position2d::VelocityCommand{.velocity = {.x = 0.5}});
  for (auto _ : state) robot.read_and_publish();
  if (robot.failed()) state.SkipWithError("the driver failed");
}
BENCHMARK(at_a_velocity)->Name("beat/at_a_velocity");
BENCHMARK_CAPTURE(to_a_pose, camera_30_ms_late, 30ms)->Name("beat/to_a_pose_camera_30_ms_late");
BENCHMARK_CAPTURE(to_a_pose, camera_100_ms_late, 100ms)->Name("beat/to_a_pose_camera_100_ms_late");

/// The beats in which a pose comes: all that came after it is estimated again.
void with_a_pose(benchmark::State& state) {
  Robot robot{false};
  const auto late = from_seconds(1e-3 * static_cast<double>(state.range(0)));
  for (auto _ : state) {
    robot.send(1, position2d::VelocityCommand{.velocity = {}, .age_s = seconds(late)});
    robot.read_and_publish();
  }
  if (robot.failed()) state.SkipWithError("the driver failed");
}
BENCHMARK(with_a_pose)->Name("beat/with_a_pose")->Arg(30)->Arg(100);

}  // namespace
