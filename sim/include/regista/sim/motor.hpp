// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace regista::sim {

/// A brushed DC motor. Its inductance is left out: L/R = 34 µs for the motor below, a fifteenth of a sub-step.
struct MotorParameters {
  double nominal_v = 0;
  double resistance_ohm = 0;
  double torque_constant_nm_per_a = 0;  ///< equals the back-EMF constant in V s/rad
  double inertia_kg_m2 = 0;             ///< of the rotor
  double no_load_a = 0;                 ///< current that friction takes

  /// [rad/s]
  [[nodiscard]] double no_load_radps() const {
    return (nominal_v - resistance_ohm * no_load_a) / torque_constant_nm_per_a;
  }
  /// [N m], of brushes and bearings, against the motion
  [[nodiscard]] double friction_nm() const { return torque_constant_nm_per_a * no_load_a; }
};

/// Faulhaber 2342 S 012 CR, the manufacturer's data sheet for the series 2342 … CR: U_N, R, k_M, J, I_0.
inline constexpr MotorParameters faulhaber_2342_012_cr{.nominal_v = 12,
                                                       .resistance_ohm = 1.9,
                                                       .torque_constant_nm_per_a = 13.4e-3,
                                                       .inertia_kg_m2 = 5.8e-7,
                                                       .no_load_a = 0.075};

/// The speed loop of one motor on its board. The error is in shares of the no-load speed, the output a duty cycle.
struct SpeedLoopParameters {
  double p = 1.1;                    ///< Holtzhausen 2013
  double i_per_s = 2;                ///< Holtzhausen 2013
  double period_s = 0.001;           ///< of the loop
  double reset_at_jump = 0.3;        ///< the integrator starts anew when the set-point changes by more than this share
  int triggers_per_revolution = 16;  ///< of the motor; the encoder has 512 lines, but the board sees 16 edges
  double stall_s = 0.1;              ///< without an edge for this long the speed reads 0
};

/// What the board knows of its motor: edges of the encoder, and when they came.
class SpeedLoop {
 public:
  SpeedLoop(const SpeedLoopParameters& parameters, double full_speed_radps)
      : parameters_{parameters}, full_speed_radps_{full_speed_radps} {}

  /// The motor turned from its last angle to `angle_rad` within `h` seconds, evenly.
  void see(double angle_rad, double h);
  /// One period of the loop: the duty cycle, -1 to 1, for a set-point in rad/s of the motor.
  double duty(double target_radps);

  [[nodiscard]] double speed_radps() const { return speed_radps_; }  ///< as the board measures it
  [[nodiscard]] std::int64_t count() const { return count_; }        ///< edges, signed

 private:
  SpeedLoopParameters parameters_;
  double full_speed_radps_;
  double edges_ = 0;  // angle in edges, with fraction
  std::int64_t count_ = 0;
  double since_edge_s_ = 0;
  int direction_ = 0;  // of the last edge; 0 after a stall
  double speed_radps_ = 0;
  double target_radps_ = 0;
  double integral_ = 0;  // duty
};

}  // namespace regista::sim
