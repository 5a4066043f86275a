// SPDX-License-Identifier: Apache-2.0
#include "blobs.hpp"

#include <algorithm>

namespace regista::camera {

int BlobFinder::root(int run) {
  while (runs_[static_cast<std::size_t>(run)].parent != run) {
    Run& here = runs_[static_cast<std::size_t>(run)];
    here.parent = runs_[static_cast<std::size_t>(here.parent)].parent;
    run = here.parent;
  }
  return run;
}

void BlobFinder::join_with_row_above(std::size_t above, std::size_t row, std::size_t end) {
  std::size_t upper = above;
  for (std::size_t lower = row; lower < end; ++lower) {
    while (upper < row && runs_[upper].right + 1 < runs_[lower].left) ++upper;
    for (std::size_t i = upper; i < row && runs_[i].left <= runs_[lower].right + 1; ++i) {
      if (runs_[i].colour != runs_[lower].colour) continue;
      const int a = root(static_cast<int>(i));
      const int b = root(static_cast<int>(lower));
      runs_[static_cast<std::size_t>(std::max(a, b))].parent = std::min(a, b);
    }
  }
}

std::span<const Blob> BlobFinder::find(const Image& image, const LightMap& light, const ColourTable& table,
                                       int least_px) {
  runs_.clear();
  blobs_.clear();
  std::size_t above = 0;
  for (int y = 0; y < image.height; ++y) {
    const std::size_t row = runs_.size();
    const std::uint8_t* pixel = image.at(0, y);
    Colour last = Colour::none;
    const std::uint8_t* normal_light = nullptr;
    for (int x = 0; x < image.width; ++x, pixel += 3) {
      if (x % LightMap::block == 0) normal_light = light.table(x, y);
      Colour colour = table(pixel, normal_light);
      if (colour > Colour::magenta) colour = Colour::none;
      if (colour != Colour::none && colour == last) {
        runs_.back().right = x;
      } else if (colour != Colour::none) {
        runs_.push_back({.left = x, .right = x, .row = y, .colour = colour, .parent = static_cast<int>(runs_.size())});
      }
      last = colour;
    }
    join_with_row_above(above, row, runs_.size());
    above = row;
  }
  blob_of_run_.assign(runs_.size(), -1);
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    const Run& run = runs_[i];
    int& number = blob_of_run_[static_cast<std::size_t>(root(static_cast<int>(i)))];
    if (number < 0) {
      number = static_cast<int>(blobs_.size());
      blobs_.push_back({run.colour, 0, run.left, run.right, run.row, run.row});
    }
    Blob& blob = blobs_[static_cast<std::size_t>(number)];
    blob.area_px += run.right - run.left + 1;
    blob.left = std::min(blob.left, run.left);
    blob.right = std::max(blob.right, run.right);
    blob.bottom = run.row;
  }
  std::erase_if(blobs_, [=](const Blob& blob) { return blob.area_px < least_px; });
  return blobs_;
}

}  // namespace regista::camera
