// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <numbers>
#include <regista/ssl/robot_id.hpp>

/// What a camera above a Small Size League field sees, and how that is found.
namespace regista::camera {

/// What a pixel belongs to. Those after `magenta` are known so that they are not taken for one of the others.
enum class Colour : std::uint8_t { none, orange, yellow, blue, green, magenta, field, white, black };

// The league's standard pattern, rules 2010 to 2026, "Vision Pattern", figures 5 and 6: a disc of the team's colour in
// the middle of the robot, and four discs around it. [m], body frame.
inline constexpr double centre_radius_m = 0.025;
inline constexpr double dot_radius_m = 0.020;
inline constexpr double dot_distance_m = 0.065;
inline constexpr double top_radius_m = 0.085;  ///< black, but for …
inline constexpr double top_front_m = 0.055;   ///< … what is ahead of this
inline constexpr double ball_radius_m = 0.0215;

struct Dot {
  double x = 0;  ///< [m]
  double y = 0;  ///< [m]
};
/// Counter-clockwise from the front left.
inline constexpr std::array<Dot, 4> dots{
    {{0.035, 0.054772}, {-0.054772, 0.035}, {-0.054772, -0.035}, {0.035, -0.054772}}};

/// Which of `dots` are green, the others being magenta: bit 0 is the front left. By number of the robot.
inline constexpr std::array<std::uint8_t, ssl::robots_per_team> green_dots{
    0b0010, 0b0011, 0b1011, 0b1010, 0b0100, 0b0101, 0b1101, 0b1100,
    0b1111, 0b0000, 0b0110, 0b1001, 0b0111, 0b0001, 0b1110, 0b1000};

}  // namespace regista::camera
