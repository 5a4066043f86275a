// SPDX-License-Identifier: Apache-2.0
#include "regista/control/calibration.hpp"

#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>
#include <complex>
#include <numbers>
#include <string>
#include <vector>

#include "arc.hpp"
#include "parameter.hpp"

namespace regista::control {
namespace {

constexpr Eigen::Index fewest_samples = 10;

struct Fit {
  Eigen::VectorXd unknowns;
  Eigen::MatrixXd covariance;
  double residual = 0;  ///< root mean square
};

/// Empty when the rows do not determine the unknowns.
std::optional<Fit> least_squares(const Eigen::MatrixXd& rows, const Eigen::VectorXd& values) {
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr{rows};
  qr.setThreshold(1e-6);  // the covariance below squares it
  if (qr.rank() < rows.cols()) return std::nullopt;
  Fit fit{.unknowns = qr.solve(values), .covariance = {}};
  const double square = (values - rows * fit.unknowns).squaredNorm();
  fit.residual = std::sqrt(square / static_cast<double>(rows.rows()));
  fit.covariance = (rows.transpose() * rows).inverse() * square / static_cast<double>(rows.rows() - rows.cols());
  return fit;
}

Error refusal(const std::string& reason) { return {std::errc::invalid_argument, reason}; }

}  // namespace

Result<WheelCalibration> calibrate_wheels(std::span<const WheelSample> run) {
  Eigen::Index references = 0;
  for (const WheelSample& sample : run) {
    if (!sane(sample.left_rad) || !sane(sample.right_rad))
      return refusal("calibrate wheels: a wheel angle is not finite");
    if (!sample.reference) continue;
    const Pose2d& pose = *sample.reference;
    if (!sane(pose.x) || !sane(pose.y) || !sane(pose.heading)) {
      return refusal("calibrate wheels: a reference pose is not finite");
    }
    ++references;
  }
  if (references < fewest_samples) {
    return refusal("calibrate wheels: " + std::to_string(references) + " references; record at least " +
                   std::to_string(fewest_samples));
  }
  const std::string vague =
      "calibrate wheels: the run does not tell wheels and track apart; drive ahead and turn both ways";

  // Heading: h = h0 + a_right right - a_left left, with a = radius / track.
  Eigen::MatrixXd rows(references, 3);
  Eigen::VectorXd values(references);
  Eigen::Index k = 0;
  for (const WheelSample& sample : run) {
    if (!sample.reference) continue;
    rows.row(k) << 1, sample.right_rad - run[0].right_rad, -(sample.left_rad - run[0].left_rad);
    values(k) =
        k == 0 ? sample.reference->heading : values(k - 1) + angle_between(values(k - 1), sample.reference->heading);
    ++k;
  }
  const std::optional<Fit> heading = least_squares(rows, values);
  if (!heading) return refusal(vague);
  const double a_right = heading->unknowns(1);
  const double a_left = heading->unknowns(2);

  // Position: p = p0 + track c, where c is the way of a base of track 1.
  rows = Eigen::MatrixXd::Zero(2 * references, 3);
  values.resize(2 * references);
  std::complex<double> way;
  double angle = heading->unknowns(0);
  k = 0;
  for (std::size_t i = 0; i < run.size(); ++i) {
    if (i > 0) {
      const double right = a_right * (run[i].right_rad - run[i - 1].right_rad);
      const double left = a_left * (run[i].left_rad - run[i - 1].left_rad);
      way += (right + left) / 2 * Arc(angle, right - left, 1).way;
      angle += right - left;
    }
    if (!run[i].reference) continue;
    rows.row(k) << 1, 0, way.real();
    values(k++) = run[i].reference->x;
    rows.row(k) << 0, 1, way.imag();
    values(k++) = run[i].reference->y;
  }
  const std::optional<Fit> position = least_squares(rows, values);
  if (!position) return refusal(vague);
  const double track = position->unknowns(2);
  const double track_variance = position->covariance(2, 2);
  const auto radius_sd = [&](double a, int unknown) {
    return std::sqrt(track * track * heading->covariance(unknown, unknown) + a * a * track_variance);
  };
  const WheelCalibration result{.left_radius_m = a_left * track,
                                .right_radius_m = a_right * track,
                                .track_m = track,
                                .left_radius_sd_m = radius_sd(a_left, 2),
                                .right_radius_sd_m = radius_sd(a_right, 1),
                                .track_sd_m = std::sqrt(track_variance),
                                .heading_residual_rad = heading->residual,
                                .position_residual_m = position->residual * std::numbers::sqrt2};
  const auto certain = [](double value, double sd) { return sd <= 0.1 * std::abs(value); };
  if (!certain(result.left_radius_m, result.left_radius_sd_m) ||
      !certain(result.right_radius_m, result.right_radius_sd_m) || !certain(track, result.track_sd_m)) {
    return refusal(vague);
  }
  if (result.left_radius_m < 0 || result.right_radius_m < 0 || track < 0) {
    return refusal("calibrate wheels: a wheel counts backwards; give angles that grow when the base drives ahead");
  }
  return result;
}

namespace {

Eigen::RowVectorXd deviation_terms(double angle) {
  Eigen::RowVectorXd terms(5);
  terms << 1, std::sin(angle), std::cos(angle), std::sin(2 * angle), std::cos(2 * angle);
  return terms;
}

}  // namespace

CompassCalibration::CompassCalibration(const std::array<double, 5>& coefficients_rad)
    : coefficients_{coefficients_rad} {
  // A larger error could make the corrected heading turn backwards while the robot turns on.
  const auto& [a, b, c, d, e] = coefficients_;
  const double steepest = std::hypot(b, c) + 2 * std::hypot(d, e);
  require(steepest < 1, "compass deviation by heading", steepest, "recalibrate away from iron, it must stay below 1");
  require(std::abs(a) <= std::numbers::pi, "compass mounting angle", a, "give it in radians, within half a turn");
}

Result<CompassCalibration> CompassCalibration::fit(std::span<const CompassSample> run) {
  if (static_cast<Eigen::Index>(run.size()) < fewest_samples) {
    return refusal("calibrate compass: " + std::to_string(run.size()) + " samples; record at least " +
                   std::to_string(fewest_samples));
  }
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(run.size()), 5);
  Eigen::VectorXd values(rows.rows());
  std::array<bool, 12> visited{};
  // Errors are unwrapped about the first, so that a mounting near half a turn does not tear them apart.
  const double mounting = angle_between(run[0].reference_rad, run[0].measured_rad);
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    const auto& [measured, reference] = run[static_cast<std::size_t>(i)];
    if (!sane(measured) || !sane(reference)) return refusal("calibrate compass: a heading is not finite");
    rows.row(i) = deviation_terms(measured);
    values(i) = mounting + wrap_angle(measured - reference - mounting);
    const double turn = (wrap_angle(measured) + std::numbers::pi) / (2 * std::numbers::pi);
    visited[std::min(visited.size() - 1, static_cast<std::size_t>(turn * static_cast<double>(visited.size())))] = true;
  }
  for (std::size_t i = 0; i < visited.size(); ++i) {
    // Three empty twelfths side by side: a quarter of the circle is unknown.
    if (!visited[i] && !visited[(i + 1) % 12] && !visited[(i + 2) % 12]) {
      return refusal("calibrate compass: no samples between " + std::to_string(static_cast<int>(i) * 30 - 180) +
                     " and " + std::to_string(static_cast<int>(i) * 30 - 90) + " degrees; turn a full circle");
    }
  }
  const std::optional<Fit> fit = least_squares(rows, values);
  if (!fit) return refusal("calibrate compass: the headings do not determine the deviation; turn a full circle");
  const Eigen::VectorXd& u = fit->unknowns;
  if (std::hypot(u(1), u(2)) + 2 * std::hypot(u(3), u(4)) >= 1) {
    return refusal("calibrate compass: the deviation is steeper than the heading; move the compass away from iron");
  }
  return CompassCalibration{{wrap_angle(u(0)), u(1), u(2), u(3), u(4)}};
}

double CompassCalibration::error(double measured_rad) const {
  const auto& [a, b, c, d, e] = coefficients_;
  const double s1 = std::sin(measured_rad);
  const double c1 = std::cos(measured_rad);
  return a + b * s1 + c * c1 + d * 2 * s1 * c1 + e * (c1 * c1 - s1 * s1);
}

Result<WheelCalibration> umbmark(double left_radius_m, double right_radius_m, double track_m, double side_m,
                                 const SquareError& clockwise, const SquareError& counter_clockwise) {
  for (const double value : {left_radius_m, right_radius_m, track_m, side_m}) {
    if (!(value > 0 && std::isfinite(value))) {
      return Error{std::errc::invalid_argument, "radii, track and the side of the square must be above 0"};
    }
  }
  const SquareError& cw = clockwise;
  const SquareError& ccw = counter_clockwise;
  for (const double error : {cw.x_m, cw.y_m, ccw.x_m, ccw.y_m}) {
    if (!(std::abs(error) <= side_m / 4)) {
      return Error{std::errc::invalid_argument,
                   "errors above a quarter of the side: it slipped, or see the dimensions"};
    }
  }
  // To first order, with `over` the angle too much at each corner and `left` the one that each side bends to the left,
  // the errors are 2 L (over - left, over - left) clockwise and 2 L (over + left, -over - left) counter-clockwise.
  const double over = (cw.x_m + cw.y_m + ccw.x_m - ccw.y_m) / (8 * side_m);
  const double left = (ccw.x_m - ccw.y_m - cw.x_m - cw.y_m) / (8 * side_m);
  constexpr double corner = std::numbers::pi / 2;
  const double track = track_m * corner / (corner + over);
  const double curvature = 2 * std::sin(left / 2) / side_m;
  const double right_by_left = (1 + curvature * track / 2) / (1 - curvature * track / 2);
  return WheelCalibration{.left_radius_m = left_radius_m * 2 / (1 + right_by_left),
                          .right_radius_m = right_radius_m * 2 / (1 + 1 / right_by_left),
                          .track_m = track};
}

}  // namespace regista::control
