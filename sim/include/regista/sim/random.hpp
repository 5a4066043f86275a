// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <random>

namespace regista::sim {

/// The chance in a plant: all of it comes from one seed, so a run can be repeated bit for bit.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_{seed} {}

  /// Normal with mean 0.
  double normal(double sd) { return sd * normal_(engine_); }
  /// Evenly in [low, high).
  double uniform(double low, double high) { return low + (high - low) * uniform_(engine_); }
  /// True with this probability.
  bool chance(double probability) { return uniform_(engine_) < probability; }
  /// The seed of a part, so that adding a draw to one part does not change the others.
  std::uint64_t fork() { return engine_(); }

 private:
  std::mt19937_64 engine_;
  std::normal_distribution<double> normal_;
  std::uniform_real_distribution<double> uniform_;
};

}  // namespace regista::sim
