// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <regista/core/time.hpp>
#include <string_view>

namespace regista::control {

// What sensors tell a filter. Each brings its standard deviation, above 0.

/// From vision or GPS, in the field frame.
struct PositionMeasurement {
  double x = 0;     ///< [m]
  double y = 0;     ///< [m]
  double sd_m = 0;  ///< of each coordinate
};

/// From vision, a compass or an IMU with one.
struct HeadingMeasurement {
  double heading_rad = 0;  ///< any turn
  double sd_rad = 0;
};

/// In the field frame.
struct VelocityMeasurement {
  double x = 0;       ///< [m/s]
  double y = 0;       ///< [m/s]
  double sd_mps = 0;  ///< of each component
};

/// From the wheels of a base that does not move sideways.
struct WheelMeasurement {
  double speed_mps = 0;
  double w_radps = 0;
  double speed_sd_mps = 0;
  double w_sd_radps = 0;
};

struct GyroMeasurement {
  double w_radps = 0;  ///< counter-clockwise, its bias included
  double sd_radps = 0;
};

/// What became of a measurement.
enum class Verdict : std::uint8_t {
  none,         ///< there was no measurement yet
  fused,        ///< corrected the estimate
  initialised,  ///< the estimate starts here
  restarted,    ///< refused too often in a row: the estimate was wrong, and starts anew here
  waiting,      ///< of no use before the estimate is initialised
  outlier,      ///< refused: further from the estimate than the gate allows
  too_fast,     ///< refused: nothing moves or turns that fast
  invalid,      ///< refused: not finite, absurd, or a standard deviation that is not positive
  too_old,      ///< refused: from before the recorded history, or from the future
};

/// "fused", "refused: outlier", ...
[[nodiscard]] std::string_view to_string(Verdict verdict);

struct Correction {
  Verdict verdict = Verdict::none;
  /// Normalised innovation squared, chi-square with as many degrees of freedom as the measurement has numbers; 0 when
  /// it was not compared.
  double nis = 0;
};

/// What one sensor did for a filter so far.
struct SensorRecord {
  Correction last;
  Duration unseen{};  ///< since the filter last took one
  std::uint64_t taken = 0;
  std::uint64_t refused = 0;
  std::uint64_t restarts = 0;
  std::uint32_t refused_in_a_row = 0;  ///< invalid ones do not count

  /// Count it and pass it on.
  Correction note(Verdict verdict, double nis = 0);
};

}  // namespace regista::control
