// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>
#include <regista/camera/image.hpp>
#include <string>
#include <vector>

namespace regista::camera {

/// A window in which somebody points at things of a picture.
class Picker {
 public:
  /// Throws std::runtime_error when there is no display.
  explicit Picker(const cv::Mat& picture);
  ~Picker();
  Picker(const Picker&) = delete;
  Picker& operator=(const Picker&) = delete;

  enum class Answer { next, back, done };
  /// Shows `question`, and takes clicks into `picked` until a key ends it: Enter or space for the next question,
  /// backspace for the one before, Escape for the end. No more than `most` clicks: the next question comes by itself.
  Answer ask(const std::string& question, std::size_t most, std::vector<Pixel>& picked);

 private:
  static void on_mouse(int event, int x, int y, int flags, void* self);
  void draw(const std::string& question, const std::vector<Pixel>& picked);

  cv::Mat picture_;
  double scale_;  ///< screen over picture
  cv::Point mouse_;
  bool clicked_ = false;
};

}  // namespace regista::camera
