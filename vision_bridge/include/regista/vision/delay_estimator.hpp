// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <regista/core/time.hpp>
#include <regista/ssl/robot_id.hpp>
#include <regista/vision/clock_map.hpp>
#include <vector>

namespace regista::vision {

/// How long vision takes beyond what its timestamps show: by how much the headings that cameras see lag behind the turn
/// rates that the robots themselves measure.
///
/// Between two images of one camera, about 0.1 s apart, the robot turned by Δz, and by its gyro by ΔH(d) = H(t₂ - d) -
/// H(t₁ - d), H being the integral of the rate. Of all delays d on a grid the one that makes Σ(Δz - ΔH(d))² least is
/// right; offsets of camera and gyro do not matter. The parabola through the sum about its least value has twice the
/// information Σ(∂ΔH/∂d)² as its curvature, hence the standard deviation. Only robots whose turn rate changes tell
/// anything; a steady turn looks the same at any delay.
///
/// Time comes in with the measurements; one thread at a time; no allocation after construction.
class DelayEstimator {
 public:
  struct Estimate {
    Duration delay{};
    Duration sd{};
    std::uint64_t turns = 0;  ///< pairs of images that told something
  };

  DelayEstimator() : robots_(ssl::most_robots) {}

  /// The robot says that it turns at this rate [rad/s]. `stamp_s` is of its server's clock, of which only the
  /// differences count; `arrival` not before that of its last. `way`: how long a message from it takes at least.
  void turning(ssl::RobotId id, double rate_radps, double stamp_s, Time arrival, Duration way);
  /// A camera saw the robot's heading, in an image that was taken at `captured` if there is no delay.
  void seen(ssl::RobotId id, std::uint32_t camera, double heading_rad, Time captured);
  /// Empty until it is certain within 2 ms, when what cameras see is not what the robots tell, and when they disagree.
  [[nodiscard]] std::optional<Estimate> estimate() const;
  /// A robot that turned enough shows another delay than all of them together: it tells what it was commanded and not
  /// how it turns, or is another one.
  [[nodiscard]] bool disagree() const;

 private:
  static constexpr Duration grid_step = std::chrono::milliseconds{4};
  static constexpr std::size_t grid_size = 51;  // up to 0.2 s

  struct Turned {
    Time at{};
    double angle_rad = 0;  ///< since the history began; not wrapped
  };
  struct Image {
    Time at{};
    double heading_rad = 0;
    std::uint32_t camera = 0;
  };
  struct Sum {
    std::array<double, grid_size> squares{};  ///< [rad²], of each delay
    double weight = 0;                        ///< pairs in `squares`, older ones count less
  };
  struct Fit {
    double delay_s = 0;
    double sd_s = 0;
    double rms_rad = 0;  ///< what remains
  };
  struct Robot {
    Sum sum;
    ClockMap clock;
    std::array<Turned, 512> history;  ///< a ring
    std::size_t count = 0;
    double rate_radps = 0;
    Turned now;
    std::array<std::optional<Image>, 8> firsts;  ///< of pairs, which are begun one after the other
    std::size_t pair = 0;
    std::optional<Image> second;  ///< of that pair: waits for the robot to tell how it turned until then
  };

  void compare(Robot& robot, const Image& first, const Image& second);
  /// Empty when there is no least square within the grid.
  static std::optional<Fit> fit(const Sum& sum);
  [[nodiscard]] std::optional<Fit> fit_of_all() const;
  static double turned(const Robot& robot, Time at);

  std::vector<Robot> robots_;
  std::uint64_t turns_ = 0;
};

}  // namespace regista::vision
