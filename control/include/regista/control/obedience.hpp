// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>
#include <regista/core/geometry.hpp>
#include <regista/core/time.hpp>

namespace regista::control {

struct ObedienceConfig {
  Duration patience = std::chrono::seconds{3};
  double speed_mps = 0.1;   ///< by which the measured speed may differ, or half of what was commanded
  double turn_radps = 0.3;  ///< likewise
};

/// Tells that a base does not do what it is told: blocked, stopped, switched off, or driven by somebody else.
class Obedience {
 public:
  /// Throws std::invalid_argument that names the value which is not positive.
  explicit Obedience(const ObedienceConfig& config = {});

  /// What was commanded during `dt`, and what was measured; nothing measured is no obedience.
  /// False: it has not obeyed for longer than the patience.
  bool step(const BodyVelocity& commanded, const std::optional<BodyVelocity>& measured, Duration dt);

  /// Another task: patience anew.
  void forgive() { disobeyed_ = {}; }

 private:
  ObedienceConfig config_;
  Duration disobeyed_{};
};

}  // namespace regista::control
