// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>
#include <regista/ssl/vision.hpp>
#include <vector>

namespace regista::camera {

/// A whole run in one picture: what moved, as it was at intervals, before what did not, and the ways of the robots.
class Overlay {
 public:
  /// Throws std::runtime_error when there are more than a few hundred.
  void add_picture(const cv::Mat& picture);
  /// Of every picture, also between those.
  void add_robots(const std::vector<ssl::DetectedRobot>& robots);

  /// Throws std::runtime_error without a picture.
  [[nodiscard]] cv::Mat compose() const;

 private:
  struct Way {
    ssl::RobotId id;
    std::vector<cv::Point2d> pixels;
  };

  [[nodiscard]] cv::Mat background() const;

  std::vector<cv::Mat> pictures_;
  std::vector<Way> ways_;
};

}  // namespace regista::camera
