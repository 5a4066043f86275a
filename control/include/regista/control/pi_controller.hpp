// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <regista/core/time.hpp>

namespace regista::control {

/// In units of output per unit of error.
struct PiGains {
  double proportional = 0;
  double integral = 0;      ///< [1/s]
  double derivative = 0;    ///< [s], of the measured value, so that a step of the set-point makes no kick
  double output_limit = 0;  ///< on either side of 0
  /// The integral is forgotten when the set-point jumps by more than this part of itself; Holtzhausen 2013: 0.3.
  double reset_jump = std::numeric_limits<double>::infinity();
};

/// Proportional-integral controller, with a derivative if wanted. The integral rests while the output is at its limit
/// and the error would drive it further.
class PiController {
 public:
  /// Throws std::invalid_argument that names the gain which is negative or no number, or a limit that is not positive.
  explicit PiController(const PiGains& gains);

  /// The output; 0, and nothing changes inside, when a value is not finite. `dt` is the time since the last step.
  [[nodiscard]] double step(double set_point, double measured, Duration dt);

  void reset() { *this = PiController{gains_, refused_}; }

  /// Steps with values that were not finite.
  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  PiController(const PiGains& gains, std::uint64_t refused) : gains_{gains}, refused_{refused} {}

  PiGains gains_;
  double integral_ = 0;
  double set_point_ = 0;
  double measured_ = 0;
  bool started_ = false;
  std::uint64_t refused_ = 0;
};

}  // namespace regista::control
