// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <random>
#include <regista/camera/projection.hpp>

#include "rendered_field.hpp"

namespace regista::camera {
namespace {

std::vector<Point3d> somewhere(std::size_t count) {
  std::mt19937 random{1};
  std::uniform_real_distribution<double> x{-3, 3};
  std::uniform_real_distribution<double> z{0, 0.2};
  std::vector<Point3d> points;
  for (std::size_t i = 0; i < count; ++i) points.push_back({.x = x(random), .y = x(random), .z = z(random)});
  return points;
}

rendered::Camera tilted(double distortion) {
  auto camera = rendered::Camera::above(0.3, -0.2, 4, 0.2, 1.2);
  camera.distortion = distortion;
  return camera;
}

TEST(Projection, agrees_with_opencv_without_distortion) {
  const auto camera = tilted(0);
  const cv::Matx33d matrix{camera.focal_px, 0, camera.principal.x, 0, camera.focal_px, camera.principal.y, 0, 0, 1};
  for (const Point3d& point : somewhere(1000)) {
    std::vector<cv::Point2d> theirs;
    cv::projectPoints(std::vector{cv::Point3d{point.x, point.y, point.z}}, camera.rotation, camera.translation, matrix,
                      cv::noArray(), theirs);
    const auto ours = project(camera.calibration(), point);
    ASSERT_TRUE(ours);
    EXPECT_NEAR(ours->x, theirs[0].x, 1e-9);
    EXPECT_NEAR(ours->y, theirs[0].y, 1e-9);
  }
}

TEST(Projection, agrees_with_opencv_for_barrels_and_pincushions) {
  for (const double distortion : {-0.02, 0.05, 0.2}) {
    const auto camera = tilted(distortion);
    for (const Point3d& point : somewhere(1000)) {
      const cv::Point2d theirs = camera.see({point.x, point.y, point.z});
      const auto ours = project(camera.calibration(), point);
      ASSERT_TRUE(ours);
      EXPECT_NEAR(ours->x, theirs.x, 1e-6) << distortion;
      EXPECT_NEAR(ours->y, theirs.y, 1e-6) << distortion;
    }
  }
}

TEST(Projection, comes_back_to_the_point_at_its_height) {
  for (const double distortion : {-0.02, 0.0, 0.2}) {
    const ssl::CameraCalibration camera = tilted(distortion).calibration();
    for (const Point3d& point : somewhere(1000)) {
      const auto back = to_field(camera, *project(camera, point), point.z);
      ASSERT_TRUE(back);
      EXPECT_NEAR(back->x, point.x, 1e-9);
      EXPECT_NEAR(back->y, point.y, 1e-9);
    }
  }
}

TEST(Projection, finds_the_camera) {
  const Point3d place = ssl::position(tilted(0).calibration());
  EXPECT_NEAR(place.x, 0.3, 1e-12);
  EXPECT_NEAR(place.y, -0.2, 1e-12);
  EXPECT_NEAR(place.z, 4, 1e-12);
}

TEST(Projection, sees_nothing_behind_the_camera_or_above_the_horizon) {
  const ssl::CameraCalibration flat = rendered::Camera::above(0, 0, 4, rendered::pi / 2 - 0.1).calibration();
  EXPECT_FALSE(project(flat, {.x = 0, .y = -100, .z = 0}) && project(flat, {.x = 0, .y = 100, .z = 0}));
  EXPECT_FALSE(project(tilted(0).calibration(), {.x = 0, .y = 0, .z = 5}));
  const bool top = to_field(flat, {.x = 390, .y = 0}, 0).has_value();
  const bool bottom = to_field(flat, {.x = 390, .y = 579}, 0).has_value();
  EXPECT_NE(top, bottom);
}

}  // namespace
}  // namespace regista::camera
