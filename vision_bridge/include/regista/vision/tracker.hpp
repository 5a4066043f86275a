// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <regista/ssl/tracked.hpp>
#include <regista/ssl/vision.hpp>
#include <regista/vision/clock_map.hpp>
#include <regista/vision/fusion.hpp>
#include <span>
#include <vector>

namespace regista::vision {

/// The defaults suit the league: robots of 0.18 m that reach 4 m/s and 4 m/s², cameras of 60 to 100 frames a second.
struct TrackerConfig {
  /// From the light to the camera's t_capture, and what else no time in the frames shows: SSL-Vision stamps the receipt
  /// of an image, ER-Force's simulator hides 25 ms.
  Duration delay = std::chrono::milliseconds{0};
  MotionModel position{.density = 1, .speed_sd = 1.5, .rest_speed = 0.01};                        ///< metres
  MotionModel heading{.density = 20, .speed_sd = 8, .rest_speed = 0.05, .time_constant_s = 0.8};  ///< radians
  MotionModel ball{.density = 4, .speed_sd = 4, .rest_speed = 0.01};                              ///< metres
  int frames_to_show = 5;       ///< that agree, before a robot is believed: in fewer there may be ghosts
  double field_margin_m = 0.5;  ///< beyond the boundary nothing is believed
  double rolling_mps2 = 0.35;   ///< what the ball loses, where the geometry does not tell
};

/// What became of a frame.
enum class Verdict : std::uint8_t {
  taken,
  duplicate,  ///< came before, perhaps by another interface
  foreign,    ///< another computer sends this camera's frames already
  late,       ///< older than what the camera sent before
  mirrored,   ///< shows the field turned or reflected
  too_many,   ///< more than `max_cameras` cameras
};

/// A robot as it is believed to have been at `time`.
struct RobotEstimate {
  ssl::RobotId id;
  Pose2d pose;
  FieldVelocity velocity;
  Time time;          ///< when the newest image of it was taken
  Duration unseen{};  ///< how long before the time asked for that was
  bool resting = false;
};

struct BallEstimate {
  Point3d position;
  double vx = 0;  ///< [m/s]
  double vy = 0;  ///< [m/s]
  Time time;
  Duration unseen{};
};

/// What one camera did so far.
struct CameraReport {
  std::uint32_t id = 0;
  std::uint64_t source = 0;
  double rate_hz = 0;       ///< 0: silent for a second
  double processing_s = 0;  ///< t_sent - t_capture
  double noise_m = 0;       ///< standard deviation of each coordinate
  double noise_rad = 0;
  double overlap_m = 0;  ///< disagreement with other cameras about robots that both see
  std::uint64_t frames = 0;
  std::uint64_t lost = 0;  ///< gaps in the frame numbers
  std::uint64_t duplicates = 0;
  std::uint64_t foreign = 0;
  std::uint64_t late = 0;
  std::uint64_t mirrored = 0;
};

/// What was not believed.
struct TrackerCounters {
  std::uint64_t outliers = 0;  ///< robots where they cannot be
  std::uint64_t flips = 0;     ///< headings that they cannot have
  std::uint64_t misread = 0;   ///< robots that stand where another one does
  std::uint64_t out_of_field = 0;
  std::uint64_t reacquired = 0;  ///< robots that really were elsewhere
  std::uint64_t too_many_cameras = 0;
};

/// Robots and ball from the frames of all cameras. Time comes in with the frames; one thread at a time; no allocation
/// after construction.
class Tracker {
 public:
  explicit Tracker(const TrackerConfig& config);

  /// `source`: whoever sends, such as address and port; `arrival`: no earlier than that of the frame before.
  Verdict take(const ssl::Detection& frame, std::uint64_t source, Time arrival);
  void take(const ssl::Geometry& geometry);
  /// Another `delay` than the configuration's. It is approached by a twentieth of the time that passes: no image
  /// becomes older than the one before it, and for so long velocities are wrong by a twentieth.
  void set_delay(Duration delay) { config_.delay = delay; }
  /// That of the last frame.
  [[nodiscard]] Duration delay() const { return delay_; }

  /// When the image of the last frame was taken.
  [[nodiscard]] Time captured() const { return captured_; }
  /// Robots that the last frame corrected.
  [[nodiscard]] std::span<const ssl::RobotId> corrected() const { return corrected_; }
  /// Empty: not believed to be on the field. As of the newest image of it.
  [[nodiscard]] std::optional<RobotEstimate> robot(ssl::RobotId id) const;
  /// Where it should be at `at`, with its velocity; no further ahead than 0.25 s.
  [[nodiscard]] std::optional<RobotEstimate> predict(ssl::RobotId id, Time at) const;
  [[nodiscard]] std::optional<BallEstimate> predict_ball(Time at) const;

  [[nodiscard]] std::vector<CameraReport> cameras(Time now) const;
  [[nodiscard]] const TrackerCounters& counters() const { return counters_; }

 private:
  struct Recent {
    std::uint32_t number = 0;
    double t_capture_s = -1;
  };
  struct Camera {
    CameraReport report;
    ClockMap clock;
    std::array<Recent, 8> recent;
    std::size_t next_recent = 0;
    Time last_arrival{};
    Time captured{};
    Time second_began{};
    int frames_in_second = 0;
    std::optional<Time> mirrored_since;
    NoiseEstimate position_noise{0.003, 0.0005, 0.01};
    NoiseEstimate heading_noise{0.01, 0.002, 0.06};
    bool used = false;
  };
  /// Something new, or something old elsewhere, that is not yet believed.
  struct Candidate {
    Pose2d pose;
    Time first{};
    Time last{};
    int hits = 0;
  };
  /// The last two raw values of one camera, for its noise.
  struct Raw {
    Pose2d pose;
    Time time{};
    Pose2d before;
    Duration step{};
  };
  struct Robot {
    bool shown = false;
    Time at{};          ///< of the filters
    Time seen{};        ///< where it was believed to be
    Time seen_whole{};  ///< and turned as believed
    Fusion<2> position;
    Fusion<1> heading;
    Candidate candidate;
    std::array<Raw, max_cameras> raw{};
  };
  struct Ball {
    bool shown = false;
    Time at{};
    Time seen{};
    double z = 0;
    std::size_t turn = 0;  ///< which of several balls to try next
    Fusion<2> position;
    Candidate candidate;
  };

  Camera* camera_of(const ssl::Detection& frame, std::uint64_t source, Time arrival);
  void count_rate(Camera& camera, Time arrival);
  void learn_noise(Camera& camera, Raw& raw, const ssl::DetectedRobot& seen, Time now);
  bool is_mirrored(const ssl::Detection& frame, Time now) const;
  void take_robot(const ssl::DetectedRobot& seen, std::size_t camera, Time now);
  bool correct(Robot& robot, const ssl::DetectedRobot& seen, std::size_t camera, Time now);
  void suspect(Robot& robot, const ssl::DetectedRobot& seen, std::size_t camera, Time now);
  bool is_taken(const Robot& self, const Pose2d& pose, Time since, double nearer_than) const;
  void take_balls(std::span<const ssl::DetectedBall> balls, std::size_t camera, Time now);
  void suspect_ball(std::span<const ssl::DetectedBall> balls, std::size_t camera, Time now);
  bool in_field(double x, double y) const;

  TrackerConfig config_;
  Duration delay_;
  Time last_arrival_{};
  std::array<Camera, max_cameras> cameras_;
  std::vector<Robot> robots_;
  Ball ball_;
  Time captured_{};
  std::vector<ssl::RobotId> corrected_;
  TrackerCounters counters_;
  double half_length_m_ = 50;  ///< with the margin; until geometry comes anything goes
  double half_width_m_ = 50;
};

}  // namespace regista::vision
