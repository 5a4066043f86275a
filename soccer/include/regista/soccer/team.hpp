// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <filesystem>
#include <optional>
#include <regista/client/team.hpp>
#include <regista/control/avoidance.hpp>
#include <regista/ssl/multicast.hpp>
#include <regista/ssl/tracked.hpp>
#include <regista/vision/config.hpp>
#include <span>
#include <string_view>
#include <variant>

namespace regista::soccer {

struct TeamOptions {
  // Of what drive_to() and set_velocity() ask of a robot.
  double speed_mps = 1;
  double acceleration_mps2 = 2;
  double turn_rate_radps = 4;
  double gain = 4;     ///< [1/s] on what is left of the way and of the turn; a fifth of one over the delay of the loop
  std::string name{};  ///< shown to the servers; empty: "yellow team"
  std::int32_t priority = 10;  ///< of my wish to drive
};

/// One robot of a Team. What it is told holds until it is told something else, and is repeated by Team::read().
/// Numbers that are not finite throw std::invalid_argument.
class TeamRobot {
 public:
  [[nodiscard]] ssl::RobotId id() const { return id_; }
  [[nodiscard]] bool connected() const { return robot_.connected(); }
  /// Where it believes to be, in the field: camera, wheels and IMU, as its server told last.
  [[nodiscard]] const Pose2d& pose() const { return base_.state().pose; }
  [[nodiscard]] const BodyVelocity& velocity() const { return base_.state().velocity; }
  /// `pose()` is this near; false until the robot has said where it is.
  [[nodiscard]] bool is_at(const Pose2d& goal, const client::Tolerance& tolerance = {}) const {
    return base_.is_at(goal, tolerance);
  }
  /// Why it stands, although it was told to move: "" if it does not, or its server does not tell.
  [[nodiscard]] std::string stopped_because() const;

  /// Centralised: go there, steered from here by what vision shows, clear of all others. Stands while vision does not
  /// show it.
  void drive_to(const Pose2d& goal);
  /// The same with a velocity in the field, as far as others allow.
  void set_velocity(const FieldVelocity& velocity);
  void stop() { set_velocity({}); }
  /// Distributed: the robot plans, and corrects itself. It avoids nobody.
  void go_to(const Pose2d& goal);

  // What it has of a kicker; throws client::RefusedError where it has none, ConnectionError while there is no
  // connection.
  void kick(double speed_mps) { kicker().kick(static_cast<float>(speed_mps)); }
  void chip(double speed_mps, double angle_rad) {
    kicker().chip(static_cast<float>(speed_mps), static_cast<float>(angle_rad));
  }
  void dribble(double speed_radps);  ///< until told otherwise; positive holds the ball
  void charge(bool on) { kicker().charge(on); }
  /// Charge, ball, kicks; the first use subscribes, and it says something once read() has brought it.
  [[nodiscard]] const kicker::State& kicker_state() { return kicker().state(); }

  /// Commands that read() could not send, because the server took no bytes.
  [[nodiscard]] std::uint64_t unsent() const { return unsent_; }

  /// All the rest.
  [[nodiscard]] client::Robot& robot() { return robot_; }

 private:
  friend class Team;

  struct Nothing {};
  struct DriveTo {
    Pose2d goal;
  };
  struct GoTo {
    Pose2d goal;
  };
  using Wish = std::variant<Nothing, DriveTo, FieldVelocity, GoTo>;

  TeamRobot(ssl::RobotId id, client::Robot& robot, std::string owner);
  client::KickerProxy& kicker() { return robot_.kicker(); }
  [[nodiscard]] bool may_command(Time now) { return may_command(base_, "motion", tried_, now); }
  [[nodiscard]] bool may_command(const client::ProxyBase& device, std::string_view group, Time& tried, Time now) const;
  void remind(const Pose2d& goal, Time now);
  void keep_dribbling(Time now);

  ssl::RobotId id_;
  client::Robot& robot_;
  client::Position2dProxy& base_;
  std::string owner_;  ///< as whom the server knows us
  Wish wish_;
  FieldVelocity commanded_;
  std::uint64_t unsent_ = 0;
  Time tried_{};  ///< when it was last commanded although it did not drive for us
  double dribble_radps_ = 0;
  Time dribbled_{};          ///< when that was sent last
  Time tried_to_dribble_{};  ///< likewise
};

/// A team of the Small Size League and one loop: every robot at its own server, and what the cameras see.
///
///     soccer::Team team{"team.cfg", ssl::Team::yellow};  // the file that regista-vision-bridge reads
///     while (true) {
///       team[3].drive_to({.x = 1, .y = 0.5});
///       if (const auto ball = team.ball()) …
///       team.read(20ms);  // values change here, and velocities go out from here
///     }
///
/// Steered robots keep clear of each other and of all that vision shows (control::Avoidance). One thread at a time.
class Team {
 public:
  /// Connects to each robot of this team in the file. Throws ConfigError, client::Error for the first robot that cannot
  /// be reached, std::system_error when vision cannot be heard, std::invalid_argument for options that cannot be.
  Team(const std::filesystem::path& config, ssl::Team team, const TeamOptions& options = {});

  /// Take in what came, waiting up to `timeout` for the first, and steer. False: none came in time. To be called at
  /// least ten times a second: robots stop when their team is silent. A connection that is lost is made again.
  bool read(Duration timeout);

  /// By its pattern. Throws std::out_of_range for one that the file does not have.
  [[nodiscard]] TeamRobot& operator[](int number);
  [[nodiscard]] auto begin() { return robots_.begin(); }
  [[nodiscard]] auto end() { return robots_.end(); }
  [[nodiscard]] std::size_t size() const { return robots_.size(); }

  // What the bridge says of the field: its file must say where it goes (`publish`), or nothing ever comes.

  /// All robots, ours too, as of `seen_age()` ago. Empty when nothing came for 0.5 s.
  [[nodiscard]] std::span<const ssl::TrackedRobot> seen() const;
  [[nodiscard]] std::optional<ssl::TrackedRobot> seen(ssl::RobotId id) const;
  [[nodiscard]] std::optional<ssl::TrackedBall> ball() const;
  /// Duration::max(): nothing ever came.
  [[nodiscard]] Duration seen_age() const;

 private:
  bool hear();
  void steer(Time now);
  [[nodiscard]] FieldVelocity preferred(const TeamRobot& robot, const Pose2d& here) const;

  TeamOptions options_;
  control::Avoidance avoidance_;
  client::Team connections_;
  std::deque<TeamRobot> robots_;
  std::optional<ssl::MulticastReceiver> vision_;
  std::string tracker_;  ///< whose frames to believe; empty: whoever is heard first
  ssl::TrackedFrame frame_;
  std::optional<Time> heard_;  ///< `frame_`
  Time steered_{};
};

}  // namespace regista::soccer
