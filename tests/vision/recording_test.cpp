// SPDX-License-Identifier: Apache-2.0
// What ER-Force's simulator with its "realistic" noise sent by multicast in three seconds of the year 2026: 22 robots
// seen by two cameras that disagree by 40 mm, and one of the robots drives.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <regista/ssl/log_file.hpp>
#include <regista/vision/tracker.hpp>

namespace regista::vision {
namespace {

using namespace std::chrono_literals;

constexpr std::uint64_t simulator = 1;

/// Standard deviation of what is put in.
struct Spread {
  int n = 0;
  double mean = 0;
  double m2 = 0;
  void add(double value) {  // Welford
    ++n;
    const double d = value - mean;
    mean += d / n;
    m2 += d * (value - mean);
  }
  [[nodiscard]] double sd() const { return std::sqrt(m2 / (n - 1)); }
};

struct Track {
  Spread x, y, heading;
  int updates = 0;
  Time last{};
  Duration longest_gap{};
};

TEST(Recording, of_a_simulator_is_tracked_without_ghosts_and_robots_at_rest_stand_still) {
  ssl::LogReader log{TEST_DATA "/vision-22robots.log"};
  ssl::VisionDecoder decoder;
  Tracker tracker{{}};
  std::map<ssl::RobotId, Track> tracks;
  const ssl::RobotId driver{ssl::Team::blue, 10};
  std::optional<std::int64_t> begin;
  double fastest = 0;
  while (true) {
    const auto record = log.next();
    ASSERT_TRUE(record) << record.error().message();
    if (!*record) break;
    if (!begin) begin = (*record)->received_ns;
    const Time arrival = Time{} + 1s + std::chrono::nanoseconds{(*record)->received_ns - *begin};
    const auto packet = decoder.decode((*record)->datagram);
    ASSERT_TRUE(packet) << packet.error().message();
    if ((*packet)->geometry) tracker.take(*(*packet)->geometry);
    if (!(*packet)->detection) continue;
    ASSERT_EQ(tracker.take(*(*packet)->detection, simulator, arrival), Verdict::taken);
    for (const ssl::RobotId id : tracker.corrected()) {
      const auto robot = tracker.robot(id);
      ASSERT_TRUE(robot);
      Track& track = tracks[id];
      if (track.updates++ > 0) track.longest_gap = std::max(track.longest_gap, arrival - track.last);
      track.last = arrival;
      if (id == driver) fastest = std::max(fastest, -robot->velocity.x);
      if (arrival - Time{} < 1s + 500ms) continue;  // until the cameras have agreed
      track.x.add(robot->pose.x);
      track.y.add(robot->pose.y);
      track.heading.add(robot->pose.heading);
    }
  }
  ASSERT_EQ(tracks.size(), 22U);
  double worst_m = 0;
  double worst_rad = 0;
  for (const auto& [id, track] : tracks) {
    EXPECT_LT(track.longest_gap, 100ms) << to_string(id);
    if (id == driver) continue;
    worst_m = std::max({worst_m, track.x.sd(), track.y.sd()});
    worst_rad = std::max(worst_rad, track.heading.sd());
    // The formation: eleven robots a team on a line, 0.5 m apart; cameras are 20 mm off at most.
    const double x = id.number * 0.5 - 2.5;
    EXPECT_NEAR(track.x.mean, x, 0.025) << to_string(id);
    EXPECT_NEAR(track.y.mean, id.team == ssl::Team::yellow ? 1.5 : -1.5, 0.005) << to_string(id);
  }
  std::printf("worst of 21 robots at rest: %.3f mm, %.3f mrad\n", 1e3 * worst_m, 1e3 * worst_rad);
  EXPECT_LT(worst_m, 0.001);
  EXPECT_LT(worst_rad, 0.005);
  EXPECT_NEAR(fastest, 1.5, 0.15);
  EXPECT_EQ(tracker.counters().outliers, 0U);
  EXPECT_EQ(tracker.counters().reacquired, 0U);
  const auto cameras = tracker.cameras(Time{} + 4s);
  ASSERT_EQ(cameras.size(), 2U);
  for (const CameraReport& camera : cameras) {
    std::printf("camera %u: %.1f Hz, noise %.2f mm %.1f mrad, overlap %.1f mm, lost %lu\n", camera.id, camera.rate_hz,
                1e3 * camera.noise_m, 1e3 * camera.noise_rad, 1e3 * camera.overlap_m, camera.lost);
    EXPECT_NEAR(camera.noise_m, 0.0013, 0.0003);  // what the simulator was told to add
    EXPECT_NEAR(camera.noise_rad, 0.010, 0.002);
    EXPECT_NEAR(camera.overlap_m, 0.040, 0.004);
    EXPECT_EQ(camera.lost, 0U);
  }
  EXPECT_TRUE(tracker.predict_ball(Time{} + 3900ms));
}

}  // namespace
}  // namespace regista::vision
