// SPDX-License-Identifier: Apache-2.0
#include "source.hpp"

#include <algorithm>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

namespace regista::camera {

namespace {

constexpr double usual_rate_hz = 60;

bool is_number(const std::string& text) {
  return !text.empty() && text.size() < 4 && text.find_first_not_of("0123456789") == std::string::npos;
}

}  // namespace

Source::Source(const std::string& name, const SourceOptions& options) : rate_hz_{options.rate_hz} {
  namespace fs = std::filesystem;
  std::error_code ignored;
  is_device_ = is_number(name) || fs::is_character_file(name, ignored);
  if (is_device_) {
    const bool is_open =
        is_number(name) ? capture_.open(std::stoi(name), cv::CAP_V4L2) : capture_.open(name, cv::CAP_V4L2);
    if (!is_open) throw std::runtime_error{"camera '" + name + "' cannot be opened: is it plugged in, and free?"};
    capture_.set(cv::CAP_PROP_BUFFERSIZE, 1);  // the newest picture, not the oldest
    if (options.width_px > 0) capture_.set(cv::CAP_PROP_FRAME_WIDTH, options.width_px);
    if (options.height_px > 0) capture_.set(cv::CAP_PROP_FRAME_HEIGHT, options.height_px);
    if (options.rate_hz > 0) capture_.set(cv::CAP_PROP_FPS, options.rate_hz);
    return;
  }
  if (fs::is_directory(name, ignored)) {
    for (const auto& entry : fs::directory_iterator{name}) {
      if (entry.is_regular_file() && cv::haveImageReader(entry.path().string()))
        files_.push_back(entry.path().string());
    }
    std::ranges::sort(files_);
    if (files_.empty()) throw std::runtime_error{"folder '" + name + "' holds no pictures"};
  } else if (!fs::exists(name, ignored)) {
    throw std::runtime_error{"'" + name + "' is neither a camera nor a file nor a folder"};
  } else if (cv::haveImageReader(name)) {
    files_.push_back(name);
  } else if (!capture_.open(name)) {
    throw std::runtime_error{"'" + name + "' is neither a picture nor a film that OpenCV reads"};
  }
  if (rate_hz_ == 0 && capture_.isOpened()) rate_hz_ = capture_.get(cv::CAP_PROP_FPS);
  if (!(rate_hz_ > 0)) rate_hz_ = usual_rate_hz;
}

std::optional<cv::Mat> Source::next() {
  cv::Mat picture;
  if (!capture_.isOpened()) {
    if (next_file_ == files_.size()) return {};
    const std::string& file = files_[next_file_++];
    picture = cv::imread(file, cv::IMREAD_COLOR);
    if (picture.empty()) throw std::runtime_error{"picture '" + file + "' is damaged"};
    return picture;
  }
  if (!capture_.read(picture)) {
    if (is_device_) throw std::runtime_error{"the camera sends no more pictures: is it unplugged?"};
    return {};
  }
  if (picture.type() != CV_8UC3) throw std::runtime_error{"the source does not give coloured pictures"};
  return picture;
}

std::vector<cv::Mat> read_pictures(const std::vector<std::string>& names) {
  std::vector<cv::Mat> pictures;
  for (const std::string& name : names) {
    Source source{name, {}};
    if (source.is_device()) {
      pictures.push_back(source.next().value());
      continue;
    }
    while (auto picture = source.next()) pictures.push_back(*picture);
  }
  return pictures;
}

}  // namespace regista::camera
