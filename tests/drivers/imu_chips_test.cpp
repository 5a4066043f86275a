// SPDX-License-Identifier: Apache-2.0
#include "imu_chips.hpp"

#include <gtest/gtest.h>

#include <array>
#include <map>
#include <numbers>

namespace regista {
namespace {

/// Two chips as their data sheets have them: registers that are read from an address on, upwards.
class FakeBus final : public I2cBus {
 public:
  Result<> open() override { return {}; }
  void close() noexcept override {}
  Result<> transfer(std::uint8_t chip, std::span<const std::uint8_t> out, std::span<std::uint8_t> in) override {
    if (!chips.contains(chip)) return Error{std::errc::io_error, "no acknowledge"};
    auto& registers = chips[chip];
    for (std::size_t i = 1; i < out.size(); ++i) registers[out[0] + i - 1] = out[i];
    for (std::size_t i = 0; i < in.size(); ++i) in[i] = registers[out[0] + i];
    return {};
  }

  std::map<std::uint8_t, std::array<std::uint8_t, 128>> chips{{std::uint8_t{0x53}, {0xE5}},
                                                              {std::uint8_t{0x68}, {0x68}}};
};

class Chips : public testing::Test {
 protected:
  Chips() {
    auto bus = std::make_unique<FakeBus>();
    bus_ = bus.get();
    chips_ = std::make_unique<ImuChips>(std::move(bus));
  }
  FakeBus* bus_;
  std::unique_ptr<ImuChips> chips_;
};

TEST_F(Chips, are_set_up_as_their_data_sheets_say) {
  ASSERT_TRUE(chips_->open());
  const auto& adxl = bus_->chips[0x53];
  EXPECT_EQ(adxl[0x2D] & 0x08, 0x08) << "measures";
  EXPECT_EQ(adxl[0x31], 0x0B) << "full resolution, 16 g, right-justified";
  EXPECT_EQ(adxl[0x2C], 0x0D) << "800 Hz";
  const auto& itg = bus_->chips[0x68];
  EXPECT_EQ(itg[0x16] >> 3, 3) << "the only range that works";
  EXPECT_EQ(itg[0x3E], 1) << "clock of a gyro";
}

TEST_F(Chips, read_gravity_and_turn_rates_in_si_units) {
  ASSERT_TRUE(chips_->open());
  auto& adxl = bus_->chips[0x53];
  adxl[0x32] = 0x00, adxl[0x33] = 0xFF;  // x: -256, one g backwards
  adxl[0x36] = 0x00, adxl[0x37] = 0x01;  // z: +256
  auto& itg = bus_->chips[0x68];
  itg[0x1F] = 0xFA, itg[0x20] = 0x62;  // y: -1438, 100 °/s clockwise
  itg[0x21] = 0x05, itg[0x22] = 0x9E;  // z: +1438
  const auto sample = chips_->read();
  ASSERT_TRUE(sample);
  EXPECT_NEAR(sample->accel_mps2.x(), -9.80665, 1e-9);
  EXPECT_NEAR(sample->accel_mps2.y(), 0, 1e-9);
  EXPECT_NEAR(sample->accel_mps2.z(), 9.80665, 1e-9);
  EXPECT_NEAR(sample->rate_radps.y() * 180 / std::numbers::pi, -100, 0.1);
  EXPECT_NEAR(sample->rate_radps.z() * 180 / std::numbers::pi, 100, 0.1);
}

TEST_F(Chips, that_are_not_there_or_others_are_an_error) {
  bus_->chips[0x68][0] = 0x12;
  EXPECT_EQ(chips_->open().error().what, "chip 0x68 is no ITG-3200");
  bus_->chips.erase(0x53);
  EXPECT_FALSE(chips_->open());
}

TEST(LinuxI2c, says_what_cannot_be_opened) {
  EXPECT_EQ(linux_i2c("/dev/i2c-99")->open().error().message(), "open /dev/i2c-99: No such file or directory");
}

TEST(LinuxI2c, says_which_chip_does_not_answer) {
  const auto bus = linux_i2c("/dev/null");
  ASSERT_TRUE(bus->open());
  std::array<std::uint8_t, 1> byte{};
  const Result<> read = bus->transfer(0x53, byte, byte);
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().what, "chip 0x53 on /dev/null");
}

}  // namespace
}  // namespace regista
