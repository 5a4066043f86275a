// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <regista/core/geometry.hpp>
#include <span>
#include <vector>

namespace regista::control {

/// A stretch of a path: straight, or an arc.
struct PathSegment {
  double length_m = 0;
  double curvature_radpm = 0;  ///< of the path to the left; 0 is straight
};

/// A path of lines and arcs, each going on where the one before ended, in its direction.
class Path {
 public:
  /// Throws std::invalid_argument unless there are segments, all of positive length, with finite curvature and none
  /// more than a full circle.
  Path(const Pose2d& start, std::span<const PathSegment> segments);

  struct Place {
    Pose2d pose;             ///< the point of the path nearest to the robot, and its direction there
    double curvature_radpm;  ///< there
    double offset_m;         ///< of the robot to the left of the path
    double to_go_m;          ///< along the path, to its end; negative beyond it
  };

  /// Where a robot is along the path, searched in segment `segment` and, once past its end, the next ones: `segment`
  /// moves on. So a path may cross itself. Positions must be finite.
  [[nodiscard]] Place place(const Pose2d& robot, std::size_t& segment) const;

 private:
  struct Piece {
    Pose2d start;
    PathSegment shape;
    double beyond_m;  ///< length of all that follow
  };
  std::vector<Piece> pieces_;
};

struct PathFollowingConfig {
  double k1 = 0;  ///< [1/m²], on the offset: 1/sqrt(k1) is the distance over which it is taken in
  double k2 = 0;  ///< [1/m], on the heading; 2 sqrt(k1) damps critically
  double turn_rate_limit_radps = 0;
};

/// Steers a base that cannot move sideways along a path, at whatever speed it has. With the offset e to the left of
/// the path, the heading ψ relative to it and the curvature κ (Frenet frame of the nearest point),
///
///     e' = v sin ψ,   ψ' = ω - κ v cos ψ / (1 - κ e).
///
/// For V = (k1 e² + ψ²) / 2 the turn rate
///
///     ω = κ v cos ψ / (1 - κ e) - k1 v e sin ψ / ψ - k2 |v| ψ
///
/// gives V' = k1 e v sin ψ - k1 v e sin ψ - k2 |v| ψ² = -k2 |v| ψ² ≤ 0: that is the condition of Lien 2013, 2.4.2.
/// Where ψ stays 0, ψ' = -k1 v e makes e = 0 the only place to stay (LaSalle), as long as the robot moves and is not at
/// the centre of its curve, where 1 - κ e = 0. This is the law of Samson 1995 written for both directions of travel.
class PathFollowing {
 public:
  struct Output {
    BodyVelocity command;
    double offset_m = 0;     ///< to the left of the path
    double heading_rad = 0;  ///< relative to the path
    double to_go_m = 0;
    bool finished = false;  ///< at the end of the path; the command is zero
    bool refused = false;   ///< a number was none, or the robot is at the centre of the curve; the command is zero
  };

  /// Throws std::invalid_argument that names the gain which is not positive.
  PathFollowing(const PathFollowingConfig& config, Path path);

  /// `speed_mps` along the path, forward. Lowered where the turn rate would exceed its limit, which keeps the curve.
  [[nodiscard]] Output step(const Pose2d& pose, double speed_mps);

  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  PathFollowingConfig config_;
  Path path_;
  std::size_t segment_ = 0;
  std::uint64_t refused_ = 0;
};

}  // namespace regista::control
