// SPDX-License-Identifier: Apache-2.0
// From a camera's picture to robots and ball, for half a field of 12 robots, beside a bare copy of the picture, and
// beside what OpenCV takes only to segment it: the hue, a mask for each of five colours, and their connected
// components.
#include <benchmark/benchmark.h>

#include <opencv2/core/utility.hpp>

#include "../tests/camera/rendered_field.hpp"

namespace regista::camera {
namespace {

rendered::Camera camera_of(const benchmark::State& state) {
  rendered::Camera camera = rendered::Camera::above(0.1, 0.05, 4);
  const double scale = static_cast<double>(state.range(0)) / camera.size.width;
  camera.size = {static_cast<int>(state.range(0)), static_cast<int>(state.range(1))};
  camera.focal_px *= scale;
  camera.principal *= scale;
  return camera;
}

cv::Mat picture_of(const benchmark::State& state) {
  std::vector<rendered::Robot> robots;
  for (int i = 0; i < 12; ++i) {
    robots.push_back({.id = {i < 6 ? ssl::Team::yellow : ssl::Team::blue, static_cast<std::uint8_t>(i % 6)},
                      .pose = {-2 + 0.35 * i, (i % 4) * 0.6 - 0.9, 0.5 * i}});
  }
  return render(camera_of(state), robots, {{0.3, 0.2}}, {.gradient = 0.3, .noise = 4});
}

void copy(benchmark::State& state) {
  const cv::Mat picture = picture_of(state);
  cv::Mat to;
  for (auto _ : state) {
    picture.copyTo(to);
    benchmark::DoNotOptimize(to.data);
    benchmark::ClobberMemory();
  }
}

void segment_with_opencv(benchmark::State& state) {
  cv::setNumThreads(1);
  const cv::Mat picture = picture_of(state);
  cv::Mat hsv;
  cv::Mat mask;
  cv::Mat labels;
  cv::Mat stats;
  cv::Mat centroids;
  for (auto _ : state) {
    cv::cvtColor(picture, hsv, cv::COLOR_BGR2HSV);
    for (const int hue : {10, 25, 60, 108, 155}) {
      cv::inRange(hsv, cv::Scalar(hue - 8, 110, 120), cv::Scalar(hue + 8, 255, 255), mask);
      benchmark::DoNotOptimize(cv::connectedComponentsWithStats(mask, labels, stats, centroids));
    }
  }
}

void detect(benchmark::State& state) {
  const cv::Mat picture = picture_of(state);
  Detector detector{camera_of(state).calibration(), {}};
  ssl::Detection out;
  for (auto _ : state) {
    if (!detector.detect(rendered::view(picture), out)) state.SkipWithError("not detected");
    benchmark::DoNotOptimize(out.robots.data());
  }
  if (out.robots.size() != 12 || out.balls.size() != 1) state.SkipWithError("robots are missing");
  state.counters["pictures/s"] = benchmark::Counter(1, benchmark::Counter::kIsIterationInvariantRate);
}

BENCHMARK(copy)->Name("camera_780x580/copy")->Args({780, 580});
BENCHMARK(segment_with_opencv)->Name("camera_780x580/opencv_segments")->Args({780, 580});
BENCHMARK(detect)->Name("camera_780x580/detect")->Args({780, 580});
BENCHMARK(copy)->Name("camera_1280x1024/copy")->Args({1280, 1024});
BENCHMARK(segment_with_opencv)->Name("camera_1280x1024/opencv_segments")->Args({1280, 1024});
BENCHMARK(detect)->Name("camera_1280x1024/detect")->Args({1280, 1024});

}  // namespace
}  // namespace regista::camera
