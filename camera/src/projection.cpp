// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <regista/camera/projection.hpp>

namespace regista::camera {

namespace {

Point3d cross(const Point3d& a, const Point3d& b) {
  return {.x = a.y * b.z - a.z * b.y, .y = a.z * b.x - a.x * b.z, .z = a.x * b.y - a.y * b.x};
}

/// v + 2 q × (q × v + w v), the rotation of v by a unit quaternion.
Point3d rotate(const Point3d& q, double w, const Point3d& v) {
  const Point3d u = cross(q, v);
  const Point3d twice = cross(q, {.x = u.x + w * v.x, .y = u.y + w * v.y, .z = u.z + w * v.z});
  return {.x = v.x + 2 * twice.x, .y = v.y + 2 * twice.y, .z = v.z + 2 * twice.z};
}

/// The root of r (1 + k r²) = `undistorted`. Newton's steps come from one side, as the cubic bends only one way.
std::optional<double> distort(double undistorted, double k) {
  // Where the cubic of a pincushion turns down: nothing is seen further out.
  if (k < 0 && undistorted > 2.0 / 3 / std::sqrt(-3 * k)) return {};
  double r = undistorted;
  for (int i = 0; i < 50; ++i) {
    const double step = (r * (1 + k * r * r) - undistorted) / (1 + 3 * k * r * r);
    r -= step;
    if (std::abs(step) < 1e-12) break;
  }
  return r;
}

}  // namespace

std::optional<Pixel> project(const ssl::CameraCalibration& camera, const Point3d& point) {
  const auto& [qx, qy, qz, qw] = camera.rotation;
  const Point3d turned = rotate({.x = qx, .y = qy, .z = qz}, qw, point);
  const double z = turned.z + camera.translation.z;
  if (z <= 0) return {};
  const double x = (turned.x + camera.translation.x) / z;
  const double y = (turned.y + camera.translation.y) / z;
  const double radius = std::hypot(x, y);
  const auto distorted = distort(radius, camera.distortion);
  if (!distorted) return {};
  const double scale = camera.focal_px * (radius > 0 ? *distorted / radius : 1);
  return Pixel{.x = camera.principal_x_px + scale * x, .y = camera.principal_y_px + scale * y};
}

Pixel undistort(const ssl::CameraCalibration& camera, const Pixel& pixel) {
  const double x = (pixel.x - camera.principal_x_px) / camera.focal_px;
  const double y = (pixel.y - camera.principal_y_px) / camera.focal_px;
  const double scale = 1 + camera.distortion * (x * x + y * y);
  return {.x = x * scale, .y = y * scale};
}

std::optional<Point3d> to_field(const ssl::CameraCalibration& camera, const Pixel& pixel, double height_m) {
  const auto& [qx, qy, qz, qw] = camera.rotation;
  const Pixel direction = undistort(camera, pixel);
  const Point3d ray = rotate({.x = -qx, .y = -qy, .z = -qz}, qw, {.x = direction.x, .y = direction.y, .z = 1});
  const Point3d from = ssl::position(camera);
  const double distance = (height_m - from.z) / ray.z;
  constexpr double farthest_m = 100;  // no field is larger
  if (!(distance > 0 && distance < farthest_m)) return {};
  return Point3d{.x = from.x + distance * ray.x, .y = from.y + distance * ray.y, .z = height_m};
}

}  // namespace regista::camera
