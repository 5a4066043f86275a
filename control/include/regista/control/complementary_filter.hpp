// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <regista/control/measurement.hpp>
#include <regista/core/time.hpp>

namespace regista::control {

struct ComplementaryConfig {
  double time_constant_s = 0.5;  ///< headings count below, the gyro above 1 / (2π time_constant)
  double max_turn_rate_radps = std::numeric_limits<double>::infinity();  ///< a heading that needs more is refused
  double gate = 4;                  ///< standard deviations of two headings that need no turn to differ
  std::uint32_t restart_after = 8;  ///< refused headings in a row
};

/// Heading: the high frequencies of the gyro's integral and the low frequencies of the measured heading, which add up
/// to one. Cheaper than OrientationFilter and blind to a bias: an unknown bias b leaves an error of
/// b time_constant.
class ComplementaryFilter {
 public:
  using Input = double;  ///< [rad/s]
  using Measurement = HeadingMeasurement;

  /// All that changes from step to step.
  struct State {
    double heading_rad = 0;  ///< in (-π, π]
    Input input = 0;         ///< the last good one
    double fix_rad = 0;
    SensorRecord heading;
    std::uint64_t refused_inputs = 0;
    bool initialised = false;
  };

  /// Throws std::invalid_argument, naming the value, for what is not positive.
  explicit ComplementaryFilter(const ComplementaryConfig& config = {});

  /// An input that is not finite is counted and replaced by the last good one; a negative `dt` does nothing.
  void predict(const Input& rate_radps, Duration dt);

  /// The first heading initialises. The step towards a heading is 1 - exp(-t / time_constant), where t is the time
  /// since the heading before: the same filter at any rate of measurements.
  Correction correct(const Measurement& measurement);

  /// [rad], in (-π, π]
  [[nodiscard]] double heading_rad() const { return state_.heading_rad; }

  [[nodiscard]] const State& state() const { return state_; }
  void restore(const State& state) { state_ = state; }

 private:
  ComplementaryConfig config_;
  State state_;
};

}  // namespace regista::control
