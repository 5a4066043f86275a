// SPDX-License-Identifier: Apache-2.0
#include "can_motor.hpp"

#include <numbers>

#include "bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;
using canopen::Cia402State;
using canopen::NodeId;

constexpr std::array<NodeId, 2> nodes{5, 6};
constexpr const char* keys =
    "provides [\"actarray:0\" \"power:0\" \"dio:0\"] bus \"simulated\" nodes [5 6] gear 20 wheel_speed 1200 "
    "wheel_accel 2000 wheel_decel 2000 quick_stop 4000 ";

struct SimulatedDrives {
  sim::CanDrives* drives = nullptr;
};

/// The driver with two simulated drives, which a test can look into.
struct Drives : SimulatedDrives, Bench {
  explicit Drives(const std::string& more = "increments 4096", const sim::CanDriveParameters& parameters = {})
      : Bench{keys + more, [&](Setup& setup) -> std::unique_ptr<Driver> {
                auto link = std::make_unique<can_motor::SimulatedBusLink>(nodes, parameters, 500'000);
                drives = &link->drives();
                return std::make_unique<CanMotor>(setup, std::move(link));
              }} {}

  /// POWER 1, and its answer, which takes its time.
  Result<> power_up() {
    const auto asked = ask(actarray::SetPower{.on = 1});
    if (asked) return {};
    if (asked.error().code != std::errc::timed_out) return asked.error();
    run(3500ms);
    if (!last_reply()) return Error{std::errc::timed_out, "never answered"};
    if (!*last_reply()) return last_reply()->error();
    return {};
  }
  Result<> up() {
    run(1s);
    return power_up();
  }
  void turn(float left, float right, Duration duration) {
    drive(actarray::MultiSpeedCommand{.speeds = {left, right}}, duration);
  }
  [[nodiscard]] Cia402State state(std::size_t i) const { return drives->drive(i).drive().state(); }
  [[nodiscard]] double rpm(std::size_t i) const { return drives->drive(i).drive().speed_rpm(); }
  std::string text(const std::string& key) {
    const auto reply = ask(property::GetText{.key = Text{key}});
    return reply ? std::string{reply->value.view()} : reply.error().message();
  }
};

TEST(CanMotor, brings_drives_up_but_enables_them_only_on_request) {
  Drives bench;
  bench.run(1s);
  EXPECT_EQ(bench.events(), "actarray:0: node 5: up, switch on disabled\nactarray:0: node 6: up, switch on disabled\n");
  EXPECT_EQ(bench.state(0), Cia402State::switch_on_disabled);
  bench.turn(3, 3, 300ms);
  EXPECT_EQ(bench.rpm(0), 0);
  EXPECT_EQ(bench.events(), "actarray:0 refused: the drives are off: ask for POWER 1\n");
  ASSERT_TRUE(bench.power_up());
  EXPECT_EQ(bench.state(0), Cia402State::operation_enabled);
  EXPECT_EQ(bench.state(1), Cia402State::operation_enabled);
  EXPECT_EQ(bench.rpm(0), 0) << "what was commanded before is forgotten";
  EXPECT_EQ(bench.latest<actarray::State>().motors_on, 1);
}

TEST(CanMotor, turns_each_wheel_at_its_own_speed_and_tells_how_far) {
  Drives bench{"increments 4096 reversed [6]"};
  ASSERT_TRUE(bench.up());
  bench.turn(4, -2, 3s);
  const auto wheels = bench.latest<actarray::State>().actuators;
  ASSERT_EQ(wheels.size(), 2U);
  EXPECT_NEAR(wheels[0].speed, 4, 0.01);
  EXPECT_NEAR(wheels[1].speed, -2, 0.01);
  EXPECT_NEAR(bench.rpm(0), 4 * 20 * 60 / (2 * std::numbers::pi), 1);
  EXPECT_NEAR(bench.rpm(1), 2 * 20 * 60 / (2 * std::numbers::pi), 1) << "mounted the other way round";
  // One increment of 4096 x 20 in a turn, and what a message is old.
  EXPECT_NEAR(wheels[0].position, bench.drives->drive(0).drive().turns() / 20 * 2 * std::numbers::pi, 0.1);
  EXPECT_NEAR(wheels[1].position, -bench.drives->drive(1).drive().turns() / 20 * 2 * std::numbers::pi, 0.1);
  EXPECT_EQ(wheels[0].state, actarray::ActuatorState::moving);
}

TEST(CanMotor, stops_when_its_client_falls_silent) {
  Drives bench;
  ASSERT_TRUE(bench.up());
  bench.turn(5, 5, 1s);
  EXPECT_GT(bench.rpm(0), 900);
  bench.run(2s);
  EXPECT_EQ(bench.rpm(0), 0);
  EXPECT_EQ(bench.state(0), Cia402State::operation_enabled);
}

}  // namespace
}  // namespace regista
