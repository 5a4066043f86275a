// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/control/kinematics.hpp>
#include <regista/control/odometry.hpp>
#include <regista/device/driver.hpp>

namespace regista {

/// A base on two driven wheels, or on four that skid when it turns. It `requires` the wheels, an actarray of this or of
/// another server: left and right; or front left, front right, rear left, rear right. Positive is forward.
///
/// `position2d:0` takes velocities (x and w). Odometry comes from the wheels' angles, along exact arcs. MOTOR_POWER is
/// passed on to the wheels. What its drives measure, their own driver tells: `power`, `dio`.
///
/// Property `calibrate`, to be written: "start", then drive a known way, then "distance 5" [m] for the radius of the
/// wheels, or "angle 62.83" [rad], turned counter-clockwise on the spot, for the track; or "umbmark 4 X Y X Y" with the
/// errors after squares of 4 m, see control::umbmark(). It takes effect at once; property `calibration` is what to
/// write into the .cfg.
///
/// | Key            | Value                                                                      | Default       |
/// |----------------|----------------------------------------------------------------------------|---------------|
/// | `skid_steer`   | boolean; yes: four wheels, and `track` is the effective one                | no            |
/// | `wheel_radius` | [length] of all wheels; or two, left and right                             | must be there |
/// | `track`        | [length] between left and right wheels                                     | must be there |
/// | `accel`, `decel` | [length/s²] of the ramps                                                 | 1 m/s²        |
/// | `turn_accel`   | [angle/s²] of the ramp                                                     | 3 rad/s²      |
/// | `wheels_timeout` | [s] without data of the wheels: it stops                                 | 0.25          |
/// | `size`         | [length width height]                                                      | track, track, 0.3 m
/// |
class Differential final : public Driver {
 public:
  explicit Differential(Setup& setup);

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override {}  // what the wheels tell goes on when it comes
  void halt() noexcept override;

 private:
  struct Sides {
    double left = 0;
    double right = 0;
  };

  void on_wheels(const actarray::State& state, Time measured);
  Result<Empty> set_odometry(const Pose2d& pose);
  void set_dimensions(double left_radius_m, double right_radius_m, double track_m);
  void calibrate();
  void command_wheels();
  [[nodiscard]] BodyVelocity body(const Sides& radps) const;

  Port<Position2d> base_;
  Required<Actarray> wheels_;
  Property<std::string> calibrate_;
  Property<std::string> calibration_;
  Property<double> slip_;

  // As configured, or calibrated.
  bool skid_steer_;
  std::size_t count_;
  double left_radius_m_;
  double right_radius_m_;
  double track_m_;
  control::Kinematics kinematics_;
  double accel_mps2_;
  double decel_mps2_;
  double turn_accel_radps2_;
  Duration timeout_;
  Size3d size_;

  // Of the wheels.
  double fastest_radps_ = 0;  ///< 0: not known
  bool asked_ = false;        ///< for their geometry
  std::optional<actarray::State> before_;
  Time measured_;
  bool powered_ = false;

  Pose2d pose_;
  BodyVelocity velocity_;
  std::optional<Sides> run_;  ///< of a calibration: turned since its start [rad]

  BodyVelocity target_;
  BodyVelocity commanded_;  ///< on the ramp
  bool at_rest_ = true;     ///< the wheels have been told so
  Time now_;
};

}  // namespace regista
