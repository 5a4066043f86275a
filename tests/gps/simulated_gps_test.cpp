// SPDX-License-Identifier: Apache-2.0
#include "simulated_gps.hpp"

#include <cmath>
#include <numbers>

#include "../drivers/bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;

const std::string devices = "provides [\"gps:0\" \"localize:0\"] requires [\"position2d:1\"] ";
const std::string exact = devices + "noise 0 drift 0 datum [63.4 10.4 40] ";

/// A receiver on a base that a test moves.
class OnABase {
 public:
  explicit OnABase(const std::string& keys) : bench{Bench::of<SimulatedGps>(keys)} {
    bench.host().required().at(0).link = &base_;
    bench.host().required().at(0).provider = &nobody_;
  }
  void base(const Pose2d& pose, const BodyVelocity& velocity = {}) {
    ASSERT_TRUE(base_.up.put(Mailbox<Outbound, 256>::no_lane, [&](Outbound& out) {
      out = Sample{.measured = {}, .data = position2d::State{.pose = pose, .velocity = velocity}};
    }));
    bench.run(10ms);
  }
  template <typename D>
  std::vector<D> all() {
    std::vector<D> found;
    for (const Sample& sample : bench.samples()) {
      if (const auto* data = std::get_if<D>(&sample.data)) found.push_back(*data);
    }
    return found;
  }

  Bench bench;

 private:
  Link base_;
  const Wakeup nobody_;
};

TEST(SimulatedGps, is_where_its_base_is) {
  OnABase gps{exact};
  gps.base({.x = 30, .y = -20});
  gps.bench.run(300ms);
  const auto local = gps.bench.latest<localize::State>();
  EXPECT_NEAR(local.hypotheses.at(0).mean.x, 30, 1e-6);
  EXPECT_NEAR(local.hypotheses.at(0).mean.y, -20, 1e-6);

  // Over so short a way the radii of curvature of WGS 84 tell what a metre is in degrees.
  const double a = 6378137;
  const double e2 = 0.00669437999014;
  const double latitude = 63.4 * std::numbers::pi / 180;
  const double w = std::sqrt(1 - e2 * std::pow(std::sin(latitude), 2));
  const double meridian_m = a * (1 - e2) / (w * w * w) + 40;
  const double parallel_m = (a / w + 40) * std::cos(latitude);
  const auto state = gps.bench.latest<gps::State>();
  EXPECT_NEAR(state.latitude, 1e7 * (63.4 - 20 / meridian_m * 180 / std::numbers::pi), 2);
  EXPECT_NEAR(state.longitude, 1e7 * (10.4 + 30 / parallel_m * 180 / std::numbers::pi), 2);
  EXPECT_NEAR(state.altitude_mm, 40'000, 1);
  EXPECT_EQ(state.quality, 1U);
}

TEST(SimulatedGps, course_counts_from_north_and_counter_clockwise) {
  OnABase gps{exact};
  gps.base({.heading = std::numbers::pi / 2}, {.x = 1.5});
  gps.bench.run(300ms);
  EXPECT_NEAR(gps.bench.latest<gps::State>().course_rad, 0, 1e-9);
  EXPECT_NEAR(gps.bench.latest<gps::State>().speed_mps, 1.5, 1e-9);
  gps.base({.heading = std::numbers::pi / 2}, {.x = -1.5});  // backwards
  gps.bench.run(300ms);
  EXPECT_NEAR(gps.bench.latest<gps::State>().course_rad, std::numbers::pi, 1e-9);
}

TEST(SimulatedGps, tells_how_wrong_it_is_and_is_so) {
  OnABase gps{devices + "noise 0.3 drift 0.4 drift_time 1 seed 5"};
  gps.base({});
  gps.bench.run(400s);
  double squares = 0;
  const auto fixes = gps.all<localize::State>();
  ASSERT_GT(fixes.size(), 1900U);
  for (const localize::State& fix : fixes) squares += std::pow(fix.hypotheses.at(0).mean.x, 2);
  EXPECT_NEAR(std::sqrt(squares / static_cast<double>(fixes.size())), 0.5, 0.05);
  EXPECT_NEAR(fixes.back().hypotheses.at(0).covariance[0], 0.25, 1e-12);
  EXPECT_NEAR(gps.bench.latest<gps::State>().horizontal_error_m, 0.5 * std::sqrt(-2 * std::log(0.05)), 1e-4);
}

TEST(SimulatedGps, a_lost_fix_is_told_and_no_position_made_up) {
  OnABase gps{exact + "loss_every 0.001 loss 1000000"};
  gps.base({});
  gps.bench.run(2s);
  EXPECT_TRUE(gps.all<localize::State>().empty());
  const auto states = gps.all<gps::State>();
  EXPECT_GE(states.size(), 8U);
  for (const gps::State& state : states) EXPECT_EQ(state.quality, 0U);
}

TEST(SimulatedGps, time_is_utc_and_goes_on) {
  OnABase gps{exact};
  gps.base({});
  gps.bench.run(2s);
  const auto states = gps.all<gps::State>();
  ASSERT_GE(states.size(), 9U);
  const auto time = [](const gps::State& s) { return s.time_s + 1e-6 * s.time_us; };
  EXPECT_NEAR(time(states.back()) - time(states.front()), 0.2 * static_cast<double>(states.size() - 1), 0.021);
}

TEST(SimulatedGps, complains_about_a_datum_that_is_none) {
  for (const char* keys : {"datum [63.4]", "datum [91 10]", "datum [10 181]", "datum [1 2 3 4]"}) {
    EXPECT_THROW((void)Bench::of<SimulatedGps>(devices + keys), ConfigError) << keys;
  }
}

}  // namespace
}  // namespace regista
