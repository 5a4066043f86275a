// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/vision/tracker.hpp>
#include <utility>

namespace regista::vision {

namespace {

using namespace std::chrono_literals;

constexpr Duration source_silent = 200ms;  ///< then another may take its camera over
constexpr Duration camera_gone = 10s;      ///< then its place is free
constexpr Duration lifetime = 1s;          ///< of a robot or ball that nobody sees
constexpr Duration longest_prediction = 250ms;
constexpr Duration longest_mirrored = 1s;     ///< after that the field really is the other way round
constexpr Duration late_enough = 50ms;        ///< older measurements are of no use
constexpr int delay_slope = 20;               ///< time over change of the delay
constexpr Duration candidate_silent = 120ms;  ///< then it was nothing

constexpr double gate_m = 0.05;             ///< within a frame even a robot that is hit stays within this …
constexpr double new_camera_gate_m = 0.12;  ///< … for a camera whose offset is not known yet
constexpr double gate_mps = 2;              ///< … and unseen it may have changed its speed by this
constexpr double gate_rad = 0.5;            ///< a turn by 90° between frames is a misread pattern
constexpr double gate_radps = 5;
constexpr double widest_gate_rad = 1.2;
constexpr double ball_gate_mps = 8;  ///< the league's limit is 6.5
constexpr double fastest_mps = 6;    ///< of candidates, whose velocity is not known
constexpr double robot_radius_m = 0.09;

double square(double value) { return value * value; }

double squared_distance(double ax, double ay, double bx, double by) { return square(ax - bx) + square(ay - by); }

using Point = Fusion<2>::Value;
using Angle = Fusion<1>::Value;

}  // namespace

Tracker::Tracker(const TrackerConfig& config)
    : config_{config},
      delay_{config.delay},
      robots_(ssl::most_robots,
              Robot{.position = Fusion<2>{config.position}, .heading = Fusion<1>{config.heading}, .candidate = {}}),
      ball_{.position = Fusion<2>{config.ball}, .candidate = {}} {
  corrected_.reserve(ssl::most_robots);
}

void Tracker::take(const ssl::Geometry& geometry) {
  half_length_m_ = geometry.length_m / 2 + geometry.boundary_m + config_.field_margin_m;
  half_width_m_ = geometry.width_m / 2 + geometry.boundary_m + config_.field_margin_m;
  if (geometry.rolling_mps2) config_.rolling_mps2 = *geometry.rolling_mps2;
}

bool Tracker::in_field(double x, double y) const {
  return std::abs(x) <= half_length_m_ && std::abs(y) <= half_width_m_;
}

// ---- Frames

Verdict Tracker::take(const ssl::Detection& frame, std::uint64_t source, Time arrival) {
  corrected_.clear();
  Camera* found = camera_of(frame, source, arrival);
  if (found == nullptr) {
    ++counters_.too_many_cameras;
    return Verdict::too_many;
  }
  Camera& camera = *found;
  if (camera.report.source != source) {
    ++camera.report.foreign;
    return Verdict::foreign;
  }
  const bool is_known = std::ranges::any_of(camera.recent, [&](const Recent& recent) {
    return recent.number == frame.frame_number && recent.t_capture_s == frame.t_capture_s;
  });
  if (is_known) {
    ++camera.report.duplicates;
    return Verdict::duplicate;
  }
  const Recent& last = camera.recent[(camera.next_recent + camera.recent.size() - 1) % camera.recent.size()];
  const std::uint32_t step = frame.frame_number - last.number;
  if (camera.report.frames > 0 && step > 1 && step < 100) camera.report.lost += step - 1;
  camera.recent[camera.next_recent] = {.number = frame.frame_number, .t_capture_s = frame.t_capture_s};
  camera.next_recent = (camera.next_recent + 1) % camera.recent.size();
  count_rate(camera, arrival);

  const Duration most = std::max(arrival - std::exchange(last_arrival_, arrival), Duration{}) / delay_slope;
  delay_ += std::clamp(config_.delay - delay_, -most, most);
  const Time now = camera.clock.captured(frame.t_capture_s, frame.t_sent_s, arrival, delay_);
  if (now <= camera.captured) {
    ++camera.report.late;
    return Verdict::late;
  }
  camera.captured = captured_ = now;
  camera.report.processing_s += 0.05 * (frame.t_sent_s - frame.t_capture_s - camera.report.processing_s);
  if (is_mirrored(frame, now)) {
    ++camera.report.mirrored;
    if (!camera.mirrored_since) camera.mirrored_since = now;
    if (now - *camera.mirrored_since < longest_mirrored) return Verdict::mirrored;
  } else {
    camera.mirrored_since.reset();
  }
  const auto number = static_cast<std::size_t>(found - cameras_.data());
  for (const ssl::DetectedRobot& robot : frame.robots) take_robot(robot, number, now);
  take_balls(frame.balls, number, now);
  return Verdict::taken;
}

/// Its place, or a free one.
Tracker::Camera* Tracker::camera_of(const ssl::Detection& frame, std::uint64_t source, Time arrival) {
  Camera* unused = nullptr;
  for (Camera& camera : cameras_) {
    if (camera.used && arrival - camera.last_arrival > camera_gone) camera.used = false;
    if (!camera.used) {
      if (unused == nullptr) unused = &camera;
    } else if (camera.report.id == frame.camera) {
      if (camera.report.source != source && arrival - camera.last_arrival > source_silent) {
        camera.report.source = source;
        camera.clock = {};
      }
      return &camera;
    }
  }
  if (unused == nullptr) return nullptr;
  *unused = {};
  unused->used = true;
  unused->report.id = frame.camera;
  unused->report.source = source;
  unused->report.processing_s = frame.t_sent_s - frame.t_capture_s;
  unused->second_began = arrival;
  return unused;
}

void Tracker::count_rate(Camera& camera, Time arrival) {
  ++camera.report.frames;
  ++camera.frames_in_second;
  camera.last_arrival = arrival;
  const double second = seconds(arrival - camera.second_began);
  if (second < 1) return;
  camera.report.rate_hz = camera.frames_in_second / second;
  camera.second_began = arrival;
  camera.frames_in_second = 0;
}

/// Most of those robots that are where they are believed to be after all has been turned or reflected, and not as it
/// is. A symmetric formation of one team does not: the numbers tell.
bool Tracker::is_mirrored(const ssl::Detection& frame, Time now) const {
  std::array<int, 4> agree{};  // as is, turned by 180°, reflected in the y axis, in the x axis
  for (const ssl::DetectedRobot& seen : frame.robots) {
    const Robot& robot = robots_[index(seen.id)];
    if (!robot.shown || now - robot.seen > 300ms) continue;
    const Point at = robot.position.value();
    constexpr std::array<std::pair<int, int>, 4> signs{{{1, 1}, {-1, -1}, {-1, 1}, {1, -1}}};
    for (std::size_t i = 0; i < signs.size(); ++i) {
      const auto [x, y] = signs[i];
      if (squared_distance(x * seen.x_m, y * seen.y_m, at(0), at(1)) < square(0.25)) ++agree[i];
    }
  }
  return *std::max_element(agree.begin() + 1, agree.end()) > 3 * agree[0] + 1;
}

// ---- Robots

void Tracker::take_robot(const ssl::DetectedRobot& seen, std::size_t camera, Time now) {
  if (!in_field(seen.x_m, seen.y_m)) {
    ++counters_.out_of_field;
    return;
  }
  Robot& robot = robots_[index(seen.id)];
  if (robot.shown && now - robot.seen > lifetime) robot.shown = false;
  if (robot.shown && correct(robot, seen, camera, now) && std::ranges::find(corrected_, seen.id) == corrected_.end())
    corrected_.push_back(seen.id);
  if (robot.shown && robot.seen_whole >= now) {
    learn_noise(cameras_[camera], robot.raw[camera], seen, now);
  } else {
    suspect(robot, seen, camera, now);
  }
}

/// True: it is where it was believed to be, and so corrects that.
bool Tracker::correct(Robot& robot, const ssl::DetectedRobot& seen, std::size_t camera, Time now) {
  if (robot.at - now > late_enough) return false;
  if (now > robot.at) {
    robot.position.predict(now - robot.at);
    robot.heading.predict(now - robot.at);
    robot.heading.wrap(Angle{wrap_angle(robot.heading.value()(0))});
    robot.at = now;
  }
  // Of another camera, and a little older than what came last: moved on by the velocity.
  const double ahead = seconds(robot.at - now);
  const double sd = cameras_[camera].position_noise.sd();
  const Point raw = Point{seen.x_m, seen.y_m} + ahead * robot.position.velocity() - robot.position.value();
  const double off = (raw - robot.position.offset(camera)).norm();
  const double unseen = std::max(0.0, seconds(now - robot.seen));
  const double base = robot.position.knows(camera, now) ? gate_m : new_camera_gate_m;
  if (off > base + 6 * sd + gate_mps * unseen) {
    ++counters_.outliers;
    return false;
  }
  if (off > robot_radius_m && is_taken(robot, {.x = seen.x_m, .y = seen.y_m}, now - 100ms, robot_radius_m / 2)) {
    ++counters_.misread;
    return false;
  }
  robot.position.correct(raw, sd, camera, robot.at);
  Camera& by = cameras_[camera];
  if (const double apart = robot.position.disagreement(camera, robot.at); apart > 0)
    by.report.overlap_m += 0.02 * (apart - by.report.overlap_m);
  robot.seen = std::max(robot.seen, now);
  if (!seen.heading_rad) {
    robot.seen_whole = robot.seen;
    return true;
  }
  const double heading_sd = by.heading_noise.sd();
  const double turn = wrap_angle(*seen.heading_rad + ahead * robot.heading.velocity()(0) - robot.heading.value()(0));
  const double gate =
      std::min(widest_gate_rad, gate_rad + 6 * heading_sd + gate_radps * seconds(now - robot.seen_whole));
  if (std::abs(turn - robot.heading.offset(camera)(0)) > gate) {
    ++counters_.flips;
    return true;
  }
  robot.heading.correct(Angle{turn}, heading_sd, camera, robot.at);
  robot.heading.wrap(Angle{wrap_angle(robot.heading.value()(0))});
  robot.seen_whole = robot.seen;
  return true;
}

/// Seen where, or turned as, it is not believed to be. Several frames that agree are right, if none of them shows it
/// where it was, and nobody else is there.
void Tracker::suspect(Robot& robot, const ssl::DetectedRobot& seen, std::size_t camera, Time now) {
  Candidate& candidate = robot.candidate;
  const Pose2d pose{.x = seen.x_m, .y = seen.y_m, .heading = seen.heading_rad.value_or(candidate.pose.heading)};
  if (robot.shown && robot.seen_whole >= candidate.first) candidate = {};  // it was as believed since
  const bool is_fresh = now - candidate.last < candidate_silent;
  const double dt = std::max(0.0, seconds(now - candidate.last));
  const bool agrees = is_fresh && distance(pose, candidate.pose) < new_camera_gate_m + fastest_mps * dt &&
                      std::abs(angle_between(candidate.pose.heading, pose.heading)) < widest_gate_rad;
  if (!agrees) {
    if (is_fresh && --candidate.hits > 0) return;  // one of the two is wrong: the one seen more often goes on
    candidate = {.pose = pose, .first = now, .last = now, .hits = 1};
    return;
  }
  const bool is_new_frame = now - candidate.last > 3ms;  // not one more camera at the same time
  candidate.pose = pose;
  candidate.last = std::max(candidate.last, now);
  if (is_new_frame) ++candidate.hits;
  // Where another robot is believed to be it may also be that one, misread; and where only the heading is new, a few
  // misread patterns in a row.
  const bool is_crowded = is_taken(robot, pose, now - 300ms, robot_radius_m);
  const bool is_turn = robot.shown && robot.seen == now;
  if (candidate.hits < (is_crowded || is_turn ? 2 : 1) * config_.frames_to_show) return;
  if (is_crowded && is_taken(robot, pose, candidate.first, robot_radius_m)) {
    ++counters_.misread;
    return;
  }
  if (robot.shown) ++counters_.reacquired;
  const Camera& by = cameras_[camera];
  robot.shown = true;
  robot.at = robot.seen = robot.seen_whole = now;
  robot.position.start(Point{pose.x, pose.y}, by.position_noise.sd(), camera, now);
  robot.heading.start(Angle{pose.heading}, by.heading_noise.sd(), camera, now);
  candidate = {};
  if (std::ranges::find(corrected_, seen.id) == corrected_.end()) corrected_.push_back(seen.id);
}

/// Another robot is there, and was seen since.
bool Tracker::is_taken(const Robot& self, const Pose2d& pose, Time since, double nearer_than) const {
  return std::ranges::any_of(robots_, [&](const Robot& other) {
    if (&other == &self || !other.shown || other.seen_whole < since) return false;
    const Point at = other.position.value();
    return squared_distance(pose.x, pose.y, at(0), at(1)) < square(nearer_than);
  });
}

void Tracker::learn_noise(Camera& camera, Raw& raw, const ssl::DetectedRobot& seen, Time now) {
  const Pose2d pose{.x = seen.x_m, .y = seen.y_m, .heading = seen.heading_rad.value_or(raw.pose.heading)};
  const Duration step = now - raw.time;
  const bool even = step < 40ms && raw.step < 40ms && step > 1ms && raw.step > 1ms &&
                    std::abs(seconds(step - raw.step)) < 0.3 * seconds(step);
  if (even) {
    camera.position_noise.take(pose.x - 2 * raw.pose.x + raw.before.x);
    camera.position_noise.take(pose.y - 2 * raw.pose.y + raw.before.y);
    camera.heading_noise.take(angle_between(raw.pose.heading, pose.heading) -
                              angle_between(raw.before.heading, raw.pose.heading));
  }
  raw = {.pose = pose, .time = now, .before = raw.pose, .step = step};
}

std::optional<RobotEstimate> Tracker::robot(ssl::RobotId id) const { return predict(id, robots_[index(id)].at); }

std::optional<RobotEstimate> Tracker::predict(ssl::RobotId id, Time at) const {
  const Robot& robot = robots_[index(id)];
  if (!robot.shown || at - robot.seen > lifetime) return {};
  const double dt = seconds(std::clamp<Duration>(at - robot.at, -longest_prediction, longest_prediction));
  const Point velocity = robot.position.velocity();
  const Point position = robot.position.value() + dt * velocity;
  const double w = robot.heading.velocity()(0);
  return RobotEstimate{
      .id = id,
      .pose = {.x = position(0), .y = position(1), .heading = wrap_angle(robot.heading.value()(0) + dt * w)},
      .velocity = {.x = velocity(0), .y = velocity(1), .w = w},
      .time = robot.at,
      .unseen = at - robot.seen,
      .resting = robot.position.resting() && robot.heading.resting()};
}

// ---- The ball

void Tracker::take_balls(std::span<const ssl::DetectedBall> balls, std::size_t camera, Time now) {
  if (ball_.shown && now - ball_.seen > lifetime) ball_.shown = false;
  const double sd = cameras_[camera].position_noise.sd();
  const ssl::DetectedBall* nearest = nullptr;
  double best = 0;
  if (ball_.shown && ball_.at - now < late_enough) {
    if (now > ball_.at) {
      const Point velocity = ball_.position.velocity();
      const double speed = velocity.norm();
      const double dt = seconds(now - ball_.at);
      // Rolling friction; a ball does not roll backwards for it.
      const double loss = speed > 1e-6 ? std::min(config_.rolling_mps2, speed / dt) / speed : 0;
      ball_.position.predict(now - ball_.at, -loss * velocity);
      ball_.at = now;
    }
    best = gate_m + 6 * sd + (ball_.position.knows(camera, now) ? 0 : new_camera_gate_m) +
           ball_gate_mps * std::max(0.0, seconds(now - ball_.seen));
    for (const ssl::DetectedBall& ball : balls) {
      const double off = (Point{ball.x_m, ball.y_m} - ball_.position.value() - ball_.position.offset(camera)).norm();
      if (off >= best || !in_field(ball.x_m, ball.y_m)) continue;
      best = off;
      nearest = &ball;
    }
  }
  if (nearest != nullptr) {
    ball_.position.correct(Point{nearest->x_m, nearest->y_m} - ball_.position.value(), sd, camera, ball_.at);
    ball_.z = nearest->z_m;
    ball_.seen = std::max(ball_.seen, now);
    return;
  }
  suspect_ball(balls, camera, now);
}

/// As with robots; but there may be several balls, and reflections that look like one.
void Tracker::suspect_ball(std::span<const ssl::DetectedBall> balls, std::size_t camera, Time now) {
  if (balls.empty()) return;
  Candidate& candidate = ball_.candidate;
  const bool is_fresh = now - candidate.last < candidate_silent;
  const double reach = new_camera_gate_m + ball_gate_mps * std::max(0.0, seconds(now - candidate.last));
  const auto agrees = [&](const ssl::DetectedBall& ball) {
    return squared_distance(ball.x_m, ball.y_m, candidate.pose.x, candidate.pose.y) < square(reach);
  };
  const auto found = is_fresh ? std::ranges::find_if(balls, agrees) : balls.end();
  if (found == balls.end()) {
    if (is_fresh && --candidate.hits > 0) return;
    const ssl::DetectedBall& ball = balls[ball_.turn++ % balls.size()];
    if (in_field(ball.x_m, ball.y_m))
      candidate = {.pose = {.x = ball.x_m, .y = ball.y_m}, .first = now, .last = now, .hits = 1};
    return;
  }
  if (now - candidate.last > 3ms) ++candidate.hits;
  candidate.pose = {.x = found->x_m, .y = found->y_m};
  candidate.last = std::max(candidate.last, now);
  constexpr int frames_to_show = 3;
  if (candidate.hits < frames_to_show || (ball_.shown && ball_.seen >= candidate.first)) return;
  ball_.shown = true;
  ball_.at = ball_.seen = now;
  ball_.z = found->z_m;
  ball_.position.start(Point{found->x_m, found->y_m}, cameras_[camera].position_noise.sd(), camera, now);
  candidate = {};
}

std::optional<BallEstimate> Tracker::predict_ball(Time at) const {
  if (!ball_.shown || at - ball_.seen > lifetime) return {};
  const double dt = seconds(std::clamp<Duration>(at - ball_.at, -longest_prediction, longest_prediction));
  const Point velocity = ball_.position.velocity();
  const double speed = velocity.norm();
  const double lost = std::min(speed, config_.rolling_mps2 * std::max(0.0, dt));
  const double mean = speed > 0 ? 1 - lost / 2 / speed : 0;
  const Point position = ball_.position.value() + dt * mean * velocity;
  const double left = speed > 0 ? 1 - lost / speed : 0;
  return BallEstimate{.position = {.x = position(0), .y = position(1), .z = ball_.z},
                      .vx = left * velocity(0),
                      .vy = left * velocity(1),
                      .time = ball_.at,
                      .unseen = at - ball_.seen};
}

// ---- Reports

std::vector<CameraReport> Tracker::cameras(Time now) const {
  std::vector<CameraReport> reports;
  for (const Camera& camera : cameras_) {
    if (!camera.used) continue;
    CameraReport& report = reports.emplace_back(camera.report);
    report.noise_m = camera.position_noise.sd();
    report.noise_rad = camera.heading_noise.sd();
    if (now - camera.last_arrival > 1s) report.rate_hz = 0;
  }
  return reports;
}

}  // namespace regista::vision
