// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <numbers>
#include <regista/control/kinematics.hpp>
#include <regista/control/odometry.hpp>
#include <regista/control/orientation_filter.hpp>
#include <regista/control/rollback.hpp>
#include <regista/control/translation_filter.hpp>
#include <regista/control/velocity_profile.hpp>
#include <regista/sim/imu.hpp>
#include <regista/sim/vision.hpp>
#include <regista/sim/wheeled_robot.hpp>

#include "experiments.hpp"

namespace reproduce {
namespace {

using namespace regista;
using namespace std::chrono_literals;

constexpr double pi = std::numbers::pi;
constexpr double wheel_radius_m = 0.035;
constexpr double wheel_distance_m = 0.08;
const control::Kinematics kinematics =
    control::Kinematics::omni({pi / 4, 3 * pi / 4, 5 * pi / 4, 7 * pi / 4}, wheel_distance_m);

// What Holtzhausen drives at: 0.6 m/s, 1 m/s²; rotation in proportion.
constexpr control::MotionLimits limits{
    .speed_mps = 0.6, .acceleration_mps2 = 1, .turn_rate_radps = 2, .turn_acceleration_radps2 = 5};

/// The robot that he blames: wheels off their centre and gears of unequal friction. He gives no figures; these are
/// guesses, within what a workshop leaves, that make the wheels alone err as much as his did.
sim::WheeledRobotParameters used_robot(std::uint64_t seed) {
  sim::WheeledRobotParameters robot = sim::ssl_robot();
  constexpr std::array off_centre_m{0.002, -0.003, 0.004, -0.001};
  constexpr std::array gear_friction_nm{0.004, 0.030, 0.010, 0.020};
  for (std::size_t i = 0; i < robot.wheels.size(); ++i) {
    robot.wheels[i].x_m += off_centre_m[i];
    robot.wheels[i].y_m -= off_centre_m[(i + 1) % 4];
    robot.wheels[i].coulomb_nm = gear_friction_nm[i];
  }
  robot.rough_nm = 0.012;
  robot.seed = seed;
  return robot;
}

/// What a robot's computer gets in one of its beats.
struct Senses {
  sim::Imu::Reading imu;  ///< without what it read at rest
  control::WheelSpeeds measured{4};  ///< by the boards
  control::WheelSpeeds counted{4};   ///< from the edges counted in this beat
  std::vector<sim::Detection> vision;
};

struct Disturbances {
  double flip = 0;
  double teleport = 0;
  double gap_from_s = 0;  ///< no vision from here
  double gap_until_s = 0;
};

/// One run: a robot on the floor below a camera. Time 0 is when it may move.
class World {
 public:
  World(std::uint64_t seed, Duration beat, const Disturbances& disturbances = {})
      : beat_{beat},
        disturbances_{disturbances},
        robot_{used_robot(seed * 8 + 1)},
        imu_{{.accel_bias_walk_mps2_per_root_s = 0.004, .seed = seed * 8 + 2}},
        vision_{{.flip = disturbances.flip, .teleport = disturbances.teleport, .seed = seed * 8 + 3}} {
    sim::Random hand{seed * 8 + 4};
    robot_.place({.x = hand.normal(0.002), .y = hand.normal(0.002), .heading = hand.normal(0.01)});
    start_ = robot_.state().pose;
    zero_imu();
  }

  /// Hold `command` for one beat.
  const Senses& step(const BodyVelocity& command) {
    std::array<double, 4> wheels{};
    std::ranges::transform(kinematics.wheels(command), wheels.begin(), [](double rim) { return rim / wheel_radius_m; });
    robot_.command(wheels);
    return listen();
  }

  [[nodiscard]] const Pose2d& truth() const { return robot_.state().pose; }
  [[nodiscard]] const Pose2d& start() const { return start_; }
  [[nodiscard]] Duration beat() const { return beat_; }
  [[nodiscard]] double now_s() const { return seconds(now_); }

 private:
  void zero_imu() {
    sim::Imu::Reading sum;
    const int beats = static_cast<int>(1s / beat_);
    for (int i = 0; i < beats; ++i) {
      listen();
      sum.accel_x_mps2 += senses_.imu.accel_x_mps2 / beats;
      sum.accel_y_mps2 += senses_.imu.accel_y_mps2 / beats;
      sum.rate_radps += senses_.imu.rate_radps / beats;
    }
    zero_ = sum;
    now_ = {};
  }

  const Senses& listen() {
    constexpr Duration tick = 5ms;
    const auto before = robot_.state();
    senses_.vision.clear();
    double accel_x = 0, accel_y = 0;
    for (Duration t = tick; t <= beat_; t += tick) {
      const auto& state = robot_.step(tick);
      now_ += tick;
      accel_x += state.accel_x_mps2 * seconds(tick) / seconds(beat_);
      accel_y += state.accel_y_mps2 * seconds(tick) / seconds(beat_);
      for (sim::Detection seen : vision_.step(state.pose, tick)) {
        seen.age += beat_ - t;
        const bool lost = now_s() >= disturbances_.gap_from_s && now_s() < disturbances_.gap_until_s;
        if (!lost) senses_.vision.push_back(seen);
      }
    }
    const auto& state = robot_.state();
    const double rate = angle_between(before.pose.heading, state.pose.heading) / seconds(beat_);
    senses_.imu = imu_.read(accel_x, accel_y, rate, seconds(beat_));
    senses_.imu.accel_x_mps2 -= zero_.accel_x_mps2;
    senses_.imu.accel_y_mps2 -= zero_.accel_y_mps2;
    senses_.imu.rate_radps -= zero_.rate_radps;
    constexpr double rim_per_edge_m = 2 * pi * wheel_radius_m / (9 * 16);
    for (std::size_t i = 0; i < 4; ++i) {
      senses_.measured[i] = state.wheels[i].measured_radps * wheel_radius_m;
      senses_.counted[i] =
          static_cast<double>(state.wheels[i].count - before.wheels[i].count) * rim_per_edge_m / seconds(beat_);
    }
    return senses_;
  }

  Duration beat_;
  Disturbances disturbances_;
  sim::WheeledRobot robot_;
  sim::Imu imu_;
  sim::Vision vision_;
  Pose2d start_;
  sim::Imu::Reading zero_;
  Duration now_{};
  Senses senses_;
};
