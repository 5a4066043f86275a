// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <regista/camera/image.hpp>
#include <vector>

namespace regista::camera {

/// How bright the light is, over the picture: the carpet, which covers most of it, serves as the photographer's grey
/// card. So a dot in the shade is not taken for carpet in the light, and colours need no calibration anew when the sun
/// or the exposure changes.
class LightMap {
 public:
  /// Reads a sample of the picture's pixels.
  void measure(const Image& image);

  /// From a channel's value at this pixel to the one in normal light, in which the carpet is as bright as `carpet`. The
  /// same for the pixels of a block.
  [[nodiscard]] const std::uint8_t* table(int x, int y) const {
    return (*tables_)[levels_[static_cast<std::size_t>(y / block) * columns_ + static_cast<std::size_t>(x / block)]]
        .data();
  }

  static constexpr int block = 16;      ///< [px]
  static constexpr double carpet = 60;  ///< mean of the three channels

 private:
  static constexpr std::size_t levels = 64;
  using Tables = std::array<std::array<std::uint8_t, 256>, levels>;
  static const Tables& tables();

  const Tables* tables_ = &tables();
  std::size_t columns_ = 0;
  std::vector<std::uint8_t> levels_;  ///< of each block
  std::vector<float> cells_;          ///< median brightness
  std::vector<float> calm_;           ///< without cells that differ from their neighbours
};

}  // namespace regista::camera
