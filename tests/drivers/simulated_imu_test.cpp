// SPDX-License-Identifier: Apache-2.0
#include "simulated_imu.hpp"

#include <cmath>
#include <numbers>

#include "bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;

const std::string exact =
    "provides [\"imu:0\"] requires [\"position2d:1\"] gyro_noise 0 gyro_bias 0 accel_noise 0 accel_bias 0 "
    "misalignment 0 heading_noise 0 hard_iron 0 soft_iron 0 ";

/// An IMU on a base that a test moves.
class OnABase {
 public:
  explicit OnABase(const std::string& keys) : bench{Bench::of<SimulatedImu>(keys)} {
    bench.host().required().at(0).link = &base_;
    bench.host().required().at(0).provider = &nobody_;
  }
  void base(const Pose2d& pose, const BodyVelocity& velocity) {
    ASSERT_TRUE(base_.up.put(Mailbox<Outbound, 256>::no_lane, [&](Outbound& out) {
      out = Sample{.measured = {}, .data = position2d::State{.pose = pose, .velocity = velocity}};
    }));
    bench.run(10ms);
  }

  Bench bench;

 private:
  Link base_;
  const Wakeup nobody_;
};

TEST(SimulatedImu, feels_the_circle_that_its_base_drives) {
  OnABase imu{exact};
  imu.base({}, {.x = 2, .w = 0.5});
  imu.base({}, {.x = 2, .w = 0.5});
  const auto samples = imu.bench.latest<imu::Calibrated>();
  EXPECT_NEAR(samples.rate_z, 0.5, 1e-3);        // the chip's last bit
  EXPECT_NEAR(samples.acceleration_x, 0, 0.02);  // likewise
  EXPECT_NEAR(samples.acceleration_y, 1, 0.02);  // v ω, towards the middle: left
  EXPECT_NEAR(samples.acceleration_z, 9.80665, 1e-5);
}

TEST(SimulatedImu, feels_its_base_speed_up) {
  OnABase imu{exact};
  imu.base({}, {.x = 1});
  imu.base({}, {.x = 1.02});
  EXPECT_NEAR(imu.bench.latest<imu::Calibrated>().acceleration_x, 2, 0.02);
}

TEST(SimulatedImu, compass_points_north_and_heading_counts_from_east) {
  OnABase imu{exact};
  imu.base({}, {});
  imu.base({.heading = 0}, {});  // looks east: north is to its left
  EXPECT_NEAR(imu.bench.latest<imu::Calibrated>().field_x, 0, 1e-6);
  EXPECT_NEAR(imu.bench.latest<imu::Calibrated>().field_y, 0.17, 1e-6);
  imu.base({.heading = std::numbers::pi / 2}, {});  // looks north
  EXPECT_NEAR(imu.bench.latest<imu::Calibrated>().field_x, 0.17, 1e-6);
  EXPECT_NEAR(imu.bench.latest<imu::State>().pose.yaw, std::numbers::pi / 2, 1e-9);
}

TEST(SimulatedImu, errs_as_much_as_it_is_told) {
  OnABase imu{"provides [\"imu:0\"] requires [\"position2d:1\"] gyro_noise 2 gyro_bias 0 misalignment 0 seed 3"};
  imu.base({}, {});
  imu.bench.samples().clear();
  imu.bench.run(20s);
  double sum = 0;
  double squares = 0;
  int count = 0;
  for (const Sample& sample : imu.bench.samples()) {
    const auto* samples = std::get_if<imu::Calibrated>(&sample.data);
    if (samples == nullptr) continue;
    sum += samples->rate_z;
    squares += static_cast<double>(samples->rate_z) * samples->rate_z;
    ++count;
  }
  EXPECT_GT(count, 1900);
  EXPECT_NEAR(sum / count, 0, 0.004);
  EXPECT_NEAR(std::sqrt(squares / count), 2 * std::numbers::pi / 180, 0.002);
}

TEST(SimulatedImu, says_nothing_before_its_base_does) {
  OnABase imu{exact};
  imu.bench.run(1s);
  EXPECT_TRUE(imu.bench.samples().empty());
}

}  // namespace
}  // namespace regista
