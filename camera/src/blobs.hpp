// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/camera/colours.hpp>
#include <regista/camera/light.hpp>

namespace regista::camera {

/// A connected area of one colour.
struct Blob {
  Colour colour = Colour::none;
  int area_px = 0;
  int left = 0;
  int right = 0;  ///< included
  int top = 0;
  int bottom = 0;  ///< included
};

/// Bruce, Balch, Veloso: Fast and Inexpensive Color Image Segmentation for Interactive Robots, IROS 2000: runs of a
/// colour in each row, joined with those above by union-find.
class BlobFinder {
 public:
  /// Blobs of at least `least_px` pixels, of the colours of patterns and ball. Valid until the next call.
  std::span<const Blob> find(const Image& image, const LightMap& light, const ColourTable& table, int least_px);

 private:
  struct Run {
    int left = 0;
    int right = 0;  ///< included
    int row = 0;
    Colour colour = Colour::none;
    int parent = 0;  ///< towards the first run of the blob
  };

  int root(int run);
  void join_with_row_above(std::size_t above, std::size_t row, std::size_t end);

  std::vector<Run> runs_;
  std::vector<int> blob_of_run_;
  std::vector<Blob> blobs_;
};

}  // namespace regista::camera
