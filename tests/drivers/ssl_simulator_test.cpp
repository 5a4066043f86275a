// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <numbers>
#include <regista/control/odometry.hpp>

#include "bench.hpp"
#include "simulator_link.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;

std::string hex(std::span<const std::uint8_t> bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) {
    constexpr std::string_view digits = "0123456789abcdef";
    text += digits[byte >> 4];
    text += digits[byte & 15];
  }
  return text;
}

// What protoc --encode makes of the same values in the league's and in grSim's schema.
TEST(SimulatorPacket, is_what_protoc_makes_of_it) {
  const SimulatorCommand command{.robot = 3,
                                 .yellow = true,
                                 .velocity = {.x = 1, .y = -0.5, .w = 2},
                                 .kick_mps = 4,
                                 .kick_rad = std::numbers::pi / 4};
  EXPECT_EQ(hex(league_packet(command)),
            "0a2408031211120f0d0000803f15000000bf1d000000401d0000804025000034422d00000000");
  EXPECT_EQ(hex(league_packet(SimulatorCommand{.robot = 11})),
            "0a1a080b1211120f0d0000000015000000001d000000002d00000000");
  SimulatorCommand flat = command;
  flat.kick_rad = 0;
  flat.dribbler_radps = 50;
  EXPECT_EQ(hex(grsim_packet(flat)),
            "0a2c09000000000000000010011a1f080315000080401d00000000250000803f2d000000bf350000004038014000");
}

TEST(SimulatorPacket, that_brakes_sets_all_wheels_to_zero) {
  const SimulatorBrake brake{.robot = 3, .yellow = true};
  EXPECT_EQ(hex(league_packet(brake)), "0a1a080312160a140d0000000015000000001d000000002500000000");
  EXPECT_EQ(hex(grsim_packet(brake)),
            "0a4009000000000000000010011a33080315000000001d0000000025000000002d000000003500000000380040014d000000005500"
            "0000005d"
            "000000006500000000");
}

TEST(SimulatorPacket, of_an_answer_tells_whose_dribbler_has_the_ball) {
  // errors { 1 "x" } feedback { 2: yes } feedback { 3: yes }, by protoc
  const std::vector<std::uint8_t> response{0x0A, 0x05, 0x08, 0x01, 0x12, 0x01, 'x',  0x12, 0x04, 0x08,
                                           0x02, 0x10, 0x01, 0x12, 0x04, 0x08, 0x03, 0x10, 0x01};
  EXPECT_EQ(ball_contact(response, 3), true);
  EXPECT_EQ(ball_contact(response, 4), std::nullopt);
  for (std::size_t size = 0; size < response.size(); ++size) {
    EXPECT_EQ(ball_contact(std::span{response}.first(size), 3), std::nullopt) << size;  // cut anywhere, no crash
  }
  const std::vector<std::uint8_t> nonsense(64, 0xFF);
  EXPECT_EQ(ball_contact(nonsense, 3), std::nullopt);
}

/// A simulator of the league at a port of the loopback: one robot that goes on with what it was told last.
class Simulator {
 public:
  Simulator() : socket_{::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0)} {
    sockaddr_in here{};
    here.sin_family = AF_INET;
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof here;
    EXPECT_EQ(::bind(socket_, reinterpret_cast<sockaddr*>(&here), size), 0);
    EXPECT_EQ(::getsockname(socket_, reinterpret_cast<sockaddr*>(&here), &size), 0);
    port_ = ntohs(here.sin_port);
  }
  ~Simulator() { ::close(socket_); }
  Simulator(const Simulator&) = delete;
  Simulator& operator=(const Simulator&) = delete;

  void step(Duration dt) {
    std::array<std::uint8_t, 256> packet{};
    sockaddr_in from{};
    socklen_t size = sizeof from;
    while (::recvfrom(socket_, packet.data(), packet.size(), 0, reinterpret_cast<sockaddr*>(&from), &size) > 0) {
      const auto real = [&](std::size_t at) {
        std::uint32_t bits = 0;
        for (std::size_t i = 0; i < 4; ++i) bits |= std::uint32_t{packet[at + i]} << 8 * i;
        return static_cast<double>(std::bit_cast<float>(bits));
      };
      robot_ = packet[3];
      if (packet[6] == 0x12) {
        set({.x = real(9), .y = real(14), .w = real(19)});
        if (packet[23] == 0x1D) kicks_.push_back(real(24));
      } else if (packet[6] == 0x0A) {  // of wheels; all that are sent are 0
        velocity_ = {};
      }
      constexpr std::array<std::uint8_t, 6> ball{0x12, 0x04, 0x08, 0x05, 0x10, 0x01};
      (void)::sendto(socket_, ball.data(), ball.size(), 0, reinterpret_cast<sockaddr*>(&from), size);
    }
    pose_ = control::travelled(pose_, velocity_, dt);
  }
  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] const Pose2d& pose() const { return pose_; }
  [[nodiscard]] const BodyVelocity& velocity() const { return velocity_; }
  [[nodiscard]] int robot() const { return robot_; }
  [[nodiscard]] const std::vector<double>& kicks() const { return kicks_; }

 private:
  /// As grSim does: what a command changes at most is one step of 4 m/s² from the velocity that the robot has.
  void set(const BodyVelocity& wanted) {
    const double before = std::hypot(velocity_.x, velocity_.y);
    const double after = std::hypot(wanted.x, wanted.y);
    const double allowed = std::clamp(after, before - 0.13, before + 0.13);
    const double share = after > 0 ? allowed / after : before > 0 ? allowed / before : 0;
    const BodyVelocity& direction = after > 0 ? wanted : velocity_;
    velocity_ = {.x = share * direction.x, .y = share * direction.y, .w = wanted.w};
  }

  int socket_;
  std::uint16_t port_ = 0;
  int robot_ = -1;
  Pose2d pose_{.x = -1, .heading = 0.5};
  BodyVelocity velocity_;
  std::vector<double> kicks_;
};

class SslSimulator : public testing::Test {
 protected:
  SslSimulator()
      : bench_{"provides [\"position2d:0\" \"position2d:1\" \"kicker:0\"]", [this](regista::Setup& setup) {
                 return simulated_robot(setup, {.port = simulator_.port(), .robot = 5});
               }} {}
  void run(Duration duration) {
    for (const Time end = bench_.now() + duration; bench_.now() < end;) {
      simulator_.step(10ms);
      const Pose2d& pose = simulator_.pose();
      bench_.send(position2d::VelocityCommand{.velocity = {.x = pose.x, .y = pose.y, .w = pose.heading}, .age_s = 0.0},
                  1);
      bench_.run(10ms);
    }
  }

  Simulator simulator_;
  Bench bench_;
};

TEST_F(SslSimulator, drives_to_a_pose_in_the_leagues_simulators) {
  run(200ms);
  EXPECT_EQ(simulator_.robot(), 5);
  bench_.send(position2d::PositionCommand{.pose = {.x = 0.5, .y = 0.5}});
  run(5s);
  EXPECT_LT(distance(simulator_.pose(), {.x = 0.5, .y = 0.5}), 0.01);
  EXPECT_NEAR(simulator_.pose().heading, 0, 0.02);
}

TEST_F(SslSimulator, kicks_once_and_sees_the_ball) {
  run(200ms);
  EXPECT_EQ(bench_.latest<kicker::State>().ball_detected, 1);
  bench_.send(kicker::KickCommand{.speed_mps = 3}, 2);
  run(300ms);
  EXPECT_EQ(simulator_.kicks(), std::vector{3.0});
}

TEST_F(SslSimulator, hears_of_a_command_in_the_beat_that_takes_it) {
  run(200ms);
  bench_.send(position2d::VelocityCommand{.velocity = {.x = 0.1}});
  bench_.run(10ms);
  simulator_.step(0ms);
  EXPECT_NEAR(simulator_.velocity().x, 0.1, 1e-3);
}

// grSim does, on a computer that has other things to do. Its robot moves on from where it stood, not from where the
// wheels would be.
TEST_F(SslSimulator, goes_on_to_its_pose_when_the_simulator_has_stalled) {
  run(200ms);
  bench_.send(position2d::PositionCommand{.pose = {.x = 0.5, .y = 0.5}});
  run(1s);
  bench_.run(120ms);
  run(5s);
  EXPECT_LT(distance(simulator_.pose(), {.x = 0.5, .y = 0.5}), 0.01);
  EXPECT_EQ(bench_.events().find("jumped"), std::string::npos);
}

// Nothing in a simulator stops a robot that hears no more.
TEST_F(SslSimulator, stands_when_its_server_has_ended) {
  run(200ms);
  for (int i = 0; i < 10; ++i) {
    bench_.send(position2d::VelocityCommand{.velocity = {.x = 0.8, .y = 0.6, .w = 1}});
    run(50ms);
  }
  EXPECT_NEAR(simulator_.velocity().x, 0.8, 1e-3);
  bench_.host().shut_down(bench_.now());
  simulator_.step(10ms);
  EXPECT_EQ(simulator_.velocity(), BodyVelocity{});
}

TEST_F(SslSimulator, says_that_no_simulator_is_started) {
  const std::uint16_t port = Simulator{}.port();  // and gone
  Bench bench{"provides [\"position2d:0\"]",
              [&](regista::Setup& setup) { return simulated_robot(setup, {.port = port, .robot = 5}); }};
  bench.run(100ms);
  EXPECT_NE(bench.events().find("(is it started?): Connection refused"), std::string::npos);
}

}  // namespace
}  // namespace regista
