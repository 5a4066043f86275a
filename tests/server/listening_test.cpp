// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <fake_base.hpp>
#include <regista/server/server.hpp>

namespace regista {
namespace {

constexpr Plugin fake_base{
    .name = "fake_base", .summary = "", .stops_by_itself = true, .create = [](Setup& setup) -> std::unique_ptr<Driver> {
      return std::make_unique<FakeBase>(setup);
    }};

Server serving(const std::string& device, std::uint16_t port) {
  return {parse_config("driver ( name \"fake_base\" provides [\"" + device + "\"] )", "test.cfg"),
          {.port = port, .plugins = {&fake_base}}};
}

TEST(Listening, on_the_default_port_although_a_device_names_it) {
  const std::uint16_t port = serving("position2d:0", 0).port();  // one that is free
  EXPECT_EQ(serving(std::to_string(port) + ":position2d:0", port).port(), port);
}

}  // namespace
}  // namespace regista
