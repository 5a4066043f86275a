// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <regista/device/driver.hpp>
#include <regista/sim/random.hpp>
#include <regista/sim/simple_base.hpp>
#include <regista/testing/rig.hpp>
#include <vector>

#include "localizer.hpp"
#include "posture.hpp"
#include "waypoint.hpp"

namespace regista {

/// What a test does to the sensors, and what it sees of the plant.
struct World {
  bool wheels = true;  ///< they say something
  bool imu = true;
  bool gps = true;
  bool stuck = false;     ///< the base does not move
  double gps_jump_m = 0;  ///< added to each fix
  Duration gps_late{};    ///< a fix is told so long after it was true
  double fix_sd_m = 0.1;  ///< as the receiver says
  double gyro_radps = 0;  ///< added; NaN breaks it
  double wheels_mps = 0;  ///< added; NaN breaks them

  Pose2d truth{};
  BodyVelocity commanded{};
  std::vector<std::uint32_t> outputs{};  ///< of the dio, as they were commanded
  std::string relay_trouble{};           ///< why the dio refuses commands
  bool relays_stuck = false;             ///< it takes them, and its hardware does not
};

/// A differential base in a field, with fixes from outside, IMU and relays.
class Plant final : public Driver {
 public:
  Plant(Setup& setup, World& field)
      : field_{field},
        base_port_{setup.provide<Position2d>()},
        fix_{setup.provide<Localize>()},
        imu_{setup.provide<Imu>()},
        dio_{setup.provide<Dio>()},
        base_{{.holonomic = false, .time_constant_s = 0.05, .max_accel_mps2 = 2}} {
    base_.place(field.truth);
    base_port_.on<position2d::VelocityCommand>([this](const auto& c) { field_.commanded = c.velocity; });
    dio_.on<dio::OutputCommand>([this](const auto& c) -> Result<> {
      if (!field_.relay_trouble.empty()) return Error{std::errc::io_error, field_.relay_trouble};
      field_.outputs.push_back(c.bits);
      if (!field_.relays_stuck) confirmed_ = c.bits;
      return {};
    });
  }

  Result<> read(const Tick& tick) override {
    base_.command(field_.stuck ? BodyVelocity{} : field_.commanded);
    if (field_.truth != base_.state().pose) base_.place(field_.truth);  // somebody carried it
    const auto& state = base_.step(tick.dt);
    odometry_ = odometry_ * (inverse(field_.truth) * state.pose);
    field_.truth = state.pose;
    now_ = tick.now;
    return {};
  }

  void publish() override {
    const BodyVelocity velocity = base_.state().velocity;
    if (field_.wheels) {
      base_port_.send(position2d::State{.pose = odometry_,
                                        .velocity = {.x = velocity.x + field_.wheels_mps + noise_.normal(0.005),
                                                     .w = velocity.w + noise_.normal(0.01)}});
    }
    if (field_.imu) {
      imu::Euler euler;
      euler.samples.rate_z = static_cast<float>(velocity.w + field_.gyro_radps + 0.01 + noise_.normal(0.005));
      euler.orientation.yaw = wrap_angle(field_.truth.heading + noise_.normal(0.02));
      imu_.send(euler);
    }
    dio_.send(dio::State{.count = 8, .bits = confirmed_});
    if (!field_.gps || beat_++ % 20 != 0) return;
    fixes_.push_back(
        {now_, localize::State{.hypotheses = {{.mean = {.x = field_.truth.x + field_.gps_jump_m + noise_.normal(0.1),
                                                        .y = field_.truth.y + noise_.normal(0.1)},
                                               .covariance = {field_.fix_sd_m * field_.fix_sd_m,
                                                              field_.fix_sd_m * field_.fix_sd_m, 3.29},
                                               .weight = 1}}}});
    for (; !fixes_.empty() && now_ - fixes_.front().first >= field_.gps_late; fixes_.erase(fixes_.begin())) {
      fix_.send(fixes_.front().second, fixes_.front().first);
    }
  }

  void halt() noexcept override { field_.commanded = {}; }

 private:
  World& field_;
  Port<Position2d> base_port_;
  Port<Localize> fix_;
  Port<Imu> imu_;
  Port<Dio> dio_;
  sim::SimpleBase base_;
  sim::Random noise_{7};
  Pose2d odometry_;
  Time now_{};
  unsigned beat_ = 0;
  std::uint32_t confirmed_ = 0;
  std::vector<std::pair<Time, localize::State>> fixes_;
};

inline std::map<std::string, testing::Rig::Create> drivers_in(World& field) {
  return {{"plant", [&field](Setup& setup) { return std::make_unique<Plant>(setup, field); }},
          {"localizer", [](Setup& setup) { return std::make_unique<Localizer>(setup); }},
          {"posture", [](Setup& setup) { return std::make_unique<Posture>(setup); }},
          {"waypoint", [](Setup& setup) { return std::make_unique<Waypoint>(setup); }}};
}

constexpr const char* plant_section =
    R"(driver ( name "plant" provides ["position2d:0" "localize:0" "imu:0" "dio:0"] rate 100 ramp 2 turn_ramp 200 ) )";
constexpr const char* localizer_section =
    R"(driver ( name "localizer" provides ["position2d:1" "localize:1"] requires ["position2d:0" "imu:0" "localize:0"]
       imu_heading yes heading_sd 2 ) )";

}  // namespace regista
