// SPDX-License-Identifier: Apache-2.0
#include <benchmark/benchmark.h>

#include <cstring>
#include <regista/canopen/master.hpp>

namespace regista::canopen {
namespace {

/// Takes every frame, as a controller with room does.
struct Sink final : CanBus {
  CanFrame last;
  Result<> send(const CanFrame& frame) override {
    last = frame;
    benchmark::ClobberMemory();
    return {};
  }
  Result<std::optional<ReceivedFrame>> receive() override { return std::optional<ReceivedFrame>{}; }
  [[nodiscard]] int descriptor() const override { return -1; }
};

const PdoMapping mapping{{{0x6041, 0}, 16}, {{0x606C, 0}, 32}};

/// What a drive's feedback takes without any protocol: a switch over the id, and the bytes copied out.
void feedback_raw(benchmark::State& state) {
  CanFrame frame = make_frame(0x185, {0x37, 0x06, 1, 2, 3, 4});
  for ([[maybe_unused]] const auto _ : state) {
    benchmark::DoNotOptimize(frame);
    std::uint16_t statusword = 0;
    std::int32_t speed = 0;
    switch (frame.id) {
      case 0x185:
        std::memcpy(&statusword, frame.data.data(), 2);
        std::memcpy(&speed, frame.data.data() + 2, 4);
        break;
      default:
        break;
    }
    benchmark::DoNotOptimize(statusword);
    benchmark::DoNotOptimize(speed);
  }
}

void feedback_master(benchmark::State& state) {
  Sink sink;
  Master master{sink, {}, {}};
  std::uint64_t statusword = 0;
  std::int64_t speed = 0;
  master.on_pdo(0x185, [&](ByteView bytes, Time /*now*/) {
    statusword = mapping.get(bytes, 0);
    speed = mapping.get_signed(bytes, 1);
  });
  CanFrame frame = make_frame(0x185, {0x37, 0x06, 1, 2, 3, 4});
  const Time now = Clock::now();
  for ([[maybe_unused]] const auto _ : state) {
    benchmark::DoNotOptimize(frame);
    master.on_frame(frame, now);
    benchmark::DoNotOptimize(statusword);
    benchmark::DoNotOptimize(speed);
  }
}

void command_raw(benchmark::State& state) {
  Sink sink;
  CanFrame frame = make_frame(0x205, {0, 0, 0, 0, 0, 0});
  CanBus* bus = &sink;
  for ([[maybe_unused]] const auto _ : state) {
    benchmark::DoNotOptimize(bus);
    benchmark::DoNotOptimize(frame);
    if (!bus->send(frame)) return state.SkipWithError("refused");
  }
}

void command_master(benchmark::State& state) {
  Sink sink;
  Master master{sink, {}, {}};
  const std::size_t pdo = master.add_pdo(0x205, 6, false);
  std::array<std::uint8_t, 8> bytes{};
  const Time now = Clock::now();
  for ([[maybe_unused]] const auto _ : state) {
    benchmark::DoNotOptimize(bytes);
    if (!master.send_pdo(pdo, bytes, now)) return state.SkipWithError("refused");
  }
}

BENCHMARK(feedback_raw)->Name("feedback_pdo/switch_and_memcpy");
BENCHMARK(feedback_master)->Name("feedback_pdo/master");
BENCHMARK(command_raw)->Name("command_pdo/send");
BENCHMARK(command_master)->Name("command_pdo/master");

}  // namespace
}  // namespace regista::canopen
