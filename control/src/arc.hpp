// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <complex>

namespace regista::control {

/// The way through `t` seconds at constant body velocity, as complex numbers (x + iy on the field): a velocity
/// v = vx + i vy moves the body by v * `way`, exactly, and `way_by_turn` is the derivative by the turn w t.
struct Arc {
  std::complex<double> way;          ///< [s]
  std::complex<double> way_by_turn;  ///< [s/rad]

  Arc(double heading, double w, double t) {
    // The integral of exp(i(heading + w τ)) over τ in [0, t] is t sinc(h) exp(i(heading + h)) with h = w t / 2.
    const double h = w * t / 2;
    const double h2 = h * h;
    double sinc = 0;
    double slope = 0;
    if (h2 < 0.01) {
      // The quotients lose digits as h² near 0. The first omitted terms are below 1e-17 here.
      sinc = 1 + h2 * (-1.0 / 6 + h2 * (1.0 / 120 + h2 * (-1.0 / 5040 + h2 / 362880)));
      slope = h * (-1.0 / 3 + h2 * (1.0 / 30 + h2 * (-1.0 / 840 + h2 * (1.0 / 45360 - h2 / 3991680))));
    } else {
      sinc = std::sin(h) / h;
      slope = (std::cos(h) - sinc) / h;
    }
    const double c = std::cos(heading + h);
    const double s = std::sin(heading + h);
    way = {t * sinc * c, t * sinc * s};
    way_by_turn = {t / 2 * (slope * c - sinc * s), t / 2 * (slope * s + sinc * c)};
  }
};

}  // namespace regista::control
