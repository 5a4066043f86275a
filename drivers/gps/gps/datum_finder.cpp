// SPDX-License-Identifier: Apache-2.0
#include "datum_finder.hpp"

#include <cmath>

namespace regista {

std::optional<Geodetic> DatumFinder::step(const Fix& fix, Time now) {
  if (fix.quality == 0 || !fix.three_d || fix.satellites_used < rules_.satellites || fix.speed_mps > rules_.speed_mps) {
    around_.reset();
    return {};
  }
  if (around_) {
    const Point3d here = around_->local(fix.place);
    if (std::hypot(here.x - sum_.x / count_, here.y - sum_.y / count_) > rules_.within_m) around_.reset();
  }
  if (!around_) {
    around_.emplace(fix.place);
    since_ = now;
    sum_ = {};
    count_ = 0;
  }
  const Point3d here = around_->local(fix.place);
  sum_ = {.x = sum_.x + here.x, .y = sum_.y + here.y, .z = sum_.z + here.z};
  ++count_;
  if (now - since_ < rules_.rest) return {};
  return around_->geodetic({.x = sum_.x / count_, .y = sum_.y / count_, .z = sum_.z / count_});
}

}  // namespace regista
