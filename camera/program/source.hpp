// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/videoio.hpp>
#include <optional>
#include <regista/camera/image.hpp>
#include <regista/core/time.hpp>
#include <string>
#include <vector>

namespace regista::camera {

struct SourceOptions {
  /// [Hz] of a folder's pictures or a film, 0: that of the film, or 60. For a device: what it is asked for, 0: its own.
  double rate_hz = 0;
  int width_px = 0;  ///< what a device is asked for; 0: its own
  int height_px = 0;
};

/// Pictures one after another: from a camera (/dev/video0, or 0), a film, a folder of pictures, in the order of their
/// names, or one picture.
class Source {
 public:
  /// Throws std::runtime_error, naming it, when it cannot be opened or holds no picture.
  Source(const std::string& name, const SourceOptions& options);

  /// Blocks until a device has one. None at the end. Throws std::runtime_error for a picture that cannot be read.
  std::optional<cv::Mat> next();

  [[nodiscard]] bool is_device() const { return is_device_; }
  [[nodiscard]] double rate_hz() const { return rate_hz_; }

 private:
  bool is_device_ = false;
  double rate_hz_ = 0;
  std::vector<std::string> files_;
  std::size_t next_file_ = 0;
  cv::VideoCapture capture_;
};

/// All pictures of these sources.
std::vector<cv::Mat> read_pictures(const std::vector<std::string>& names);

inline Image view(const cv::Mat& picture) {
  return {.pixels = picture.ptr(), .width = picture.cols, .height = picture.rows, .row_bytes = picture.step};
}

}  // namespace regista::camera
