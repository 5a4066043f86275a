// SPDX-License-Identifier: Apache-2.0
#include "differential.hpp"

#include <cmath>
#include <numbers>

#include "bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;

constexpr double radius_m = 0.1;
constexpr double track_m = 0.4;
constexpr const char* keys = "provides [\"position2d:0\"] requires [\"actarray:0\"] wheel_radius 0.1 track 0.4 ";
constexpr const char* ramps = "accel 2 turn_accel 300";

/// Wheels without inertia, which do what they are told. `true_radii_m`: what they really measure.
class Wheels final : public Driver {
 public:
  explicit Wheels(Setup& setup, std::size_t count) : port_{setup.provide<Actarray>()}, speeds(count), angles(count) {
    port_.on<actarray::MultiSpeedCommand>([this](const actarray::MultiSpeedCommand& command) {
      for (std::size_t i = 0; i < speeds.size(); ++i) speeds[i] = static_cast<double>(command.speeds.at(i));
    });
    port_.on<actarray::SetPower>([this](const actarray::SetPower& request) -> Result<Empty> {
      powered = request.on != 0;
      return Empty{};
    });
    port_.on<actarray::GetGeometry>([this](const auto&) -> Result<actarray::Geometry> {
      actarray::Geometry geometry;
      geometry.actuators.resize(speeds.size(), {.speed = 20});
      return geometry;
    });
  }
  Result<> read(const Tick& tick) override {
    for (std::size_t i = 0; i < speeds.size(); ++i) {
      if (!powered) speeds[i] = 0;
      angles[i] += speeds[i] * seconds(tick.dt);
    }
    return {};
  }
  void publish() override {
    if (silent) return;
    actarray::State state;
    for (std::size_t i = 0; i < speeds.size(); ++i) {
      // As a float stays exact: it rolls over after 512 turns.
      const double angle = std::remainder(angles[i], 1024 * std::numbers::pi);
      state.actuators.push_back({.position = static_cast<float>(angle), .speed = static_cast<float>(speeds[i])});
    }
    state.motors_on = powered ? 1 : 0;
    port_.send(state);
  }
  void halt() noexcept override { std::ranges::fill(speeds, 0); }

 private:
  Port<Actarray> port_;

 public:
  std::vector<double> speeds;
  std::vector<double> angles;
  bool powered = true;
  bool silent = false;
};

std::unique_ptr<Setup> setup_of(const std::string& more) {
  return std::make_unique<Setup>(parse_config("driver ( name \"x\" " + more + " )", "test.cfg").drivers.at(0));
}

/// The base in its host, on wheels in theirs.
struct Base {
  explicit Base(const std::string& more = ramps, std::size_t count = 2) : bench{keys + more, create} {
    auto setup = setup_of("provides [\"actarray:0\"]");
    auto driver = std::make_unique<Wheels>(*setup, count);
    wheels = driver.get();
    provider = std::make_unique<DriverHost>("wheels", std::move(setup), std::move(driver),
                                            HostOptions{.rate_hz = 100, .motion = {}});
    join(bench.host(), *required, *provider, 0, first_driver_session);
    run(500ms);
    bench.events();
  }

  static std::unique_ptr<Driver> create(Setup& setup) {
    auto driver = std::make_unique<Differential>(setup);
    required = &setup.required.front();
    return driver;
  }

  void run(Duration duration) {
    for (Duration left = duration; left > 0ms; left -= 1ms) {
      bench.run(1ms);
      provider->cycle(bench.now());
    }
  }
  void drive(double x, double w, Duration duration) {
    for (Duration left = duration; left > 0ms; left -= 100ms) {
      bench.send(position2d::VelocityCommand{.velocity = {.x = x, .w = w}});
      run(std::min<Duration>(100ms, left));
    }
  }
  void stop() {
    drive(0, 0, 2s);
    run(100ms);
  }
  [[nodiscard]] Pose2d pose() const { return bench.latest<position2d::State>().pose; }

  static inline RequiredCore* required = nullptr;
  Bench bench;
  Wheels* wheels = nullptr;
  std::unique_ptr<DriverHost> provider;
};

TEST(Differential, forward_turns_both_wheels_forward_and_left_turns_the_right_one_faster) {
  Base base;
  base.drive(0.5, 0, 1s);
  EXPECT_NEAR(base.wheels->speeds[0], 5, 1e-5);
  EXPECT_NEAR(base.wheels->speeds[1], 5, 1e-5);
  base.drive(0, 1, 1s);
  EXPECT_NEAR(base.wheels->speeds[0], -2, 1e-5);
  EXPECT_NEAR(base.wheels->speeds[1], 2, 1e-5);
  EXPECT_NEAR(base.bench.latest<position2d::State>().velocity.w, 1, 1e-5);
}

TEST(Differential, its_odometry_is_the_exact_arc) {
  Base base;
  base.drive(0.5, 0.8, 3s);
  base.stop();
  // All of it on one circle of v/w, but for the ramps, whose ratio differs: from the wheels' own way.
  const double left = radius_m * base.wheels->angles[0];
  const double right = radius_m * base.wheels->angles[1];
  EXPECT_NEAR(base.pose().heading, wrap_angle((right - left) / track_m), 1e-5);

  // On a circle alone, with accelerations that keep the ratio, against the closed form.
  Base circle{"accel 1 turn_accel 91.67324722"};  // 1.6 rad/s²: 1 m/s² : 1.6 rad/s² = 0.5 m/s : 0.8 rad/s
  circle.drive(0.5, 0.8, 10s);
  circle.stop();
  const double way = radius_m * (circle.wheels->angles[0] + circle.wheels->angles[1]) / 2;
  const double turned = radius_m * (circle.wheels->angles[1] - circle.wheels->angles[0]) / track_m;
  const double curve_m = way / turned;
  EXPECT_NEAR(curve_m, 0.625, 1e-3);
  EXPECT_NEAR(circle.pose().x, curve_m * std::sin(turned), 1e-4);
  EXPECT_NEAR(circle.pose().y, curve_m * (1 - std::cos(turned)), 1e-4);
  EXPECT_NEAR(circle.pose().heading, wrap_angle(turned), 1e-4);
}

TEST(Differential, an_hour_of_rolling_over_wheels_loses_no_way) {
  Base base;
  base.wheels->angles = {3216.9, 3216.9};  // just before it rolls over: 512 turns
  base.run(100ms);
  (void)base.bench.ask(position2d::ResetOdometry{});
  const double before = base.wheels->angles[0];
  base.drive(1, 0, 5s);
  base.stop();
  EXPECT_NEAR(base.pose().x, radius_m * (base.wheels->angles[0] - before), 1e-3);
  EXPECT_NEAR(base.pose().y, 0, 1e-4);
}

TEST(Differential, keeps_its_ramps_and_the_wheels_limit) {
  Base base{"accel 0.5"};
  base.drive(1, 0, 500ms);
  EXPECT_NEAR(base.bench.latest<position2d::State>().velocity.x, 0.25, 0.03);
  Base fast{"accel 100 turn_accel 6000"};
  fast.drive(1.9, 2, 1s);  // the right wheel would need 23 rad/s, and can do 20
  EXPECT_NEAR(fast.wheels->speeds[1], 20, 1e-4);
  EXPECT_NEAR(fast.wheels->speeds[0] / fast.wheels->speeds[1], 1.5 / 2.3, 1e-5) << "the same curve, slower";
}

TEST(Differential, four_wheels_turn_side_by_side) {
  Base base{std::string{ramps} + " skid_steer yes", 4};
  base.drive(0.5, 0.5, 1s);
  EXPECT_NEAR(base.wheels->speeds[0], 4, 1e-5) << "front left";
  EXPECT_NEAR(base.wheels->speeds[1], 6, 1e-5) << "front right";
  EXPECT_NEAR(base.wheels->speeds[2], 4, 1e-5) << "rear left";
  EXPECT_NEAR(base.wheels->speeds[3], 6, 1e-5) << "rear right";
  EXPECT_NEAR(base.bench.latest<position2d::State>().velocity.x, 0.5, 1e-5);
  EXPECT_NEAR(base.bench.latest<position2d::State>().velocity.w, 0.5, 1e-5);
}

TEST(Differential, passes_motor_power_on_and_refuses_without) {
  Base base;
  (void)base.bench.ask(position2d::SetMotorPower{.on = 0});
  base.run(1s);
  EXPECT_FALSE(base.wheels->powered);
  base.bench.events();
  base.drive(0.5, 0, 100ms);
  EXPECT_EQ(base.bench.events(), "position2d:0 refused: the motors are off: ask for MOTOR_POWER 1\n");
  (void)base.bench.ask(position2d::SetMotorPower{.on = 1});
  base.run(100ms);
  EXPECT_TRUE(base.wheels->powered);
  EXPECT_EQ(base.wheels->speeds[0], 0) << "what was refused is forgotten";
}

TEST(Differential, wheels_that_lose_their_power_take_the_destination_with_them) {
  Base base;
  base.drive(0.5, 0, 1s);
  base.wheels->powered = false;
  base.run(100ms);
  EXPECT_NE(base.bench.events().find("position2d:0 stopped: the wheels' motors are off"), std::string::npos);
  base.wheels->powered = true;
  base.run(400ms);
  EXPECT_EQ(base.wheels->speeds[0], 0);
}

TEST(Differential, is_not_stopped_by_what_its_last_user_switched_off) {
  Base base;
  (void)base.bench.ask(player::Subscribe{.access = player::Access::close});
  base.wheels->powered = false;
  base.run(1s);
  (void)base.bench.ask(player::Subscribe{.access = player::Access::open});
  base.run(100ms);
  (void)base.bench.ask(position2d::SetMotorPower{.on = 1});
  base.run(100ms);
  EXPECT_TRUE(base.wheels->powered);
  base.drive(0.5, 0, 300ms);
  EXPECT_GT(base.wheels->speeds[0], 0);
}

TEST(Differential, stops_when_its_wheels_fall_silent) {
  Base base;
  base.drive(0.5, 0, 1s);
  base.wheels->silent = true;
  base.drive(0.5, 0, 400ms);
  EXPECT_NE(base.bench.events().find("position2d:0 stopped: no data of the wheels for 2"), std::string::npos);
  base.run(200ms);
  EXPECT_EQ(base.wheels->speeds[0], 0);
}

TEST(Differential, stops_with_its_client) {
  Base base;
  base.drive(0.5, 0, 1s);
  base.run(2s);
  EXPECT_EQ(base.wheels->speeds[0], 0);
  EXPECT_EQ(base.bench.latest<position2d::State>().velocity, BodyVelocity{});
}

TEST(Differential, a_restart_of_the_wheels_is_no_way) {
  Base base;
  base.drive(0.5, 0, 2s);
  base.stop();
  const Pose2d before = base.pose();
  base.wheels->angles = {-500, 700};
  base.run(100ms);
  EXPECT_EQ(base.pose(), before);
  EXPECT_NE(base.bench.events().find("the wheels' angles jumped"), std::string::npos);
}

TEST(Differential, finds_radius_and_track_from_known_runs) {
  Base base;
  const auto write = [&](const char* what) {
    ASSERT_TRUE(base.bench.ask(property::SetText{.key = Text{"calibrate"}, .value = Text{what}}));
  };
  // The wheels are 3 % larger than the .cfg says, the base 5 % wider.
  write("start");
  base.drive(0.5, 0, 4s);
  base.stop();
  const double driven_m = 1.03 * radius_m * base.wheels->angles[0];
  write(("distance " + std::to_string(driven_m)).c_str());
  const double before = base.wheels->angles[1] - base.wheels->angles[0];
  write("start");
  base.drive(0, 1, 10s);
  base.stop();
  const double turned_rad =
      1.03 * radius_m * (base.wheels->angles[1] - base.wheels->angles[0] - before) / (1.05 * track_m);
  write(("angle " + std::to_string(turned_rad)).c_str());
  const auto found = base.bench.ask(property::GetText{.key = Text{"calibration"}});
  ASSERT_TRUE(found);
  EXPECT_EQ(found->value.view(), "wheel_radius [0.103 0.103] track 0.42");
  write("distance 1");
  EXPECT_NE(base.bench.events().find("calibrate: write \"start\", drive, then"), std::string::npos);
}

}  // namespace
}  // namespace regista
