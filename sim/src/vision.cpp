// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>
#include <regista/sim/vision.hpp>
#include <string>

#include "require.hpp"

namespace regista::sim {

Vision::Vision(const VisionParameters& p) : parameters_{p}, random_{p.seed} {
  require(!p.cameras.empty() && p.cameras.size() <= 16, "cameras", static_cast<double>(p.cameras.size()),
          "give one to 16");
  for (std::size_t i = 0; i < p.cameras.size(); ++i) {
    const Camera& camera = p.cameras[i];
    const std::string name = "cameras[" + std::to_string(i) + "].";
    require(camera.max_x_m > camera.min_x_m, name + "max_x_m", camera.max_x_m, "give more than min_x_m");
    require(camera.max_y_m > camera.min_y_m, name + "max_y_m", camera.max_y_m, "give more than min_y_m");
    require(true, name + "offset", camera.offset.x + camera.offset.y + camera.offset.heading, "give numbers");
  }
  require(p.period_s >= 0.001, "period_s", p.period_s, "give at least 0.001");
  require_not_negative("noise_m", p.noise_m);
  require_not_negative("noise_rad", p.noise_rad);
  require_probability("loss", p.loss);
  require(p.delay_s >= 0 && p.delay_s <= 1, "delay_s", p.delay_s, "give 0 to 1");
  require(p.delay_jitter_s >= 0 && p.delay_jitter_s <= 1, "delay_jitter_s", p.delay_jitter_s, "give 0 to 1");
  require_probability("flip", p.flip);
  require_probability("teleport", p.teleport);
  require_not_negative("teleport_m", p.teleport_m);
}

const std::vector<Detection>& Vision::step(const Pose2d& truth, Duration dt) {
  for (Pending& pending : pending_) {
    pending.left -= dt;
    pending.detection.age += dt;
  }
  until_frame_ -= dt;
  if (until_frame_ <= Duration::zero()) {
    const Duration period = from_seconds(parameters_.period_s);
    capture(truth);
    until_frame_ += period;
    if (until_frame_ <= Duration::zero()) until_frame_ = period;  // a step longer than a period: one frame
  }
  const auto due =
      std::find_if(pending_.begin(), pending_.end(), [](const Pending& p) { return p.left > Duration::zero(); });
  arrived_.clear();
  for (auto it = pending_.begin(); it != due; ++it) arrived_.push_back(it->detection);
  pending_.erase(pending_.begin(), due);
  return arrived_;
}

void Vision::capture(const Pose2d& truth) {
  const Duration left = from_seconds(parameters_.delay_s + random_.uniform(0, parameters_.delay_jitter_s));
  for (std::size_t i = 0; i < parameters_.cameras.size(); ++i) {
    const Camera& camera = parameters_.cameras[i];
    const bool inside =
        truth.x >= camera.min_x_m && truth.x < camera.max_x_m && truth.y >= camera.min_y_m && truth.y < camera.max_y_m;
    if (!inside || random_.chance(parameters_.loss)) continue;
    Pose2d pose{.x = truth.x + camera.offset.x + random_.normal(parameters_.noise_m),
                .y = truth.y + camera.offset.y + random_.normal(parameters_.noise_m),
                .heading = truth.heading + camera.offset.heading + random_.normal(parameters_.noise_rad)};
    if (random_.chance(parameters_.flip)) {
      pose.heading += std::numbers::pi / 2 * std::floor(random_.uniform(1, 4));
    }
    if (random_.chance(parameters_.teleport)) {
      const double direction = random_.uniform(0, 2 * std::numbers::pi);
      pose.x += parameters_.teleport_m * std::cos(direction);
      pose.y += parameters_.teleport_m * std::sin(direction);
    }
    pose.heading = wrap_angle(pose.heading);
    pending_.push_back({.detection = {.camera = static_cast<int>(i), .pose = pose}, .left = left});
  }
}

}  // namespace regista::sim
