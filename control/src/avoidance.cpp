// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <regista/control/avoidance.hpp>

#include "parameter.hpp"

namespace regista::control {
namespace {

struct Vector {
  double x = 0;
  double y = 0;

  friend Vector operator+(const Vector& a, const Vector& b) { return {a.x + b.x, a.y + b.y}; }
  friend Vector operator-(const Vector& a, const Vector& b) { return {a.x - b.x, a.y - b.y}; }
  friend Vector operator*(double s, const Vector& a) { return {s * a.x, s * a.y}; }
};

double dot(const Vector& a, const Vector& b) { return a.x * b.x + a.y * b.y; }
double cross(const Vector& a, const Vector& b) { return a.x * b.y - a.y * b.x; }
double length(const Vector& a) { return std::sqrt(dot(a, a)); }

Vector turned(const Vector& a, double angle_rad) {
  const double c = std::cos(angle_rad);
  const double s = std::sin(angle_rad);
  return {c * a.x - s * a.y, s * a.x + c * a.y};
}

/// Velocities to the left of the line are allowed.
struct HalfPlane {
  Vector point;
  Vector direction;

  [[nodiscard]] double violation(const Vector& v) const { return cross(direction, point - v); }
};

/// Velocities within reach.
struct Circle {
  Vector centre;
  double radius;
};

using Planes = std::span<const HalfPlane>;

// The relative velocities that lead to a collision within the horizon form a cone with a rounded tip. u is the
// smallest change that leaves it, at the tip or at a leg.
HalfPlane half_plane(const Disc& self, const Disc& other, double margin_m, double horizon_s) {
  const Vector between{other.x - self.x, other.y - self.y};
  const Vector own{self.velocity.x, self.velocity.y};
  const Vector relative = own - Vector{other.velocity.x, other.velocity.y};
  const double radius = self.radius_m + other.radius_m + margin_m;
  const double distance = length(between);

  Vector u;
  HalfPlane plane;
  const auto leave_tip = [&](double time_s) {
    const Vector w = relative - (1 / time_s) * between;
    const double w_length = length(w);
    const Vector outward = w_length > 0 ? (1 / w_length) * w : Vector{.x = -1, .y = 0};
    plane.direction = {outward.y, -outward.x};
    u = (radius / time_s - w_length) * outward;
  };
  const Vector w = relative - (1 / horizon_s) * between;
  if (distance <= radius) {
    // Already too near: apart again within a tenth of a second, which a robot at 1 m/s takes to brake.
    leave_tip(0.1);
  } else if (dot(w, between) < 0 && dot(w, between) * dot(w, between) > radius * radius * dot(w, w)) {
    leave_tip(horizon_s);
  } else {
    const double leg = std::sqrt((distance - radius) * (distance + radius));
    const double side = cross(between, w) > 0 ? 1 : -1;
    const Vector along{leg * between.x - side * radius * between.y, side * radius * between.x + leg * between.y};
    plane.direction = (side / (distance * distance)) * along;
    u = dot(relative, plane.direction) * plane.direction - relative;
  }
  plane.point = own + (other.cooperates ? 0.5 : 1) * u;
  return plane;
}

/// Where on the line of `planes[index]`, within the circle and the planes before it, one is nearest to `wish`; or
/// farthest in its direction. False when there is no such place.
bool on_line(Planes planes, std::size_t index, const Circle& reach, const Vector& wish, bool direction_only,
             Vector& result) {
  const auto& [point, direction] = planes[index];
  const Vector from_centre = point - reach.centre;
  const double middle = dot(from_centre, direction);
  const double discriminant = middle * middle + reach.radius * reach.radius - dot(from_centre, from_centre);
  if (discriminant < 0) return false;
  double low = -middle - std::sqrt(discriminant);
  double high = -middle + std::sqrt(discriminant);
  for (const HalfPlane& other : planes.first(index)) {
    const double denominator = cross(direction, other.direction);
    const double numerator = cross(other.direction, point - other.point);
    if (std::abs(denominator) < 1e-9) {
      if (numerator < 0) return false;
      continue;
    }
    const double t = numerator / denominator;
    denominator >= 0 ? high = std::min(high, t) : low = std::max(low, t);
    if (low > high) return false;
  }
  const double t =
      direction_only ? (dot(wish, direction) > 0 ? high : low) : std::clamp(dot(direction, wish - point), low, high);
  result = point + t * direction;
  return true;
}

/// The velocity nearest to the wish (or farthest in its direction) that all planes allow. Returns how many could be
/// met; `result` meets these (de Berg et al., Computational Geometry, 4.4).
std::size_t within(Planes planes, const Circle& reach, const Vector& wish, bool direction_only, Vector& result) {
  const Vector off = wish - reach.centre;
  const double far = length(off);
  if (direction_only) {
    result = reach.centre + reach.radius * wish;
  } else {
    result = far > reach.radius ? reach.centre + (reach.radius / far) * off : wish;
  }
  for (std::size_t i = 0; i < planes.size(); ++i) {
    if (planes[i].violation(result) <= 0) continue;
    const Vector before = result;
    if (!on_line(planes, i, reach, wish, direction_only, result)) {
      result = before;
      return i;
    }
  }
  return planes.size();
}

/// From plane `first` on, the velocity for which the largest violation is least: a linear programme in three
/// dimensions, one plane at a time.
void least_violation(Planes planes, std::size_t first, const Circle& reach, Vector& result) {
  double violation = 0;
  for (std::size_t i = first; i < planes.size(); ++i) {
    if (planes[i].violation(result) <= violation) continue;
    std::array<HalfPlane, Avoidance::capacity> bisectors;  // where another plane is violated as much as this one
    std::size_t count = 0;
    for (const HalfPlane& other : planes.first(i)) {
      const double sine = cross(planes[i].direction, other.direction);
      HalfPlane bisector;
      if (std::abs(sine) <= 1e-9) {
        if (dot(planes[i].direction, other.direction) > 0) continue;
        bisector.point = 0.5 * (planes[i].point + other.point);
      } else {
        bisector.point =
            planes[i].point + (cross(other.direction, planes[i].point - other.point) / sine) * planes[i].direction;
      }
      const Vector difference = other.direction - planes[i].direction;
      bisector.direction = (1 / length(difference)) * difference;
      bisectors[count++] = bisector;
    }
    const Vector inward{-planes[i].direction.y, planes[i].direction.x};
    const Vector before = result;
    if (within(Planes{bisectors}.first(count), reach, inward, true, result) < count) result = before;
    violation = planes[i].violation(result);
  }
}

bool all_sane(const Disc& disc) {
  return sane(disc.x) && sane(disc.y) && sane(disc.velocity.x) && sane(disc.velocity.y) && sane(disc.radius_m) &&
         disc.radius_m >= 0;
}

}  // namespace

Avoidance::Avoidance(const AvoidanceConfig& config) : config_{config} {
  require_positive("speed_mps", config.speed_mps);
  require_positive("acceleration_mps2", config.acceleration_mps2);
  require(seconds(config.horizon) >= config.speed_mps / config.acceleration_mps2, "horizon", seconds(config.horizon),
          "give at least speed_mps / acceleration_mps2 seconds, or it cannot brake in time");
  require_not_negative("margin_m", config.margin_m);
}

Avoidance::Output Avoidance::step(const Disc& self, const FieldVelocity& preferred, std::span<const Disc> others,
                                  Duration dt) {
  const Circle reach{.centre = {self.velocity.x, self.velocity.y}, .radius = config_.acceleration_mps2 * seconds(dt)};
  if (others.size() > capacity || !all_sane(self) || !std::all_of(others.begin(), others.end(), all_sane) ||
      !sane(preferred.x) || !sane(preferred.y) || !sane(preferred.w)) {
    ++refused_;
    const double speed = length(reach.centre);
    const double rest = speed > reach.radius ? 1 - reach.radius / speed : 0;
    const bool known = sane(self.velocity.x) && sane(self.velocity.y);
    return {
        .velocity = known ? FieldVelocity{.x = rest * self.velocity.x, .y = rest * self.velocity.y} : FieldVelocity{},
        .clear = false,
        .refused = true};
  }

  std::array<HalfPlane, capacity> planes;
  for (std::size_t i = 0; i < others.size(); ++i) {
    planes[i] = half_plane(self, others[i], config_.margin_m, seconds(config_.horizon));
  }
  const Planes all = Planes{planes}.first(others.size());

  // Keep to the right a little: who meets head-on would otherwise brake to a stand face to face.
  Vector wish = turned({preferred.x, preferred.y}, others.empty() ? 0 : -0.05);
  if (const double speed = length(wish); speed > config_.speed_mps) wish = (config_.speed_mps / speed) * wish;

  Vector result;
  const std::size_t met = within(all, reach, wish, false, result);
  if (met < all.size()) least_violation(all, met, reach, result);
  if (const double speed = length(result); speed > config_.speed_mps) result = (config_.speed_mps / speed) * result;
  return {.velocity = {.x = result.x, .y = result.y, .w = preferred.w}, .clear = met == all.size()};
}

}  // namespace regista::control
