// SPDX-License-Identifier: Apache-2.0
#include <benchmark/benchmark.h>
#include <regista/xdr/registry.hpp>

namespace regista {
namespace {

// Encoder, decoder and memcpy take a pointer, a size that only shows at run time, and leave their result in memory
// that escapes: nothing is known beforehand, nothing may be left out, and this holds for all three alike.

position2d::State odometry() { return {.pose = {1.25, -2.5, 3}, .velocity = {-0.1, 0.4, 0.9}, .stalled = 1}; }

actarray::State wheels() {
  actarray::State state{.actuators = {}, .motors_on = 1};
  for (int i = 0; i < 16; ++i) state.actuators.push_back({.position = 0.1F * static_cast<float>(i), .state = {}});
  return state;
}

template <typename Body>
std::vector<std::byte> message_of(const Body& body) {
  std::vector<std::byte> bytes(xdr::header_size + xdr::encoded_size(body));
  xdr::encode_message({.kind = Body::message.kind, .subtype = Body::message.subtype}, body, bytes);
  return bytes;
}

/// The message as it stands, header included.
template <auto make_body>
void copy(benchmark::State& state) {
  const std::vector<std::byte> from = message_of(make_body());
  std::vector<std::byte> to(from.size());
  std::size_t size = from.size();
  for ([[maybe_unused]] const auto _ : state) {
    benchmark::DoNotOptimize(size);
    benchmark::DoNotOptimize(from.data());
    std::memcpy(to.data(), from.data(), size);
    benchmark::DoNotOptimize(to.data());
    benchmark::ClobberMemory();
  }
}

/// Header and body, into a buffer of the caller.
template <auto make_body>
void encode(benchmark::State& state) {
  auto body = make_body();
  using Body = decltype(body);
  xdr::Header header{.kind = Body::message.kind, .subtype = Body::message.subtype, .timestamp_s = 1.7e9};
  std::vector<std::byte> to(xdr::header_size + xdr::encoded_size(body));
  std::size_t size = to.size();
  for ([[maybe_unused]] const auto _ : state) {
    benchmark::DoNotOptimize(size);
    benchmark::DoNotOptimize(header);
    benchmark::DoNotOptimize(&body);
    benchmark::DoNotOptimize(xdr::encode_message(header, body, {to.data(), size}));
    benchmark::DoNotOptimize(to.data());
    benchmark::ClobberMemory();
  }
}

/// Header and body, into structs of the caller.
template <auto make_body>
void decode(benchmark::State& state) {
  auto body = make_body();
  const std::vector<std::byte> from = message_of(body);
  xdr::Header header;
  std::size_t size = from.size();
  for ([[maybe_unused]] const auto _ : state) {
    benchmark::DoNotOptimize(size);
    benchmark::DoNotOptimize(from.data());
    const std::span bytes{from.data(), size};
    const bool good = xdr::decode(bytes, header) && xdr::decode(bytes.subspan(xdr::header_size), body);
    if (!good) return state.SkipWithError("does not decode");
    benchmark::DoNotOptimize(header);
    benchmark::DoNotOptimize(&body);
    benchmark::ClobberMemory();
  }
}

BENCHMARK(copy<odometry>)->Name("position2d_state/memcpy");
BENCHMARK(encode<odometry>)->Name("position2d_state/encode");
BENCHMARK(decode<odometry>)->Name("position2d_state/decode");
BENCHMARK(copy<wheels>)->Name("actarray_state_of_16/memcpy");
BENCHMARK(encode<wheels>)->Name("actarray_state_of_16/encode");
BENCHMARK(decode<wheels>)->Name("actarray_state_of_16/decode");

}  // namespace
}  // namespace regista
