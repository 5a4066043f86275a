// SPDX-License-Identifier: Apache-2.0
// What one step of each filter costs, beside the same equations written out by hand for this one case (no gate, no
// checks, no records): the ratio is what the generality costs.
//   build/release/bin/bench_control_step

#include <benchmark/benchmark.h>

#include <array>
#include <cmath>
#include <regista/control/complementary_filter.hpp>
#include <regista/control/orientation_filter.hpp>
#include <regista/control/pose_ekf.hpp>
#include <regista/control/rollback.hpp>
#include <regista/control/translation_filter.hpp>

namespace {

using namespace regista;
using namespace regista::control;
using namespace std::chrono_literals;

// ---- Kalman filter of a point -------------------------------------------------------------------------------------

void translation_by_hand(benchmark::State& state) {
  double x = 0, y = 0, vx = 0, vy = 0, p00 = 1, p01 = 0, p11 = 1;
  double z = 0, ax = 0.1, t = 0.01;
  constexpr double d = 6.4e-4, r = 1.6e-5;
  for (auto _ : state) {
    benchmark::DoNotOptimize(z);
    benchmark::DoNotOptimize(ax);
    benchmark::DoNotOptimize(t);
    x += t * vx + t * t / 2 * ax, vx += t * ax;
    y += t * vy + t * t / 2 * ax, vy += t * ax;
    p00 += 2 * t * p01 + t * t * p11 + d * t * t * t / 3;
    p01 += t * p11 + d * t * t / 2;
    p11 += d * t;
    const double s = 1 / (p00 + r);
    const double k0 = p00 * s, k1 = p01 * s, dx = z - x, dy = z - y;
    x += k0 * dx, vx += k1 * dx, y += k0 * dy, vy += k1 * dy;
    p11 -= k1 * p01, p01 -= k0 * p01, p00 -= k0 * p00;
    benchmark::DoNotOptimize(x + y + vx + vy);
  }
}
BENCHMARK(translation_by_hand);

void translation_predict_and_correct(benchmark::State& state) {
  TranslationFilter filter;
  filter.correct(PositionMeasurement{.sd_m = 0.004});
  FieldAcceleration a{.x = 0.1, .y = 0.1};
  PositionMeasurement z{.sd_m = 0.1};
  for (auto _ : state) {
    benchmark::DoNotOptimize(a);
    benchmark::DoNotOptimize(z);
    filter.predict(a, 10ms);
    const Correction result = filter.correct(z);
    benchmark::DoNotOptimize(result);
  }
  if (filter.state().position.refused > 0) state.SkipWithError("refused");
}
BENCHMARK(translation_predict_and_correct);

void orientation_predict_and_correct(benchmark::State& state) {
  OrientationFilter filter;
  double w = 0.01;
  HeadingMeasurement z{.sd_rad = 1};
  filter.correct(z);
  for (auto _ : state) {
    benchmark::DoNotOptimize(w);
    benchmark::DoNotOptimize(z);
    filter.predict(w, 10ms);
    const Correction result = filter.correct(z);
    benchmark::DoNotOptimize(result);
  }
  if (filter.state().heading.refused > 0) state.SkipWithError("refused");
}
BENCHMARK(orientation_predict_and_correct);

void complementary_predict_and_correct(benchmark::State& state) {
  ComplementaryFilter filter;
  double w = 0.01;
  HeadingMeasurement z{.sd_rad = 0.01};
  for (auto _ : state) {
    benchmark::DoNotOptimize(w);
    benchmark::DoNotOptimize(z);
    filter.predict(w, 10ms);
    const Correction result = filter.correct(z);
    benchmark::DoNotOptimize(result);
  }
}
BENCHMARK(complementary_predict_and_correct);

void kalman_4_states_dense(benchmark::State& state) {
  KalmanFilter<4> filter;
  const Eigen::Matrix4d f{{1, 0, 0.01, 0}, {0, 1, 0, 0.01}, {0, 0, 1, 0}, {0, 0, 0, 1}};
  const Eigen::Matrix4d q = 1e-4 * Eigen::Matrix4d::Identity();
  const Eigen::Matrix<double, 2, 4> h{{1, 0, 0, 0}, {0, 1, 0, 0}};
  const Eigen::Matrix2d r = 1e-2 * Eigen::Matrix2d::Identity();
  Eigen::Vector2d z{0.01, 0.02};
  for (auto _ : state) {
    benchmark::DoNotOptimize(z);
    filter.predict(f, q);
    const auto result = filter.correct<2>(z - h * filter.x, h, r, 10);
    benchmark::DoNotOptimize(result);
  }
}
BENCHMARK(kalman_4_states_dense);

// ---- Pose EKF -----------------------------------------------------------------------------------------------------

PoseEkf ready() {
  PoseEkf ekf;
  ekf.reset({.x = 1, .y = 2, .heading = 0.5}, 0.5, 0.1);
  return ekf;
}

/// The least that any step does to 6 states: p = f p f' with loops, and the trigonometry.
void pose_predict_by_hand(benchmark::State& state) {
  std::array<std::array<double, 6>, 6> p{}, fp{};
  double heading = 0.5, w = 0.1, v = 0.5, t = 0.01;
  for (auto _ : state) {
    benchmark::DoNotOptimize(heading);
    benchmark::DoNotOptimize(t);
    const double c = std::cos(heading + w * t / 2), s = std::sin(heading + w * t / 2);
    std::array<std::array<double, 6>, 6> f{};
    for (std::size_t i = 0; i < 6; ++i) f[i][i] = 1;
    f[0][2] = -v * t * s, f[0][3] = t * c, f[0][4] = -v * t * t / 2 * s;
    f[1][2] = v * t * c, f[1][3] = t * s, f[1][4] = v * t * t / 2 * c;
    f[2][4] = t;
    for (std::size_t i = 0; i < 6; ++i) {
      for (std::size_t j = 0; j < 6; ++j) {
        fp[i][j] = 0;
        for (std::size_t k = 0; k < 6; ++k) fp[i][j] += f[i][k] * p[k][j];
      }
    }
    for (std::size_t i = 0; i < 6; ++i) {
      for (std::size_t j = 0; j < 6; ++j) {
        p[i][j] = i == j ? 1e-4 : 0;
        for (std::size_t k = 0; k < 6; ++k) p[i][j] += fp[i][k] * f[j][k];
      }
    }
    benchmark::DoNotOptimize(p);
  }
}
BENCHMARK(pose_predict_by_hand);

void pose_predict(benchmark::State& state) {
  PoseEkf ekf = ready();
  for (auto _ : state) {
    ekf.predict({}, 10ms);
    benchmark::DoNotOptimize(ekf);
  }
}
BENCHMARK(pose_predict);

/// What a field robot does at the rate of its wheels: predict, wheels, gyro.
void pose_step(benchmark::State& state) {
  PoseEkf ekf = ready();
  WheelMeasurement wheels{.speed_mps = 0.5, .w_radps = 0.2, .speed_sd_mps = 0.05, .w_sd_radps = 0.05};
  GyroMeasurement gyro{.w_radps = 0.2, .sd_radps = 0.01};
  for (auto _ : state) {
    benchmark::DoNotOptimize(wheels);
    benchmark::DoNotOptimize(gyro);
    ekf.predict({}, 10ms);
    ekf.correct(wheels);
    ekf.correct(gyro);
    benchmark::DoNotOptimize(ekf);
  }
}
BENCHMARK(pose_step);

/// The same with heading and position: everything at once.
void pose_step_with_all_sensors(benchmark::State& state) {
  PoseEkf ekf = ready();
  WheelMeasurement wheels{.speed_mps = 0, .w_radps = 0, .speed_sd_mps = 0.05, .w_sd_radps = 0.05};
  GyroMeasurement gyro{.w_radps = 0, .sd_radps = 0.01};
  HeadingMeasurement heading{.heading_rad = 0.5, .sd_rad = 0.1};
  PositionMeasurement position{.x = 1, .y = 2, .sd_m = 0.5};
  for (auto _ : state) {
    benchmark::DoNotOptimize(wheels);
    benchmark::DoNotOptimize(position);
    ekf.predict({}, 10ms);
    ekf.correct(wheels);
    ekf.correct(gyro);
    ekf.correct(heading);
    ekf.correct(position);
    benchmark::DoNotOptimize(ekf);
  }
  if (ekf.state().position.refused > 0) state.SkipWithError("refused");
}
BENCHMARK(pose_step_with_all_sensors);

// ---- Late measurements --------------------------------------------------------------------------------------------

/// Inertial input at 1 kHz, vision at 60 Hz and 35 ms late: the mean over all steps.
void translation_with_late_vision(benchmark::State& state) {
  TranslationFilter plain;
  plain.correct(PositionMeasurement{.sd_m = 0.004});
  Rollback<TranslationFilter> filter{plain};
  std::uint64_t step = 0;
  for (auto _ : state) {
    filter.predict({.x = 0.1, .y = 0}, 1ms);
    if (++step % 16 == 0) filter.correct(PositionMeasurement{.sd_m = 1}, std::min<Duration>(filter.reach(), 35ms));
    benchmark::DoNotOptimize(filter);
  }
}
BENCHMARK(translation_with_late_vision);

}  // namespace
