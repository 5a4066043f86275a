// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <regista/control/kalman_filter.hpp>
#include <regista/control/measurement.hpp>
#include <regista/core/time.hpp>

namespace regista::control {

/// White noise densities as Holtzhausen's (2013) where he has them: process over measurement variance is 0.05 in each
/// step of 20 ms, that is 2.5 s⁻¹. He gives no units; with vision of 10 mrad (a moving robot in the league), the
/// density is 2.5e-4 rad²/s.
struct OrientationConfig {
  double rate_density = 0.05 / 0.02 * 0.010 * 0.010;  ///< of the gyro's rate [rad²/s]
  double bias_density = 1e-7;                         ///< of the bias' derivative [rad²/s³]
  double initial_bias_sd_radps = 0.02;
  double gate = 4;  ///< standard deviations at which a measurement is an outlier
  double max_turn_rate_radps = std::numeric_limits<double>::infinity();  ///< a heading that needs more is refused
  std::uint32_t restart_after = 8;                                       ///< refused headings in a row
  double lost_sd_rad = 0.5;

  /// As published: no bias.
  static OrientationConfig holtzhausen() {
    OrientationConfig config;
    config.bias_density = 0;
    config.initial_bias_sd_radps = 0;
    return config;
  }
};

/// Heading and gyro bias, from turn rates and headings of any turn.
class OrientationFilter {
 public:
  using Input = double;  ///< [rad/s], as the gyro shows it
  using Measurement = HeadingMeasurement;

  /// All that changes from step to step.
  struct State {
    KalmanFilter<2> kalman;  ///< heading (wrapped), bias
    Input input = 0;         ///< the last good one
    double fix_rad = 0;
    SensorRecord heading;
    std::uint64_t refused_inputs = 0;
    bool initialised = false;
  };

  struct Estimate {
    double heading_rad = 0;  ///< in (-π, π]
    double w_radps = 0;      ///< the last rate without the bias
    double bias_radps = 0;
    double heading_sd_rad = 0;
    double bias_sd_radps = 0;
  };

  /// Throws std::invalid_argument, naming the value, for what is not positive (densities and bias may be 0).
  explicit OrientationFilter(const OrientationConfig& config = {});

  /// An input that is not finite is counted and replaced by the last good one; a negative `dt` does nothing.
  void predict(const Input& rate_radps, Duration dt);

  /// The first heading initialises.
  Correction correct(const Measurement& measurement);

  [[nodiscard]] Estimate estimate() const;
  /// Not initialised yet, or less certain than `lost_sd_rad`.
  [[nodiscard]] bool lost() const;

  [[nodiscard]] const State& state() const { return state_; }
  void restore(const State& state) { state_ = state; }

 private:
  void start_at(const HeadingMeasurement& measurement);

  OrientationConfig config_;
  State state_;
};

}  // namespace regista::control
