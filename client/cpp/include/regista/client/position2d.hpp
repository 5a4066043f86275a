// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/client/proxy.hpp>
#include <vector>

namespace regista::client {

/// How near counts as there.
struct Tolerance {
  double distance_m = 0.05;
  double heading_rad = 0.1;
};

/// A base that moves in the plane: +x forward, +y left, +w counter-clockwise; poses in its odometry frame.
/// Not finite numbers throw std::invalid_argument.
class Position2dProxy final : public Proxy<Position2d> {
 public:
  using Proxy::Proxy;

  [[nodiscard]] const position2d::State& state() const { return latest<position2d::State>().value; }

  /// Drive. Say it again and again: a server stops a base whose client has been silent for its lease, usually 0.5 s.
  void set_velocity(const BodyVelocity& velocity);
  /// Go there, for a base that takes position commands; no faster than `limits`, where 0 is the base's own limit. The
  /// destination stays valid while this program calls read().
  void go_to(const Pose2d& goal, const BodyVelocity& limits = {});
  /// Bring the base to rest, whoever drives it. Returns when the server has agreed; a stock server is just sent
  /// velocity 0.
  void stop();

  /// `state()` is this near to `goal`.
  [[nodiscard]] bool is_at(const Pose2d& goal, const Tolerance& tolerance = {}) const;
  /// go_to() and read() until the base is there. Throws TimeoutError after stopping the base; RefusedError with the
  /// reason when somebody or something stops it on the way.
  void drive_to(const Pose2d& goal, Duration timeout, const Tolerance& tolerance = {});
  /// The same along a path; the headings count only at its end. To own the loop, use Follower.
  void follow(std::vector<Pose2d> path, Duration timeout, const Tolerance& tolerance = {});

  [[nodiscard]] position2d::Geometry geometry() { return request(position2d::GetGeometry{}); }
  void set_odometry(const Pose2d& pose);
  /// The base is at the origin of its odometry frame now.
  void reset_odometry() { set_odometry({}); }
  void set_motor_power(bool on) { (void)request(position2d::SetMotorPower{.on = on}); }
  void set_position_mode(bool on) { (void)request(position2d::SetPositionMode{.position = on}); }
  void set_speed_pid(float kp, float ki, float kd) { (void)request(position2d::SetSpeedPid{kp, ki, kd}); }
  void set_position_pid(float kp, float ki, float kd) { (void)request(position2d::SetPositionPid{kp, ki, kd}); }
  /// Largest speed [m/s] and acceleration [m/s²].
  void set_speed_profile(float speed_mps, float acceleration_mps2) {
    (void)request(position2d::SetSpeedProfile{speed_mps, acceleration_mps2});
  }

 private:
  friend class Follower;
};

/// Leads a base along a path, one pose after the other:
///
///     Follower follower{base, path};
///     while (!follower.step()) robot.read(100ms);
class Follower {
 public:
  Follower(Position2dProxy& base, std::vector<Pose2d> path, const Tolerance& tolerance = {});

  /// Send the next pose when the one before is reached; never blocks. True: the last pose is reached. Throws
  /// RefusedError with the reason when the base was stopped on the way.
  bool step();
  /// Where the base is going.
  [[nodiscard]] const Pose2d& goal() const { return path_[next_ == 0 ? 0 : next_ - 1]; }

 private:
  Position2dProxy& base_;
  std::vector<Pose2d> path_;
  Tolerance tolerance_;
  std::size_t next_ = 0;  ///< the first pose that was not sent
};

}  // namespace regista::client
