// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace regista::camera {

/// A picture that somebody else owns: rows of blue, green, red, a byte each.
struct Image {
  const std::uint8_t* pixels = nullptr;
  int width = 0;
  int height = 0;
  std::size_t row_bytes = 0;  ///< from one row to the next

  [[nodiscard]] const std::uint8_t* at(int x, int y) const {
    return pixels + static_cast<std::size_t>(y) * row_bytes + static_cast<std::size_t>(x) * 3;
  }
};

/// A place in a picture: x to the right, y down. (0, 0) is the middle of the first pixel.
struct Pixel {
  double x = 0;
  double y = 0;
};

}  // namespace regista::camera
