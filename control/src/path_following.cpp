// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/control/path_following.hpp>

#include "parameter.hpp"

namespace regista::control {
namespace {

/// The pose `length_m` further along a line or an arc.
Pose2d along(const Pose2d& start, double length_m, double curvature) {
  // The chord of an arc: its length is that of the arc times sin(h) / h of half the turn h.
  const double half_turn = 0.5 * length_m * curvature;
  const double chord = std::abs(half_turn) < 1e-8 ? length_m : length_m * std::sin(half_turn) / half_turn;
  const double direction = start.heading + half_turn;
  return {.x = start.x + chord * std::cos(direction),
          .y = start.y + chord * std::sin(direction),
          .heading = wrap_angle(start.heading + 2 * half_turn)};
}

}  // namespace

Path::Path(const Pose2d& start, std::span<const PathSegment> segments) {
  require(!segments.empty(), "segments", 0, "give at least one");
  Pose2d pose = start;
  double to_go = 0;
  for (const PathSegment& segment : segments) {
    require_positive("length_m", segment.length_m);
    require(std::abs(segment.curvature_radpm * segment.length_m) <= 2 * std::numbers::pi, "curvature_radpm",
            segment.curvature_radpm, "give a finite number that makes less than a full circle");
    pieces_.push_back({.start = pose, .shape = segment, .beyond_m = 0});
    pose = along(pose, segment.length_m, segment.curvature_radpm);
  }
  for (auto piece = pieces_.rbegin(); piece != pieces_.rend(); ++piece) {
    piece->beyond_m = to_go;
    to_go += piece->shape.length_m;
  }
}

Path::Place Path::place(const Pose2d& robot, std::size_t& segment) const {
  for (;;) {
    const auto& [start, shape, beyond_m] = pieces_[segment];
    const Pose2d from_start = inverse(start) * robot;
    const double k = shape.curvature_radpm;
    // On an arc the angle at the centre (0, 1/k), taken around the middle of the segment, so that a robot a little
    // before the start is not seen almost a circle ahead.
    double s = from_start.x;
    double offset = from_start.y;
    if (k != 0) {
      const double middle = 0.5 * k * shape.length_m;
      const double toward_centre = 1 - k * from_start.y;
      const double angle = std::atan2(k * from_start.x, toward_centre);
      s = (middle + wrap_angle(angle - middle)) / k;
      // (1 - |robot - centre| |k|) / k, without the difference of large numbers for weak curves
      const double squares = from_start.x * from_start.x + from_start.y * from_start.y;
      offset = (2 * from_start.y - k * squares) / (1 + std::hypot(k * from_start.x, toward_centre));
    }
    const bool last = segment + 1 == pieces_.size();
    if (s > shape.length_m && !last) {
      ++segment;
      continue;
    }
    return {
        .pose = along(start, s, k), .curvature_radpm = k, .offset_m = offset, .to_go_m = beyond_m + shape.length_m - s};
  }
}

PathFollowing::PathFollowing(const PathFollowingConfig& config, Path path) : config_{config}, path_{std::move(path)} {
  require_positive("k1", config.k1);
  require_positive("k2", config.k2);
  require_positive("turn_rate_limit_radps", config.turn_rate_limit_radps);
}

PathFollowing::Output PathFollowing::step(const Pose2d& pose, double speed_mps) {
  if (!sane(pose.x) || !sane(pose.y) || !sane(pose.heading) || !sane(speed_mps)) {
    ++refused_;
    return {.command = {}, .refused = true};
  }
  const Path::Place place = path_.place(pose, segment_);
  const double e = place.offset_m;
  const double psi = angle_between(place.pose.heading, pose.heading);
  const double ahead = 1 - place.curvature_radpm * e;
  Output output{.command = {}, .offset_m = e, .heading_rad = psi, .to_go_m = place.to_go_m};
  if (place.to_go_m <= 0) {
    output.finished = true;
    return output;
  }
  if (ahead <= 0) {
    ++refused_;
    output.refused = true;
    return output;
  }
  const double sinc = std::abs(psi) < 1e-6 ? 1 : std::sin(psi) / psi;
  const double w = place.curvature_radpm * speed_mps * std::cos(psi) / ahead - config_.k1 * speed_mps * e * sinc -
                   config_.k2 * std::abs(speed_mps) * psi;
  const double scale = std::max(1.0, std::abs(w) / config_.turn_rate_limit_radps);
  output.command = {.x = speed_mps / scale, .w = w / scale};
  return output;
}

}  // namespace regista::control
