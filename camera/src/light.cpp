// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <regista/camera/light.hpp>

namespace regista::camera {

namespace {

/// [px]. The median of a square so large is carpet, even with a robot on it.
constexpr int cell = 64;
constexpr int sample_step = 4;

constexpr double least_gain = 0.3;
constexpr double step_of_gain = 1.045;  // up to 4.8

float median_brightness(const Image& image, int left, int top) {
  std::array<int, 256> histogram{};
  int count = 0;
  for (int y = top; y < std::min(top + cell, image.height); y += sample_step) {
    for (int x = left; x < std::min(left + cell, image.width); x += sample_step) {
      const std::uint8_t* p = image.at(x, y);
      ++histogram[static_cast<std::size_t>((p[0] + p[1] + p[2]) / 3)];
      ++count;
    }
  }
  int below = 0;
  for (std::size_t value = 0; value < histogram.size(); ++value) {
    below += histogram[value];
    if (2 * below >= count) return static_cast<float>(value);
  }
  return 0;
}

}  // namespace

const LightMap::Tables& LightMap::tables() {
  static const Tables tables = [] {
    Tables result{};
    for (std::size_t i = 0; i < levels; ++i) {
      const double gain = least_gain * std::pow(step_of_gain, static_cast<double>(i));
      for (std::size_t value = 0; value < 256; ++value)
        result[i][value] = static_cast<std::uint8_t>(std::min(255.0, std::round(static_cast<double>(value) * gain)));
    }
    return result;
  }();
  return tables;
}

void LightMap::measure(const Image& image) {
  const int cell_columns = (image.width + cell - 1) / cell;
  const int cell_rows = (image.height + cell - 1) / cell;
  const auto cell_count = static_cast<std::size_t>(cell_columns) * static_cast<std::size_t>(cell_rows);
  cells_.resize(cell_count);
  calm_.resize(cell_count);
  for (int row = 0; row < cell_rows; ++row) {
    for (int column = 0; column < cell_columns; ++column) {
      cells_[static_cast<std::size_t>(row * cell_columns + column)] =
          median_brightness(image, column * cell, row * cell);
    }
  }
  const cv::Mat raw{cell_rows, cell_columns, CV_32F, cells_.data()};
  cv::Mat calm{cell_rows, cell_columns, CV_32F, calm_.data()};
  cv::medianBlur(raw, calm, 3);  // where robots crowd

  columns_ = static_cast<std::size_t>((image.width + block - 1) / block);
  const int rows = (image.height + block - 1) / block;
  levels_.resize(columns_ * static_cast<std::size_t>(rows));
  // Between the middles of the cells, linearly.
  const auto mixed = [&](int block_number, int count) {
    const double at = std::clamp((block_number + 0.5) * block / cell - 0.5, 0.0, count - 1.0);
    const int from = std::min(static_cast<int>(at), std::max(count - 2, 0));
    return std::tuple{from, std::min(from + 1, count - 1), static_cast<float>(at - from)};
  };
  for (int row = 0; row < rows; ++row) {
    const auto [y0, y1, v] = mixed(row, cell_rows);
    for (int column = 0; column < static_cast<int>(columns_); ++column) {
      const auto [x0, x1, u] = mixed(column, cell_columns);
      const float upper = (1 - u) * calm.at<float>(y0, x0) + u * calm.at<float>(y0, x1);
      const float lower = (1 - u) * calm.at<float>(y1, x0) + u * calm.at<float>(y1, x1);
      const double gain = carpet / std::max(1.0F, (1 - v) * upper + v * lower);
      const double level = std::log(gain / least_gain) / std::log(step_of_gain);
      levels_[static_cast<std::size_t>(row) * columns_ + static_cast<std::size_t>(column)] =
          static_cast<std::uint8_t>(std::clamp(std::round(level), 0.0, levels - 1.0));
    }
  }
}

}  // namespace regista::camera
