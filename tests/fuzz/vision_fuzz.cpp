// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <regista/ssl/referee.hpp>
#include <regista/ssl/tracked.hpp>
#include <regista/vision/tracker.hpp>

namespace {

using namespace regista;

void require_finite(double value) {
  if (!std::isfinite(value)) std::abort();
}

}  // namespace

/// Datagrams of any kind, each behind two bytes of its size: what comes of them is finite and does not take long.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ssl::VisionDecoder decoder;
  vision::Tracker tracker{{}};
  Time arrival = Time{} + std::chrono::hours{1};
  for (std::span<const std::uint8_t> rest{data, size}; rest.size() >= 2;) {
    const std::size_t length = std::min<std::size_t>(rest[0] | rest[1] << 8, rest.size() - 2);
    const std::span<const std::byte> datagram = std::as_bytes(rest.subspan(2, length));
    rest = rest.subspan(2 + length);
    arrival += std::chrono::milliseconds{13};
    (void)ssl::decode_referee(datagram);
    if (const auto frame = ssl::decode_tracked(datagram)) {
      for (const ssl::TrackedRobot& robot : frame->robots)
        require_finite(robot.pose.x + robot.pose.y + robot.pose.heading);
      (void)ssl::encode(*frame);
    }
    const auto packet = decoder.decode(datagram);
    if (!packet) continue;
    (void)ssl::encode(**packet);
    if ((*packet)->geometry) tracker.take(*(*packet)->geometry);
    if (!(*packet)->detection) continue;
    (void)tracker.take(*(*packet)->detection, 1, arrival);
    for (const ssl::RobotId id : tracker.corrected()) {
      const auto robot = tracker.predict(id, arrival);
      if (!robot) std::abort();
      require_finite(robot->pose.x + robot->pose.y + robot->velocity.x + robot->velocity.y + robot->velocity.w);
      if (!(std::abs(robot->pose.heading) <= 3.15)) std::abort();
    }
    if (const auto ball = tracker.predict_ball(arrival)) require_finite(ball->position.x + ball->vx + ball->vy);
    (void)tracker.cameras(arrival);
  }
  return 0;
}
