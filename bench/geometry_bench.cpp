// SPDX-License-Identifier: Apache-2.0
#include <benchmark/benchmark.h>
#include <regista/core/geometry.hpp>

#include <array>

namespace regista {
namespace {

std::array<double, 256> angles() {
  std::array<double, 256> angles{};
  for (std::size_t i = 0; i < angles.size(); ++i) angles[i] = 0.37 * static_cast<double>(i) - 47;
  return angles;
}

void fmod_alone(benchmark::State& state) {
  const auto values = angles();
  std::size_t i = 0;
  for ([[maybe_unused]] const auto _ : state)
    benchmark::DoNotOptimize(std::fmod(values[++i % values.size()], 2 * std::numbers::pi));
}

void wrap(benchmark::State& state) {
  const auto values = angles();
  std::size_t i = 0;
  for ([[maybe_unused]] const auto _ : state) benchmark::DoNotOptimize(wrap_angle(values[++i % values.size()]));
}

BENCHMARK(fmod_alone)->Name("wrap_angle/fmod");
BENCHMARK(wrap)->Name("wrap_angle/wrap_angle");

}  // namespace
}  // namespace regista
