// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <regista/core/geometry.hpp>
#include <regista/vision/delay_estimator.hpp>
#include <utility>

namespace regista::vision {

namespace {

using namespace std::chrono_literals;

constexpr Duration store_period = 2ms;   ///< of the history, which so reaches back over a second
constexpr Duration longest_gap = 100ms;  ///< in what a robot tells; after it the history starts anew
constexpr Duration pair_least = 80ms;    ///< between the images of a pair
constexpr Duration pair_most = 200ms;
constexpr double tells_rad = 0.03;     ///< ΔH must differ by so much between delays: three times a camera's noise
constexpr double outlier_rad = 0.3;    ///< a misread pattern
constexpr double forget = 1.0 / 3000;  ///< by each pair
constexpr double fewest = 200;         ///< pairs
constexpr double fewest_of_one = 40;   ///< pairs of one robot, to compare it with all
constexpr double worst_fit_rad = 0.1;  ///< root mean square: more is not the noise of a camera
constexpr double certain_s = 0.002;
constexpr double agreement_s = 0.006;  ///< of one robot with all, beyond four standard deviations
constexpr double fastest_radps = 100;  ///< far beyond what a robot can

}  // namespace

void DelayEstimator::turning(ssl::RobotId id, double rate_radps, double stamp_s, Time arrival, Duration way) {
  if (!(std::abs(rate_radps) <= fastest_radps) || !std::isfinite(stamp_s)) return;
  Robot& robot = robots_[ssl::index(id)];
  const Time at = robot.clock.captured(stamp_s, stamp_s, arrival, way);
  const Duration dt = at - robot.now.at;
  if (robot.count > 0 && dt <= Duration{}) return;
  if (robot.count == 0 || dt > longest_gap) {
    robot.count = 0;
    robot.now = {.at = at};
    robot.firsts.fill({});
    robot.second.reset();
  } else {
    robot.now = {.at = at, .angle_rad = robot.now.angle_rad + seconds(dt) * (robot.rate_radps + rate_radps) / 2};
  }
  robot.rate_radps = rate_radps;
  const auto size = robot.history.size();
  if (robot.count == 0 || at - robot.history[(robot.count - 1) % size].at >= store_period)
    robot.history[robot.count++ % size] = robot.now;
  if (!robot.second || robot.second->at > at) return;
  std::optional<Image>& first = robot.firsts[robot.pair];
  compare(robot, *first, *robot.second);
  first = std::exchange(robot.second, std::nullopt);
}

void DelayEstimator::seen(ssl::RobotId id, std::uint32_t camera, double heading_rad, Time captured) {
  Robot& robot = robots_[ssl::index(id)];
  if (robot.count == 0 || robot.second || !std::isfinite(heading_rad)) return;
  const Image image{.at = captured, .heading_rad = heading_rad, .camera = camera};
  robot.pair = (robot.pair + 1) % robot.firsts.size();
  std::optional<Image>& first = robot.firsts[robot.pair];
  if (!first || captured - first->at > pair_most || captured < first->at) {
    first = image;
  } else if (camera == first->camera && captured - first->at >= pair_least) {
    robot.second = image;
  }
}

/// By linear interpolation; before the history nothing is known, and it did not turn.
double DelayEstimator::turned(const Robot& robot, Time at) {
  const auto size = robot.history.size();
  const std::size_t oldest = robot.count > size ? robot.count - size : 0;
  const auto entry = [&](std::size_t i) -> const Turned& { return robot.history[i % size]; };
  std::size_t low = oldest;  // its time is not after `at`, unless it is the oldest
  std::size_t high = robot.count;
  while (high - low > 1) {
    const std::size_t middle = (low + high) / 2;
    (entry(middle).at <= at ? low : high) = middle;
  }
  const Turned& before = entry(low);
  const Turned& after = high < robot.count ? entry(high) : robot.now;
  if (at <= before.at || after.at <= before.at) return before.angle_rad;
  const double share = std::min(1.0, seconds(at - before.at) / seconds(after.at - before.at));
  return before.angle_rad + share * (after.angle_rad - before.angle_rad);
}

void DelayEstimator::compare(Robot& robot, const Image& first, const Image& second) {
  const auto size = robot.history.size();
  const Time oldest = robot.history[robot.count > size ? robot.count % size : 0].at;
  if (first.at - grid_step * grid_size < oldest) return;
  std::array<double, grid_size> turns;
  for (std::size_t i = 0; i < grid_size; ++i) {
    const Duration delay = grid_step * i;
    turns[i] = turned(robot, second.at - delay) - turned(robot, first.at - delay);
  }
  const auto [least, most] = std::ranges::minmax(turns);
  if (most - least < tells_rad) return;
  const double seen = angle_between(first.heading_rad, second.heading_rad);
  if (wrap_angle(seen - least) < -outlier_rad || wrap_angle(seen - most) > outlier_rad) return;
  for (Robot& any : robots_) {
    for (double& square : any.sum.squares) square -= forget * square;
    any.sum.weight -= forget * any.sum.weight;
  }
  for (std::size_t i = 0; i < grid_size; ++i) robot.sum.squares[i] += std::pow(wrap_angle(seen - turns[i]), 2);
  robot.sum.weight += 1;
  ++turns_;
}

std::optional<DelayEstimator::Fit> DelayEstimator::fit(const Sum& sum) {
  const std::array<double, grid_size>& squares = sum.squares;
  const auto least = static_cast<std::size_t>(std::ranges::min_element(squares) - squares.begin());
  if (least == grid_size - 1) return {};  // longer than we look
  // Vision is never early: without any delay, the parabola stands on the first three.
  const std::size_t middle = std::max<std::size_t>(least, 1);
  const double before = squares[middle - 1];
  const double after = squares[middle + 1];
  const double curvature = before - 2 * squares[middle] + after;  // times grid_step²
  if (!(curvature > 0)) return {};
  const double vertex = static_cast<double>(middle) + (before - after) / 2 / curvature;
  const double variance = squares[least] / sum.weight;
  const double step_s = seconds(grid_step);
  return Fit{.delay_s = std::max(0.0, vertex * step_s),
             .sd_s = step_s * std::sqrt(2 * variance / curvature),
             .rms_rad = std::sqrt(variance)};
}

std::optional<DelayEstimator::Fit> DelayEstimator::fit_of_all() const {
  Sum all;
  for (const Robot& robot : robots_) {
    for (std::size_t i = 0; i < grid_size; ++i) all.squares[i] += robot.sum.squares[i];
    all.weight += robot.sum.weight;
  }
  if (!(all.weight >= fewest)) return {};
  return fit(all);
}

bool DelayEstimator::disagree() const {
  const auto all = fit_of_all();
  return all && std::ranges::any_of(robots_, [&](const Robot& robot) {
           if (robot.sum.weight < fewest_of_one) return false;
           const auto own = fit(robot.sum);
           return own && !(std::abs(own->delay_s - all->delay_s) <= agreement_s + 4 * own->sd_s);
         });
}

std::optional<DelayEstimator::Estimate> DelayEstimator::estimate() const {
  const auto all = fit_of_all();
  if (!all || !(all->rms_rad <= worst_fit_rad) || !(all->sd_s <= certain_s) || disagree()) return {};
  return Estimate{.delay = from_seconds(all->delay_s), .sd = from_seconds(all->sd_s), .turns = turns_};
}

}  // namespace regista::vision
