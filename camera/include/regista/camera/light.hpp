// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <regista/camera/image.hpp>
#include <vector>

namespace regista::camera {

/// How bright the light is, over the picture: the carpet, which covers most of it, serves as the photographer's grey
/// card. So a dot in the shade is not taken for carpet in the light, and colours need no calibration anew when the sun or
/// the exposure changes.
class LightMap {
 public:
  /// Reads a sample of the picture's pixels.
  void measure(const Image& image);

  /// By what the light at this pixel has to be multiplied to make the carpet as bright as `carpet`.
  [[nodiscard]] double gain(int x, int y) const { return gains[level(x, y)]; }
  /// The same for blocks of `block` pixels along a row, as a table: from a channel's value to the one in normal light.
  [[nodiscard]] const std::uint8_t* table(int x, int y) const { return tables()[level(x, y)].data(); }

  static constexpr int block = 16;     ///< [px]
  static constexpr double carpet = 60;  ///< mean of the three channels

 private:
  static constexpr std::size_t levels = 64;
  using Tables = std::array<std::array<std::uint8_t, 256>, levels>;
  static const Tables& tables();
  static const std::array<double, levels> gains;

  [[nodiscard]] std::size_t level(int x, int y) const {
    return levels_[static_cast<std::size_t>(y / block) * columns_ + static_cast<std::size_t>(x / block)];
  }

  std::size_t columns_ = 0;
  std::vector<std::uint8_t> levels_;  ///< of each block
  std::vector<float> cells_;
  std::vector<float> calm_;
};

}  // namespace regista::camera
