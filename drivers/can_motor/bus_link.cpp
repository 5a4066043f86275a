// SPDX-License-Identifier: Apache-2.0
#include "bus_link.hpp"

#include <regista/canopen/open_bus.hpp>
#include <regista/canopen/pump.hpp>

namespace regista::can_motor {
namespace {

class RealBusLink final : public BusLink {
 public:
  explicit RealBusLink(std::string name) : name_{std::move(name)} {}

  Result<canopen::CanBus*> open() override {
    close();
    auto bus = canopen::open_bus(name_);
    if (!bus) return bus.error();
    bus_ = *std::move(bus);
    return bus_.get();
  }
  void join(canopen::Station& station) override { pump_.emplace(*bus_, station); }
  Result<> run(Time now) override { return pump_->run(now); }
  void close() noexcept override {
    pump_.reset();
    bus_.reset();
  }
  [[nodiscard]] int descriptor() const override { return pump_ ? pump_->descriptor() : -1; }

 private:
  std::string name_;
  std::unique_ptr<canopen::CanBus> bus_;
  std::optional<canopen::Pump> pump_;
};

}  // namespace

std::unique_ptr<BusLink> make_bus_link(const std::string& name) { return std::make_unique<RealBusLink>(name); }

}  // namespace regista::can_motor
