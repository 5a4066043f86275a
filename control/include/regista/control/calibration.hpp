// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <regista/core/geometry.hpp>
#include <regista/core/result.hpp>
#include <span>

namespace regista::control {

/// One line of a recorded run of a differential or skid-steered base.
struct WheelSample {
  double left_rad = 0;   ///< angle that the left wheel has turned since any fixed time; for four wheels the mean
  double right_rad = 0;  ///< same, right
  std::optional<Pose2d> reference;  ///< where the base was, from a camera or by hand; not every sample needs one
};

struct WheelCalibration {
  double left_radius_m = 0;
  double right_radius_m = 0;
  double track_m = 0;  ///< effective, as for Kinematics::differential() and skid_steer()

  // Standard deviations of the three, as far as they follow from the scatter about the fit.
  double left_radius_sd_m = 0;
  double right_radius_sd_m = 0;
  double track_sd_m = 0;

  double heading_residual_rad = 0;  ///< root mean square; more than the reference's noise means slip
  double position_residual_m = 0;
};

/// Wheel radii and track from a run with a reference, by two linear least squares (Antonelli, Chiaverini, Fusco 2005,
/// "A calibration method for odometry of mobile robots based on the least-squares technique", IEEE T-RO 21(5)): the
/// headings give radius / track for each wheel, then the positions give the track. The start pose is fitted too.
/// Between two references the base turns by less than half a turn.
/// Fails with invalid_argument, in words, for fewer than ten references, values that are not finite, a wheel that
/// counts backwards, or a run that leaves a result more than 10 % uncertain: drive ahead and turn both ways. Not for a
/// step: it allocates.
Result<WheelCalibration> calibrate_wheels(std::span<const WheelSample> run);

/// Where a differential base really was minus where its odometry said, in the frame of the start, after a square.
struct SquareError {
  double x_m = 0;
  double y_m = 0;
};

/// What a base with these nominal dimensions must have for its squares to close (UMBmark: Borenstein, Feng 1996,
/// "Measurement and correction of systematic odometry errors in mobile robots", IEEE T-RA 12(6), eqs. 10 to 17). The
/// squares begin along +x and turn by 90° at the corners, as odometry sees it: one clockwise, one counter-clockwise;
/// the errors are means of several runs. The mean of the radii is kept. Fails with invalid_argument for numbers that
/// are not finite, a side that is not positive, or errors above a quarter of it. The standard deviations are 0.
Result<WheelCalibration> umbmark(double left_radius_m, double right_radius_m, double track_m, double side_m,
                                 const SquareError& clockwise, const SquareError& counter_clockwise);

/// One line of a recorded run: what the compass showed and what it should have shown.
struct CompassSample {
  double measured_rad = 0;
  double reference_rad = 0;
};

/// The error of a compass as a function of what it shows: the five coefficients of ships' compasses,
/// A + B sin + C cos + D sin 2 + E cos 2 (iron on board fixed to the body gives B and C, soft iron D and E, a turned
/// mounting A; "Handbook of Magnetic Compass Adjustment", NGA, Pub. 226; Lien 2013, 6.4 measured 6-7°).
class CompassCalibration {
 public:
  /// No error.
  CompassCalibration() = default;

  /// Throws std::invalid_argument for a coefficient that is not finite, or a deviation that changes faster than the
  /// heading.
  explicit CompassCalibration(const std::array<double, 5>& coefficients_rad);

  /// Least squares over a run. Fails with invalid_argument for fewer than ten samples, for values that are not finite,
  /// or when an arc of a quarter turn or more was not visited: turn a full circle.
  static Result<CompassCalibration> fit(std::span<const CompassSample> run);

  /// [rad], to be subtracted
  [[nodiscard]] double error(double measured_rad) const;
  /// [rad], in (-π, π]
  [[nodiscard]] double corrected(double measured_rad) const { return wrap_angle(measured_rad - error(measured_rad)); }
  /// A to E [rad]
  [[nodiscard]] const std::array<double, 5>& coefficients_rad() const { return coefficients_; }

 private:
  std::array<double, 5> coefficients_{};
};

}  // namespace regista::control
