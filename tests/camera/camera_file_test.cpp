// SPDX-License-Identifier: Apache-2.0
#include "camera_file.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <regista/device/config.hpp>

namespace regista::camera {
namespace {

std::filesystem::path write(const std::string& text) {
  const std::filesystem::path file = testing::TempDir() + "camera_file_test.cfg";
  std::ofstream{file} << text;
  return file;
}

std::string complaint(const std::string& text) {
  try {
    (void)read_camera_file(write(text));
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "";
}

TEST(CameraFile, comes_back_as_it_was_written) {
  CameraFile camera;
  camera.camera = {.camera = 3,
                   .focal_px = 812.25,
                   .principal_x_px = 640.5,
                   .principal_y_px = 511.75,
                   .distortion = 0.125,
                   .rotation = {0.6, 0, 0, 0.8},
                   .translation = {.x = 1, .y = -2, .z = 3.5},
                   .width_px = 1280,
                   .height_px = 1024};
  camera.has_pose = true;
  camera.field = division_a();
  camera.detector.blue_height_m = 0.125;
  camera.detector.colours[0].bgr = {1, 2, 3};
  const std::filesystem::path file = testing::TempDir() + "camera_file_test.cfg";
  write_camera_file(file, camera);
  const CameraFile again = read_camera_file(file);
  EXPECT_EQ(again.camera.camera, 3U);
  EXPECT_EQ(again.camera.focal_px, 812.25);
  EXPECT_EQ(again.camera.principal_y_px, 511.75);
  EXPECT_EQ(again.camera.distortion, 0.125);
  EXPECT_NEAR(again.camera.rotation[0], 0.6, 1e-9);
  EXPECT_NEAR(again.camera.rotation[3], 0.8, 1e-9);
  EXPECT_EQ(again.camera.translation, (Point3d{.x = 1, .y = -2, .z = 3.5}));
  EXPECT_EQ(again.camera.width_px, 1280U);
  EXPECT_TRUE(again.has_pose);
  EXPECT_EQ(again.field.length_m, 12);
  EXPECT_EQ(again.field.defence_width_m, 3.6);
  EXPECT_EQ(again.detector.yellow_height_m, 0.15);
  EXPECT_EQ(again.detector.blue_height_m, 0.125);
  EXPECT_EQ(again.detector.colours[0].bgr, (Bgr{1, 2, 3}));
}

TEST(CameraFile, says_where_it_is_wrong) {
  EXPECT_NE(complaint("field( length 9 )").find("no section 'camera'"), std::string::npos);
  EXPECT_NE(complaint("camera( size [780 580]\n focal 0 )").find(":2:8: 'focal' is 0"), std::string::npos);
  EXPECT_NE(complaint("camera( size [780] )").find("must be 2 numbers"), std::string::npos);
  EXPECT_NE(complaint("camera( size [780 580] rotation [1 1 0 0] translation [0 0 4] )").find("length 1"),
            std::string::npos);
  EXPECT_NE(complaint("camera( size [780 580] focus 3 )").find("'focus'"), std::string::npos);
  EXPECT_NE(complaint("camera( size [780 580] )\ncolour( name \"red\" bgr [0 0 9] spread [1 1 1] )").find("orange"),
            std::string::npos);
  EXPECT_NE(complaint("camera( size [780 580] )\ncamera( size [780 580] )").find("second section"), std::string::npos);
}

}  // namespace
}  // namespace regista::camera
