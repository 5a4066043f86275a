// SPDX-License-Identifier: Apache-2.0
// A turntable: one motor that turns a plate, as a driver of its own. docs/writing-a-driver.md goes through it.
#include <algorithm>
#include <cmath>
#include <regista/device/plugin.hpp>

using namespace regista;

class Turntable final : public Driver {
 public:
  explicit Turntable(Setup& setup)
      : axis_{setup.provide<Position1d>()},
        gain_{setup.property<double>("gain", setup.config.number("gain", 2.0, {.min = 0, .max = 10}),
                                     {.min = 0, .max = 10})},                    // [1/s] towards a position
        fastest_{setup.config.angle("fastest", 1.5, {.min = 0.01, .max = 10})},  // [rad/s]
        radius_{setup.config.length("radius", 0.15, {.min = 0.01, .max = 2})} {  // [m]
    axis_.on<position1d::VelocityCommand>([this](const auto& command) { target_ = command; });
    axis_.on<position1d::PositionCommand>([this](const auto& command) { target_ = command; });
    axis_.on<position1d::GetGeometry>([this](const auto&) -> Result<position1d::Geometry> {
      return position1d::Geometry{.size = {.width = 2 * radius_, .length = 2 * radius_, .height = 0.05}};
    });
    axis_.on<position1d::SetOdometry>([this](const position1d::SetOdometry& here) -> Result<Empty> {
      if (velocity_ != 0) return Error{std::errc::device_or_resource_busy, "the table turns: stop it first"};
      position_ = here.position;
      return Empty{};
    });
  }

  // Here a real driver exchanges a frame with its motor. This one has none, so the plate obeys at once.
  Result<> read(const Tick& tick) override {
    velocity_ =
        std::clamp(std::visit([this](const auto& command) { return wanted(command); }, target_), -fastest_, fastest_);
    position_ += velocity_ * seconds(tick.dt);
    return {};
  }

  void publish() override {
    axis_.send(position1d::State{.position = static_cast<float>(position_), .velocity = static_cast<float>(velocity_)});
  }

  void halt() noexcept override { target_ = position1d::VelocityCommand{}; }

 private:
  [[nodiscard]] double wanted(const position1d::VelocityCommand& command) const { return command.velocity; }
  [[nodiscard]] double wanted(const position1d::PositionCommand& command) const {
    const double limit = command.velocity == 0 ? fastest_ : std::abs(command.velocity);
    return std::clamp(*gain_ * (command.position - position_), -limit, limit);
  }

  Port<Position1d> axis_;
  Property<double> gain_;
  double fastest_, radius_, position_ = 0, velocity_ = 0;
  std::variant<position1d::VelocityCommand, position1d::PositionCommand> target_;
};

extern "C" const Plugin regista_plugin{
    .name = "turntable",
    .summary = "A plate that a motor turns",
    .stops_by_itself = true,
    .create = [](Setup& setup) -> std::unique_ptr<Driver> { return std::make_unique<Turntable>(setup); }};
