// SPDX-License-Identifier: Apache-2.0
#include "overlay.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace regista::camera {

void Overlay::add_picture(const cv::Mat& picture) {
  constexpr std::size_t most = 300;
  if (pictures_.size() == most) throw std::runtime_error{"the run has more than 300 pictures: take a longer --every"};
  if (!pictures_.empty() && picture.size() != pictures_.front().size())
    throw std::runtime_error{"the pictures differ in size"};
  pictures_.push_back(picture.clone());
}

void Overlay::add_robots(const std::vector<ssl::DetectedRobot>& robots) {
  for (const ssl::DetectedRobot& robot : robots) {
    auto way = std::ranges::find(ways_, robot.id, &Way::id);
    if (way == ways_.end()) way = ways_.insert(ways_.end(), {robot.id, {}});
    way->pixels.emplace_back(robot.pixel_x, robot.pixel_y);
  }
}

/// Of each channel of each pixel the median: what was there most of the time.
cv::Mat Overlay::background() const {
  cv::Mat result = pictures_.front().clone();
  std::vector<std::uint8_t> values(pictures_.size());
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  for (int y = 0; y < result.rows; ++y) {
    for (int i = 0; i < 3 * result.cols; ++i) {
      for (std::size_t p = 0; p < pictures_.size(); ++p) values[p] = pictures_[p].ptr(y)[i];
      std::ranges::nth_element(values, middle);
      result.ptr(y)[i] = *middle;
    }
  }
  return result;
}

cv::Mat Overlay::compose() const {
  if (pictures_.empty()) throw std::runtime_error{"the run has no pictures"};
  const cv::Mat still = background();
  cv::Mat result = still.clone();
  for (const cv::Mat& picture : pictures_) {
    cv::Mat difference;
    cv::absdiff(picture, still, difference);
    std::vector<cv::Mat> channels;
    cv::split(difference, channels);
    const cv::Mat most = cv::max(channels[0], cv::max(channels[1], channels[2]));
    constexpr int moved = 30;
    cv::Mat mask = most > moved;
    // Specks of noise go; holes in a black top on dark carpet close.
    cv::morphologyEx(mask, mask, cv::MORPH_OPEN, cv::getStructuringElement(cv::MORPH_ELLIPSE, {3, 3}));
    cv::morphologyEx(mask, mask, cv::MORPH_CLOSE, cv::getStructuringElement(cv::MORPH_ELLIPSE, {9, 9}));
    picture.copyTo(result, mask);
  }
  for (const Way& way : ways_) {
    constexpr int shift = 4;
    std::vector<cv::Point> points;
    for (const cv::Point2d& p : way.pixels) points.emplace_back(p * (1 << shift));
    const cv::Scalar colour = way.id.team == ssl::Team::yellow ? cv::Scalar{0, 230, 255} : cv::Scalar{255, 150, 60};
    cv::polylines(result, points, false, colour, 1, cv::LINE_AA, shift);
  }
  return result;
}

}  // namespace regista::camera
