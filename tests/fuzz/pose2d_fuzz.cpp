// SPDX-License-Identifier: Apache-2.0
#include <regista/core/geometry.hpp>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <numbers>

using regista::Pose2d;

namespace {

/// The search goes on until one of these aborts.
void require(bool condition) {
  if (!condition) std::abort();
}

bool is_wrapped(double angle_rad) { return angle_rad > -std::numbers::pi && angle_rad <= std::numbers::pi; }

}  // namespace

/// Any two poses, NaN and infinities among them: headings stay wrapped, and a pose and its inverse cancel.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Pose2d poses[2];
  if (size < sizeof poses) return 0;
  std::memcpy(poses, data, sizeof poses);
  const auto& [a, b] = poses;

  require(std::isfinite(a.heading) ? is_wrapped(regista::wrap_angle(a.heading))
                                   : std::isnan(regista::wrap_angle(a.heading)));
  const Pose2d chained = a * b;
  require(is_wrapped(chained.heading) || !std::isfinite(a.heading + b.heading));

  // What is lost grows with the heading, for a turn is not exactly 2 pi in binary, and that error swings the position.
  if (!(std::abs(a.heading) < 1e3 && std::abs(a.x) < 1e6 && std::abs(a.y) < 1e6)) return 0;
  const double angle_error = std::numeric_limits<double>::epsilon() * (4 + std::abs(a.heading));
  const Pose2d none = regista::inverse(a) * a;
  constexpr double denormal = std::numeric_limits<double>::min();  // Where rounding is no longer relative.
  require(std::hypot(none.x, none.y) <= angle_error * std::hypot(a.x, a.y) + denormal);
  require(std::abs(none.heading) <= angle_error);
  return 0;
}
