// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <random>
#include <regista/vision/tracker.hpp>

namespace regista::vision {

/// Robots whose truth is known, seen by cameras with the faults of real ones.
struct SyntheticField {
  struct Camera {
    double from_x = -100;  ///< what it sees of the field [m]
    double to_x = 100;
    double offset_x = 0;  ///< how badly it is calibrated [m]
    double offset_y = 0;
  };
  using Truth = std::function<Pose2d(double t)>;

  std::vector<Camera> cameras{{}};
  std::map<ssl::RobotId, Truth> robots{};
  double rate_hz = 75;
  double noise_m = 0.002;
  double noise_rad = 0.006;
  double missing = 0.02;
  double flips = 0;
  double clock_offset_s = 0;  ///< of the vision computer's
  double clock_rate = 1;      ///< how fast it runs
  double processing_s = 0.008;
  double jitter_s = 0.0002;  ///< of the network: mean of what it adds, exponentially distributed
  std::function<void(ssl::Detection&, double t)> spoil{};  ///< any other fault

  Tracker tracker{{}};
  std::mt19937_64 random{1};
  double t = 0;
  std::uint32_t frame = 0;

  static Time at(double seconds) { return Time{} + std::chrono::hours{1} + from_seconds(seconds); }

  /// One frame of every camera. `see`: called after each.
  template <typename See>
  void step(const See& see) {
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform;
    std::exponential_distribution<double> exponential{1};
    t += 1 / rate_hz;
    ++frame;
    for (std::uint32_t number = 0; number < cameras.size(); ++number) {
      const Camera& camera = cameras[number];
      ssl::Detection seen{.camera = number, .frame_number = frame};
      seen.t_capture_s = clock_offset_s + clock_rate * t;
      seen.t_sent_s = clock_offset_s + clock_rate * (t + processing_s);
      for (const auto& [id, truth] : robots) {
        const Pose2d pose = truth(t);
        if (pose.x < camera.from_x || pose.x > camera.to_x || uniform(random) < missing) continue;
        double heading = pose.heading + noise_rad * normal(random);
        if (uniform(random) < flips) heading += (uniform(random) < 0.5 ? 0.5 : -0.5) * std::numbers::pi;
        seen.robots.push_back({.id = id,
                               .x_m = pose.x + camera.offset_x + noise_m * normal(random),
                               .y_m = pose.y + camera.offset_y + noise_m * normal(random),
                               .heading_rad = wrap_angle(heading)});
      }
      if (spoil) spoil(seen, t);
      tracker.take(seen, 1, at(t + processing_s + jitter_s * exponential(random)));
      see();
    }
  }

  template <typename See>
  void run(double duration_s, const See& see) {
    for (const double end = t + duration_s; t < end;) step(see);
  }
  void run(double duration_s) {
    run(duration_s, [] {});
  }

  [[nodiscard]] std::optional<RobotEstimate> now(ssl::RobotId id) const { return tracker.predict(id, at(t)); }
};

}  // namespace regista::vision
