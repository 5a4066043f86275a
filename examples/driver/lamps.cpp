// SPDX-License-Identifier: Apache-2.0
// Three lamps behind the interface for what no interface describes: bytes. A command holds their brightness, one byte
// each; a request asks how many there are; the state tells what they do.
#include <regista/device/plugin.hpp>

using namespace regista;

class Lamps final : public Driver {
 public:
  explicit Lamps(Setup& setup) : port_{setup.provide<Opaque>()} {
    port_.on<opaque::Command>([this](const opaque::Command& command) -> Result<> {
      if (command.bytes.size() != bytes_.size()) {
        return Error{std::errc::invalid_argument, std::to_string(command.bytes.size()) + " bytes for 3 lamps"};
      }
      bytes_ = command.bytes;
      return {};
    });
    port_.on<opaque::Request>([this](const auto&) -> Result<opaque::Request> {
      return opaque::Request{{static_cast<std::uint8_t>(bytes_.size())}};
    });
  }

  Result<> read(const Tick&) override { return {}; }  // here a real driver would set its lamps
  void publish() override { port_.send(opaque::State{bytes_}); }
  void halt() noexcept override {}  // lamps harm nobody

 private:
  Port<Opaque> port_;
  std::vector<std::uint8_t> bytes_ = {0, 0, 0};
};

extern "C" const Plugin regista_plugin{
    .name = "lamps",
    .summary = "Three lamps that can be dimmed",
    .stops_by_itself = true,
    .create = [](Setup& setup) -> std::unique_ptr<Driver> { return std::make_unique<Lamps>(setup); }};
