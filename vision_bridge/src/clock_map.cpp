// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/vision/clock_map.hpp>

namespace regista::vision {

namespace {

constexpr double worst_drift = 0.03;          // grSim's clock runs 2 % slow
constexpr double worst_jitter_s = 0.02;       // more than that is a clock that was set
constexpr double longest_processing_s = 0.5;  // more than that are two clocks

}  // namespace

Time ClockMap::captured(double t_capture_s, double t_sent_s, Time arrival, Duration delay) {
  const double said = t_sent_s - t_capture_s;
  const double processing = said >= 0 && said <= longest_processing_s ? said : 0;
  const double sample = seconds(arrival.time_since_epoch()) - t_sent_s;
  const double grown = offset_s_ + worst_drift * seconds(arrival - last_);
  offset_s_ = started_ ? std::clamp(grown, sample - worst_jitter_s, sample) : sample;
  started_ = true;
  last_ = arrival;
  return arrival - from_seconds(sample - offset_s_) - from_seconds(processing) - delay;
}

}  // namespace regista::vision
