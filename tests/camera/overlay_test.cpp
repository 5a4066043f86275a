// SPDX-License-Identifier: Apache-2.0
#include "overlay.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "source.hpp"

namespace regista::camera {
namespace {

namespace fs = std::filesystem;

cv::Mat with_square(int x) {
  cv::Mat picture{100, 200, CV_8UC3, cv::Scalar{40, 90, 40}};
  cv::rectangle(picture, {x, 40, 20, 20}, {20, 20, 20}, cv::FILLED);
  return picture;
}

TEST(Overlay, shows_what_moved_at_each_place_and_its_way) {
  Overlay overlay;
  for (const int x : {10, 50, 90, 130}) {
    overlay.add_picture(with_square(x));
    overlay.add_robots({{.id = {ssl::Team::yellow, 1}, .pixel_x = x + 10.0, .pixel_y = 30}});
  }
  const cv::Mat picture = overlay.compose();
  for (const int x : {10, 50, 90, 130}) EXPECT_EQ(picture.at<cv::Vec3b>(50, x + 10), (cv::Vec3b{20, 20, 20})) << x;
  for (const int x : {40, 80, 120, 170}) EXPECT_EQ(picture.at<cv::Vec3b>(50, x), (cv::Vec3b{40, 90, 40})) << x;
  EXPECT_GT(picture.at<cv::Vec3b>(30, 75)[2], 150);  // the yellow way between two of them
  EXPECT_EQ(picture.at<cv::Vec3b>(30, 180), (cv::Vec3b{40, 90, 40}));
}

TEST(Overlay, refuses_what_it_cannot_draw) {
  Overlay overlay;
  EXPECT_THROW((void)overlay.compose(), std::runtime_error);
  overlay.add_picture(with_square(0));
  EXPECT_THROW(overlay.add_picture(cv::Mat(10, 10, CV_8UC3)), std::runtime_error);
}

class SourceTest : public testing::Test {
 protected:
  SourceTest() : folder_{testing::TempDir() + "source_test"} {
    fs::remove_all(folder_);
    fs::create_directory(folder_);
  }
  ~SourceTest() override { fs::remove_all(folder_); }
  fs::path folder_;
};

TEST_F(SourceTest, gives_a_folders_pictures_in_the_order_of_their_names) {
  for (const int x : {90, 10, 50}) cv::imwrite(folder_ / (std::to_string(100 + x) + ".png"), with_square(x));
  Source source{folder_.string(), {}};
  EXPECT_FALSE(source.is_device());
  EXPECT_EQ(source.rate_hz(), 60);
  for (const int x : {10, 50, 90}) {
    const auto picture = source.next();
    ASSERT_TRUE(picture);
    EXPECT_EQ(picture->at<cv::Vec3b>(50, x + 10), (cv::Vec3b{20, 20, 20}));
  }
  EXPECT_FALSE(source.next());
}

TEST_F(SourceTest, plays_a_film_at_its_rate) {
  const std::string film = (folder_ / "film.avi").string();
  cv::VideoWriter writer{film, cv::CAP_OPENCV_MJPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 25, {200, 100}};
  ASSERT_TRUE(writer.isOpened());
  for (const int x : {10, 50}) writer.write(with_square(x));
  writer.release();
  Source source{film, {}};
  EXPECT_NEAR(source.rate_hz(), 25, 0.01);
  EXPECT_TRUE(source.next());
  EXPECT_TRUE(source.next());
  EXPECT_FALSE(source.next());
}

TEST_F(SourceTest, says_what_it_cannot_open) {
  EXPECT_THROW(Source("/nowhere", {}), std::runtime_error);
  EXPECT_THROW(Source(folder_.string(), {}), std::runtime_error);  // empty
  const fs::path cut = folder_ / "cut.png";
  cv::imwrite(cut, with_square(10));
  fs::resize_file(cut, 60);
  Source source{cut.string(), {}};
  EXPECT_THROW((void)source.next(), std::runtime_error);
}

}  // namespace
}  // namespace regista::camera
