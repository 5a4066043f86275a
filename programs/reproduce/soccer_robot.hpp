// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <regista/control/kinematics.hpp>
#include <regista/control/velocity_profile.hpp>
#include <regista/sim/imu.hpp>
#include <regista/sim/vision.hpp>
#include <regista/sim/wheeled_robot.hpp>
#include <string>
#include <vector>

namespace regista::reproduce {

/// What a robot's computer gets in one of its beats.
struct Senses {
  sim::Imu::Reading imu;                                   ///< without what it read at rest
  control::WheelSpeeds counted = control::WheelSpeeds(4);  ///< from the edges counted in this beat
  std::vector<sim::Detection> vision;
};

struct Disturbances {
  double flip = 0;
  double teleport = 0;
  double gap_from_s = 0;  ///< no vision from here
  double gap_until_s = 0;
};

/// One run: a robot at the origin of the floor, below a camera. Time 0 is when it may move.
class World {
 public:
  World(std::uint64_t seed, Duration beat, const Disturbances& disturbances = {});

  /// Hold `command` for one beat.
  const Senses& step(const BodyVelocity& command);

  [[nodiscard]] const Pose2d& truth() const { return robot_.state().pose; }
  [[nodiscard]] Duration beat() const { return beat_; }
  [[nodiscard]] double now_s() const { return seconds(now_); }

 private:
  void zero_imu();
  const Senses& listen();

  Duration beat_;
  Disturbances disturbances_;
  sim::WheeledRobot robot_;
  sim::Imu imu_;
  sim::Vision vision_;
  sim::Imu::Reading zero_;
  Duration now_{};
  Senses senses_;
};

/// What runs on the robot.
class Pilot {
 public:
  virtual ~Pilot() = default;
  virtual void sense(const Senses& senses, Duration beat) = 0;
  /// Towards a goal, for the next beat. True when the plan has ended.
  virtual bool steer(const Pose2d& goal, Duration beat, BodyVelocity& command) = 0;
  [[nodiscard]] virtual control::MotionState estimate() const = 0;
};

enum class Gates { none, all };

/// The controllers of this chapter, each with the beat that it runs at.
struct Variant {
  std::string controller;  ///< of Row
  std::string name;
  Duration beat;
  std::function<std::unique_ptr<Pilot>(bool vision, Gates gates)> make;
};

/// H, wheels only: the plan's velocity goes to the boards, and nothing comes back.
Variant published_wheels();
/// Ours, wheels only: odometry from the edges that the boards count.
Variant our_wheels();
/// H: vision corrects what accelerometer and gyro predict, as if it were of now; three PI.
Variant published_fusion();
/// Ours: the wheels too, the gyro's bias, vision at the time of its capture, and a gate on the innovation.
Variant our_fusion();

}  // namespace regista::reproduce
