// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>

namespace regista::control {

/// Estimate of `n` states with the equations of Kalman, linear or linearised by the caller; fixed size, no allocation.
/// `channels` states side by side may share one covariance, when the same model and the same measurements apply to
/// all of them, as to x and y of a point: each column of `x` is one.
template <int n, int channels = 1>
struct KalmanFilter {
  using State = Eigen::Matrix<double, n, channels>;
  using Covariance = Eigen::Matrix<double, n, n>;

  State x = State::Zero();
  Covariance p = Covariance::Identity();  ///< symmetric and positive

  /// x becomes f x + input, p becomes f p f' + q.
  void predict(const Covariance& f, const Covariance& q, const State& input = State::Zero()) {
    x = f * x + input;
    p = f * p * f.transpose() + q;
    make_symmetric();
  }

  struct Innovation {
    double nis;  ///< normalised innovation squared: y' inverse(s) y, summed over the channels
    bool fused;
  };

  /// Correct by what was measured minus what the estimate says, `innovation`, so that the caller can wrap angles;
  /// `h` is the derivative of the measurement by the state, `r` its covariance. An innovation further than `gate`
  /// standard deviations (Mahalanobis) changes nothing.
  template <int m>
  Innovation correct(const Eigen::Matrix<double, m, channels>& innovation, const Eigen::Matrix<double, m, n>& h,
                     const Eigen::Matrix<double, m, m>& r, double gate) {
    static_assert(m <= 4, "the inverse below is in closed form up to 4");
    const Eigen::Matrix<double, n, m> ph = p * h.transpose();
    const Eigen::Matrix<double, m, m> inverse_s = (h * ph + r).inverse();
    const double nis = innovation.cwiseProduct(inverse_s * innovation).sum();
    if (!(nis <= gate * gate)) return {.nis = nis, .fused = false};
    const Eigen::Matrix<double, n, m> k = ph * inverse_s;
    x += k * innovation;
    // Joseph's form (I - k h) p (I - k h)' + k r k', factor by factor: n² m products instead of n³.
    p -= k * ph.transpose();
    const Eigen::Matrix<double, n, m> rest = p * h.transpose() - k * r;
    p -= rest * k.transpose();
    make_symmetric();
    return {.nis = nis, .fused = true};
  }

  /// State `i` is known anew, with this variance and no relation to the others; the caller sets x(i).
  void forget(int i, double variance) {
    p.row(i).setZero();
    p.col(i).setZero();
    p(i, i) = variance;
  }

 private:
  void make_symmetric() { p = (0.5 * (p + p.transpose())).eval(); }
};

}  // namespace regista::control
