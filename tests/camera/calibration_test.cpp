// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <random>
#include <regista/camera/calibration.hpp>
#include <regista/camera/projection.hpp>

#include "rendered_field.hpp"

namespace regista::camera {
namespace {

std::vector<View> boards(const rendered::Camera& camera) {
  std::vector<View> views;
  for (int i = 0; i < rendered::boards; ++i) {
    const cv::Mat picture = rendered::render_board(camera, i);
    const auto view =
        find_board(rendered::view(picture), rendered::board_columns, rendered::board_rows, rendered::square_m);
    if (view) views.push_back(*view);
  }
  return views;
}

TEST(FitLens, recovers_the_lens_from_pictures_of_a_board) {
  for (const double distortion : {0.02, 0.15}) {
    rendered::Camera truth;
    truth.distortion = distortion;
    const std::vector<View> views = boards(truth);
    ASSERT_GE(views.size(), 7U);
    const auto fit = fit_lens(views, {.width_px = 780, .height_px = 580});
    ASSERT_TRUE(fit) << fit.error().message();
    EXPECT_NEAR(fit->camera.focal_px, truth.focal_px, 1.0);
    EXPECT_NEAR(fit->camera.principal_x_px, truth.principal.x, 1.5);
    EXPECT_NEAR(fit->camera.principal_y_px, truth.principal.y, 1.5);
    EXPECT_NEAR(fit->camera.distortion, distortion, 0.004);
    EXPECT_LT(fit->rms_px, 0.1);
  }
}

TEST(FitLens, wants_three_boards) {
  const auto fit = fit_lens({}, {.width_px = 780, .height_px = 580});
  ASSERT_FALSE(fit);
  EXPECT_NE(fit.error().message().find("at least 3"), std::string::npos);
}

/// Points of the field's lines, pointed at within half a pixel.
View clicked(const rendered::Camera& camera, double error_px) {
  std::mt19937 random{3};
  std::uniform_real_distribution<double> miss{-error_px, error_px};
  View view;
  for (const auto& [x, y] : rendered::landmarks) {
    const cv::Point2d pixel = camera.see({x, y, 0});
    view.points.push_back({.x = x, .y = y});
    view.pixels.push_back({.x = pixel.x + miss(random), .y = pixel.y + miss(random)});
  }
  return view;
}

TEST(FitPose, recovers_where_the_camera_is) {
  const auto truth = rendered::Camera::above(0.1, 0.05, 4, 0.15, 2.0);
  ssl::CameraCalibration lens = truth.calibration();
  lens.rotation = {0, 0, 0, 1};
  lens.translation = {};
  const auto fit = fit_pose(clicked(truth, 0), lens);
  ASSERT_TRUE(fit) << fit.error().message();
  EXPECT_LT(fit->rms_px, 1e-4);
  const Point3d place = ssl::position(fit->camera);
  EXPECT_NEAR(place.x, 0.1, 1e-5);
  EXPECT_NEAR(place.y, 0.05, 1e-5);
  EXPECT_NEAR(place.z, 4, 1e-5);
}

TEST(FitPose, forgives_clicks_that_miss_by_half_a_pixel) {
  const auto truth = rendered::Camera::above(0.1, 0.05, 4, 0.15, -1.0);
  const auto fit = fit_pose(clicked(truth, 0.5), truth.calibration());
  ASSERT_TRUE(fit);
  double worst_m = 0;
  for (double x = -2; x <= 2; x += 0.5) {
    for (double y = -1.5; y <= 1.5; y += 0.5) {
      const cv::Point2d pixel = truth.see({x, y, 0.15});
      const auto found = to_field(fit->camera, {.x = pixel.x, .y = pixel.y}, 0.15);
      ASSERT_TRUE(found);
      worst_m = std::max(worst_m, std::hypot(found->x - x, found->y - y));
    }
  }
  EXPECT_LT(worst_m, 0.006);
}

TEST(FitPose, says_why_it_cannot) {
  const auto truth = rendered::Camera::above(0, 0, 4);
  const auto text = [](const Result<CalibrationFit>& fit) { return fit ? "" : fit.error().message(); };
  View few = clicked(truth, 0);
  few.points.resize(3);
  few.pixels.resize(3);
  EXPECT_NE(text(fit_pose(few, truth.calibration())).find("at least 4"), std::string::npos);
  View line = clicked(truth, 0);
  line.points.resize(5);  // all on the halfway line
  line.pixels.resize(5);
  EXPECT_NE(text(fit_pose(line, truth.calibration())).find("in one line"), std::string::npos);
  EXPECT_NE(text(fit_pose(clicked(truth, 0), {})).find("before its lens"), std::string::npos);
  View mirrored = clicked(truth, 0);
  for (Point3d& point : mirrored.points) point.y = -point.y;
  EXPECT_NE(text(fit_pose(mirrored, truth.calibration())).find("mixed up"), std::string::npos);
}

}  // namespace
}  // namespace regista::camera
