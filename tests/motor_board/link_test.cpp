// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <regista/motor_board/board.h>
#include <stdlib.h>  // NOLINT: POSIX' pseudo-terminals
#include <unistd.h>
#include <regista/motor_board/client.hpp>

#include <array>
#include <chrono>
#include <cmath>
#include <deque>

namespace regista::motor_board {
namespace {

using namespace std::chrono_literals;

/// A pseudo-terminal: the far end of a serial cable.
class Cable : public testing::Test {
 protected:
  Cable() : far_{::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)} {
    if (::grantpt(far_) != 0 || ::unlockpt(far_) != 0) ADD_FAILURE() << "no pseudo-terminal";
    std::array<char, 64> name{};
    EXPECT_EQ(::ptsname_r(far_, name.data(), name.size()), 0);
    name_ = name.data();
  }
  ~Cable() override { unplug(); }
  void unplug() {
    if (far_ >= 0) ::close(std::exchange(far_, -1));
  }
  [[nodiscard]] std::string at_far_end(std::size_t size) const {
    std::string bytes(size, '\0');
    pollfd ready{.fd = far_, .events = POLLIN, .revents = 0};
    EXPECT_EQ(::poll(&ready, 1, 1000), 1);
    EXPECT_EQ(::read(far_, bytes.data(), size), static_cast<ssize_t>(size));
    return bytes;
  }
  static Result<std::size_t> receive(BoardLink& link, std::span<std::uint8_t> bytes) { return link.receive({}, bytes); }

  int far_;
  std::string name_;
};

TEST_F(Cable, carries_every_byte_both_ways_unchanged) {
  const auto link = serial_link(name_, 1'000'000);
  ASSERT_TRUE(link->open());
  std::array<std::uint8_t, 256> all{};
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<std::uint8_t>(i);  // XON, CR, ^C, 255 among them
  ASSERT_TRUE(link->send(all));
  EXPECT_EQ(at_far_end(256), (std::string{all.begin(), all.end()}));
  ASSERT_EQ(::write(far_, all.data(), all.size()), 256);
  std::array<std::uint8_t, 512> back{};
  const auto count = receive(*link, back);
  ASSERT_TRUE(count);
  ASSERT_EQ(*count, 256U);
  EXPECT_TRUE(std::equal(all.begin(), all.end(), back.begin()));
  EXPECT_EQ(*receive(*link, back), 0U) << "does not wait";
}

TEST_F(Cable, is_ours_alone_until_it_is_closed) {
  const auto first = serial_link(name_, 1'000'000);
  const auto second = serial_link(name_, 1'000'000);
  ASSERT_TRUE(first->open());
  const Result<> refused = second->open();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "open " + name_ + " (another program has it)");
  first->close();
  EXPECT_TRUE(second->open());
}

TEST_F(Cable, unplugged_is_an_error_that_names_it) {
  const auto link = serial_link(name_, 1'000'000);
  ASSERT_TRUE(link->open());
  unplug();
  std::array<std::uint8_t, 16> bytes{};
  const auto received = receive(*link, bytes);
  ASSERT_FALSE(received);
  EXPECT_NE(received.error().message().find("read from " + name_), std::string::npos) << received.error().message();
  EXPECT_FALSE(link->send(bytes));
}

TEST(SerialLink, says_what_cannot_be_opened) {
  EXPECT_EQ(serial_link("/dev/no-such-board", 1'000'000)->open().error().message(),
            "open /dev/no-such-board: No such file or directory");
  EXPECT_FALSE(serial_link("/dev/null", 1'000'000)->open()) << "no serial line";
  EXPECT_THROW((void)serial_link("/dev/ttyACM0", 1'234'567), std::invalid_argument);
}

TEST(SpiLink, says_what_cannot_be_opened) {
  EXPECT_EQ(make_link("/dev/spidev9.9", 1'000'000)->open().error().message(),
            "open /dev/spidev9.9: No such file or directory");
  EXPECT_EQ(spi_link("/dev/null", 1'000'000)->open().error().what, "set up /dev/null");
}

MotorBoardTelemetry telemetry(int status, std::uint8_t kick_id = 0) {
  MotorBoardTelemetry telemetry{};
  telemetry.status = static_cast<std::uint8_t>(status);
  telemetry.kick_id = kick_id;
  return telemetry;
}

MotorBoardTelemetry at(std::uint32_t time_us) {
  MotorBoardTelemetry telemetry{};
  telemetry.time_us = time_us;
  return telemetry;
}

/// A cable whose far end is the test.
class FakeLink final : public BoardLink {
 public:
  Result<> open() override { return {}; }
  void close() noexcept override {}
  Result<> send(std::span<const std::uint8_t> bytes) override {
    EXPECT_TRUE(motor_board_unpack_command(bytes.data(), &sent));
    ++frames;
    return {};
  }
  Result<std::size_t> receive(const Tick&, std::span<std::uint8_t> bytes) override {
    const std::size_t count = std::min(bytes.size(), coming.size());
    std::copy_n(coming.begin(), count, bytes.begin());
    coming.erase(coming.begin(), coming.begin() + static_cast<std::ptrdiff_t>(count));
    return count;
  }
  [[nodiscard]] const std::string& name() const override { return name_; }
  void answer(const MotorBoardTelemetry& telemetry) {
    std::array<std::uint8_t, motor_board_telemetry_size> frame{};
    motor_board_pack_telemetry(&telemetry, frame.data());
    coming.insert(coming.end(), frame.begin(), frame.end());
  }

  MotorBoardCommand sent{};
  int frames = 0;
  std::deque<std::uint8_t> coming;

 private:
  std::string name_ = "fake";
};

class Client : public testing::Test {
 protected:
  Client() {
    auto link = std::make_unique<FakeLink>();
    link_ = link.get();
    client_.emplace(std::move(link));
    EXPECT_TRUE(client_->open());
  }
  Result<> beat(Duration dt = 2ms) {
    const Result<> received = client_->receive({.now = {}, .dt = dt});
    EXPECT_TRUE(client_->send({}));
    return received;
  }

  FakeLink* link_;
  std::optional<BoardClient> client_;
};

TEST_F(Client, gives_every_command_another_sequence) {
  for (int i = 0; i < 300; ++i) {
    const std::uint8_t before = link_->sent.sequence;
    (void)beat();
    ASSERT_NE(link_->sent.sequence, before);
  }
}

TEST_F(Client, misses_a_board_that_is_silent_for_100_ms_and_waits_longer_for_its_first_word) {
  EXPECT_TRUE(beat(1s));
  link_->answer(telemetry(0));
  EXPECT_TRUE(beat());
  EXPECT_TRUE(beat(100ms));
  const Result<> silent = beat();
  ASSERT_FALSE(silent);
  EXPECT_EQ(silent.error().what, "the motor board on fake is silent; is it powered, and the cable right?");
  ASSERT_TRUE(client_->open());
  EXPECT_TRUE(beat(1s));
  EXPECT_FALSE(beat());
}

TEST_F(Client, forgives_a_pause_of_its_own) {
  link_->answer(telemetry(0));
  EXPECT_TRUE(beat());
  link_->answer(telemetry(0));
  EXPECT_TRUE(beat(700ms));
}

TEST_F(Client, repeats_a_kick_until_the_board_has_it) {
  EXPECT_FALSE(client_->kick(3, 0)) << "no charge yet";
  link_->answer(telemetry(motor_board_charged, 255));
  ASSERT_TRUE(beat());
  ASSERT_TRUE(client_->kick(3, 0.5));
  EXPECT_FALSE(client_->kick(3, 0)) << "one at a time";
  for (int i = 0; i < 3; ++i) {
    (void)beat();
    EXPECT_EQ(link_->sent.kick_id, 1) << "0 is none";
    EXPECT_EQ(link_->sent.kick_speed_mmps, 3000);
    EXPECT_EQ(link_->sent.kick_angle_mrad, 500);
  }
  link_->answer(telemetry(0, 1));
  (void)beat();
  EXPECT_EQ(link_->sent.kick_id, 0);
}

TEST_F(Client, gives_a_kick_up_that_the_board_does_not_take) {
  link_->answer(telemetry(motor_board_charged));
  ASSERT_TRUE(beat());
  ASSERT_TRUE(client_->kick(3, 0));
  for (int i = 0; i < 60; ++i) {
    link_->answer(telemetry(motor_board_charged));
    ASSERT_TRUE(beat());
  }
  EXPECT_EQ(link_->sent.kick_id, 0);
}

TEST(Milli, saturates_and_takes_no_nan) {
  EXPECT_EQ(milli(1.2345), 1235);
  EXPECT_EQ(milli(1e9), 2147483647);
  EXPECT_EQ(milli(-1e9), -2147483647 - 1);
  EXPECT_EQ(milli(std::nan("")), 0);
}

TEST(TurnedEdges, counts_through_the_wrap) {
  EXPECT_EQ(turned_edges(2147483647, -2147483647 - 1), 1);
  EXPECT_EQ(turned_edges(5, 2), -3);
  EXPECT_EQ(elapsed(at(0xFFFFFFFF), at(999)), 1ms);
}

}  // namespace
}  // namespace regista::motor_board
