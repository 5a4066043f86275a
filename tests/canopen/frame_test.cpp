// SPDX-License-Identifier: Apache-2.0
#include "bench.hpp"

namespace regista::canopen {
namespace {

// ISO 11898-1 by way of Tindell's bound: an 8-byte frame takes 111 to 135 bits with an 11-bit id, 131 to 160 with 29.
TEST(CanFrame, takes_the_bits_of_the_standard) {
  EXPECT_EQ(worst_frame_bits(0), 55);
  EXPECT_EQ(worst_frame_bits(8), 135);
  EXPECT_EQ(worst_frame_bits(8, true), 160);
  // Counted by an independent program from the bits of these frames.
  EXPECT_EQ(frame_bits(make_frame(0x605, {1, 0, 0, 0, 0, 0, 0, 0})), 125) << "a segment of zeros";
  EXPECT_EQ(frame_bits(make_frame(0x605, {0x40, 0x41, 0x60, 0, 0, 0, 0, 0})) +
                frame_bits(make_frame(0x585, {0x4B, 0x41, 0x60, 0, 0x37, 0x06, 0, 0})),
            244);
  std::mt19937 random{1};
  double sum = 0;
  for (int i = 0; i < 4000; ++i) {
    CanFrame frame{.id = static_cast<std::uint32_t>(random() & 0x7FFU),
                   .size = static_cast<std::uint8_t>(random() % 9)};
    for (std::uint8_t& byte : frame.data) byte = static_cast<std::uint8_t>(random());
    EXPECT_GE(frame_bits(frame), 47 + 8 * frame.size);
    EXPECT_LE(frame_bits(frame), worst_frame_bits(frame.size));
    frame.size = 8;
    frame.id = 0x605;
    sum += frame_bits(frame);
  }
  EXPECT_NEAR(sum / 4000, 115, 1) << "the mean of random data";
}

TEST(CanFrame, says_what_a_controller_told) {
  EXPECT_EQ(bus_report(error_frame(BusState::off)).state, BusState::off);
  EXPECT_EQ(bus_report(error_frame(BusState::passive)).state, BusState::passive);
  // As cansend writes them: 20000004#0020000000000000 and with counters.
  const CanFrame passive{.id = 0x204, .error = true, .size = 8, .data = {0, 0x20, 0, 0, 0, 0, 136, 7}};
  EXPECT_EQ(bus_report(passive).state, BusState::passive);
  EXPECT_EQ(bus_report(passive).transmit_errors, 136);
  EXPECT_EQ(bus_report(passive).receive_errors, 7);
  EXPECT_TRUE(bus_report({.id = 0x20, .error = true, .size = 8}).no_acknowledge);
  EXPECT_FALSE(bus_report({.id = 0x20, .error = true, .size = 8}).state);
}

/// A bus that is never silent.
struct Endless final : CanBus {
  Result<> send(const CanFrame& /*frame*/) override { return {}; }
  Result<std::optional<ReceivedFrame>> receive() override {
    return std::optional{ReceivedFrame{make_frame(1, {}), {}}};
  }
  [[nodiscard]] int descriptor() const override { return -1; }
};

// A server on a slow machine took a burst of more than its time-out for one moment, and then gave the transfer up.
TEST(Serve, lets_time_pass_on_a_bus_that_is_never_silent) {
  Endless bus;
  Bench bench;
  Listener listener{bench};
  ASSERT_TRUE(serve(bus, listener, bench.now));
  EXPECT_EQ(listener.heard.size(), 16U);
}

TEST(VirtualBus, takes_the_time_of_a_real_one) {
  Bench bench{500'000};
  VirtualBus::Port& port = bench.bus.attach();
  Listener listener{bench};
  const CanFrame frame = make_frame(0x123, {1, 2, 3, 4, 5, 6, 7, 8});
  const Time begin = bench.now;
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(port.send(frame));
  EXPECT_EQ(port.send(frame).error().code, std::errc::no_buffer_space);
  bench.run(100ms);
  ASSERT_EQ(listener.heard.size(), 10U);
  EXPECT_EQ(listener.heard[0].second - begin, bus_time(frame_bits(frame), 500'000));
  EXPECT_EQ(listener.heard[9].second - begin, 10 * bus_time(frame_bits(frame), 500'000));
}

TEST(VirtualBus, lets_the_lowest_id_go_first) {
  Bench bench;
  std::vector<CanFrame> frames{make_frame(0x700, {}), make_frame(0x181, {}), make_frame(0x080, {}),
                               make_frame(0x181, {})};
  frames[3].remote = true;
  frames.push_back({.id = 0x181U << 18, .extended = true});
  for (const CanFrame& frame : frames) ASSERT_TRUE(bench.bus.attach().send(frame));
  Listener listener{bench};
  bench.run(10ms);
  ASSERT_EQ(listener.heard.size(), 5U);
  EXPECT_EQ(listener.heard[0].first, frames[2]);
  EXPECT_EQ(listener.heard[1].first, frames[1]) << "data before remote and before 29 bits";
  EXPECT_EQ(listener.heard[4].first, frames[0]);
}

TEST(VirtualBus, repeats_for_ever_what_nobody_acknowledges) {
  Bench bench;
  VirtualBus::Port& port = bench.bus.attach();
  Listener listener{bench};
  bench.members.front().first->connect(false);
  ASSERT_TRUE(port.send(make_frame(0x100, {})));
  bench.run(1s);
  EXPECT_TRUE(listener.heard.empty());
  bench.members.front().first->connect(true);
  bench.run(1ms);
  EXPECT_EQ(listener.heard.size(), 1U);
}

}  // namespace
}  // namespace regista::canopen
