// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <regista/control/kalman_filter.hpp>
#include <regista/core/time.hpp>
#include <span>

namespace regista::vision {

inline constexpr std::size_t max_cameras = 16;

/// How something moves that cameras look at.
struct MotionModel {
  double density;                ///< white noise on the acceleration, its power spectral density [unit²/s³]
  double speed_sd;               ///< of what is seen anew, or was pushed [unit/s]
  double rest_speed;             ///< slower than this, beside what noise makes of it, is at rest [unit/s]
  double time_constant_s = 0.5;  ///< of the mean that is taken at rest, and in which cameras come to agree
};

/// Position and velocity from several cameras that do not quite agree, each value `channels` numbers of one unit.
///
/// Model: constant velocity, white noise on the acceleration (Bar-Shalom, Li, Kirubarajan 2001, "Estimation with
/// Applications to Tracking and Navigation", 6.2.2); at rest instead a constant, so that noise is averaged over half a
/// second. It leaves rest when the mean of the last six or so innovations is beyond what noise does. What is six
/// deviations off is believed when it comes three times in a row.
///
/// Each camera has an offset to the estimate, which starts as the mean of what it saw first and relaxes until those
/// that see it at present have none on average: so it moves steadily from the view of one camera into that of the next,
/// however these are calibrated.
template <int channels>
class Fusion {
 public:
  using Value = Eigen::Matrix<double, 1, channels>;

  explicit Fusion(const MotionModel& model) : model_{model} {}

  /// `sd`: of the measurement.
  void start(const Value& value, double sd, std::size_t camera, Time now) {
    filter_.x.setZero();
    filter_.x.row(0) = value;
    filter_.p.setZero();
    filter_.p(0, 0) = sd * sd;
    filter_.p(1, 1) = model_.speed_sd * model_.speed_sd;
    mean_velocity_.setZero();
    mean_innovation_.setZero();
    resting_ = false;
    surprises_ = 0;
    calm_s_ = 0;
    started_ = now;
    views_.fill({});
    views_[camera] = {.offset = Value::Zero(), .seen = now, .times = 1, .known = true};
    cameras_ = camera + 1;
  }

  /// `acceleration`: known, as by friction.
  void predict(Duration step, const Value& acceleration = Value::Zero()) {
    const double dt = seconds(step);
    using Covariance = typename Filter::Covariance;
    if (resting_) {
      const double ratio = dt / model_.time_constant_s;
      const double variance = sd_ * sd_ * ratio * ratio;
      filter_.predict(Covariance{{1, 0}, {0, 0}}, Covariance{{variance, 0}, {0, 0}});
      return;
    }
    const double q = model_.density * dt;
    typename Filter::State input;
    input.row(0) = acceleration * (dt * dt / 2);
    input.row(1) = acceleration * dt;
    filter_.predict(Covariance{{1, dt}, {0, 1}}, Covariance{{q * dt * dt / 3, q * dt / 2}, {q * dt / 2, q}}, input);
    const double share = std::min(1.0, dt / mean_s);
    mean_velocity_ += share * (velocity() - mean_velocity_);
    calm_s_ = mean_velocity_.norm() < model_.rest_speed + noise_speed * sd_ ? calm_s_ + dt : 0;
    if (calm_s_ > calm_enough_s) come_to_rest();
  }

  /// What to subtract from this camera's measurements; nothing while it is new.
  [[nodiscard]] Value offset(std::size_t camera) const { return views_[camera].offset; }
  [[nodiscard]] bool knows(std::size_t camera, Time now) const {
    return views_[camera].known && now - views_[camera].seen < forget_after;
  }

  /// `raw`: measured, minus `value()`, wrapped where it is an angle. The offset is subtracted here. `now` is the time
  /// of the measurement, as for predict().
  void correct(const Value& raw, double sd, std::size_t camera, Time now) {
    View& view = views_[camera];
    if (!knows(camera, now)) view = {.offset = raw, .seen = {}, .times = 0, .known = true};
    cameras_ = std::max(cameras_, camera + 1);
    const double dt = std::min(seconds(now - view.seen), 0.1);
    view.seen = now;
    const Value innovation = raw - view.offset;
    sd_ = sd;
    if (take(innovation, sd)) agree(view, innovation, dt, now);
  }

  [[nodiscard]] Value value() const { return filter_.x.row(0); }
  [[nodiscard]] Value velocity() const { return filter_.x.row(1); }
  [[nodiscard]] bool resting() const { return resting_; }
  void wrap(const Value& wrapped) { filter_.x.row(0) = wrapped; }
  /// By how much this camera and those that see it as well disagree, at most; 0 when none does.
  [[nodiscard]] double disagreement(std::size_t camera, Time now) const {
    double most = 0;
    for (const View& view : std::span{views_}.first(cameras_)) {
      if (view.known && now - view.seen < present) most = std::max(most, (view.offset - views_[camera].offset).norm());
    }
    return most;
  }

 private:
  using Filter = control::KalmanFilter<2, channels>;
  struct View {
    Value offset = Value::Zero();
    Time seen{};
    double times = 0;  ///< it was seen
    bool known = false;
  };

  static constexpr int believed_surprises = 3;
  static constexpr double mean_s = 0.15;
  static constexpr double calm_enough_s = 0.2;
  /// What noise of 1 unit looks like in `mean_velocity_` [1/s]: √2 over `mean_s` is 9.
  static constexpr double noise_speed = 15;
  static constexpr Duration present = std::chrono::milliseconds{100};
  static constexpr Duration forget_after = std::chrono::seconds{1};
  static constexpr Duration young = std::chrono::milliseconds{100};
  static constexpr double young_s = 0.015;

  /// False: too surprising to be believed at once.
  bool take(Value innovation, double sd) {
    const double size = innovation.norm();
    if (size > 6 * std::sqrt(filter_.p(0, 0) + sd * sd)) {
      if (++surprises_ < believed_surprises) return false;
      leave_rest(size);  // pushed or kicked
    }
    surprises_ = 0;
    if (resting_) {
      if (size > 4 * sd) innovation *= 4 * sd / size;  // one outlier does not move it
      // The mean has a deviation of 0.3 sd: five of them are not noise.
      mean_innovation_ += (innovation - mean_innovation_) / 6;
      if (mean_innovation_.norm() > 1.5 * sd) leave_rest(innovation.norm());
    }
    using One = Eigen::Matrix<double, 1, 1>;
    (void)filter_.template correct<1>(innovation, Eigen::Matrix<double, 1, 2>{1, 0}, One{sd * sd},
                                      std::numeric_limits<double>::infinity());
    return true;
  }

  void agree(View& view, const Value& innovation, double dt, Time now) {
    Value mean = Value::Zero();
    int cameras = 0;
    for (const View& other : std::span{views_}.first(cameras_)) {
      if (!other.known || now - other.seen >= present) continue;
      mean += other.offset;
      ++cameras;
    }
    mean /= cameras;
    const double slowly = std::min(1.0, dt / model_.time_constant_s);
    const double share = now - started_ < young ? std::min(1.0, dt / young_s) : slowly;
    // What it saw at first is a mean, not one frame with its noise.
    if (cameras > 1) view.offset += std::max(slowly, 1 / ++view.times) * innovation;
    // The estimate takes up what the offsets give away, so that no innovation sees it.
    const Value given = share / cameras * mean;
    for (View& other : std::span{views_}.first(cameras_)) other.offset -= given;
    filter_.x.row(0) += given;
  }

  void come_to_rest() {
    resting_ = true;
    filter_.x.row(1).setZero();
    filter_.forget(1, 0);
    mean_innovation_.setZero();
  }

  void leave_rest(double innovation) {
    resting_ = false;
    calm_s_ = 0;
    mean_velocity_.setZero();
    filter_.p(0, 0) = std::max(filter_.p(0, 0), innovation * innovation);
    filter_.forget(1, model_.speed_sd * model_.speed_sd);
  }

  MotionModel model_;
  Filter filter_{};
  Value mean_velocity_ = Value::Zero();
  Value mean_innovation_ = Value::Zero();
  std::array<View, max_cameras> views_{};
  std::size_t cameras_ = 0;  ///< the views behind are not known
  int surprises_ = 0;        ///< in a row
  double sd_ = 0;
  double calm_s_ = 0;
  Time started_{};
  bool resting_ = false;
};

/// The standard deviation of a camera's noise, from second differences of what it saw of each thing: a smooth motion
/// hardly shows in them, and of white noise they have six times the variance.
class NoiseEstimate {
 public:
  NoiseEstimate(double initial, double least, double most) : sd_{initial}, least_{least}, most_{most} {}

  [[nodiscard]] double sd() const { return sd_; }

  /// `second_difference`: z[k] - 2 z[k-1] + z[k-2], of one coordinate, of frames at equal distances.
  void take(double second_difference) {
    count_ = std::min(count_ + 1, 1000.0);
    const double variance = std::min(second_difference * second_difference / 6, 16 * sd_ * sd_);
    sd_ = std::clamp(std::sqrt(sd_ * sd_ + (variance - sd_ * sd_) / (count_ + 30)), least_, most_);
  }

 private:
  double sd_;
  double least_;
  double most_;
  double count_ = 0;
};

}  // namespace regista::vision
