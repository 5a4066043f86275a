// SPDX-License-Identifier: Apache-2.0
// A recording is fed to the driver `playback` through a pipe, and a client of the server reads it.
#include <gtest/gtest.h>
#include <unistd.h>

#include <regista/client/robot.hpp>
#include <regista/server/playback.hpp>
#include <regista/server/server.hpp>
#include <thread>

namespace regista {
namespace {

using namespace std::chrono_literals;

class Pipe {
 public:
  Pipe() { EXPECT_EQ(::pipe(ends_.data()), 0); }
  ~Pipe() {
    ::close(ends_[0]);
    end();
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;

  [[nodiscard]] std::string path() const { return "/proc/self/fd/" + std::to_string(ends_[0]); }

  void write(std::span<const std::byte> bytes) const {
    ASSERT_EQ(::write(ends_[1], bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  }
  template <typename Body>
  void feed(Kind kind, std::uint16_t interface, std::uint8_t subtype, const Body& body, std::uint16_t index = 0) const {
    const xdr::Header header{.address = {.interface = interface, .index = index}, .kind = kind, .subtype = subtype};
    std::vector<std::byte> bytes(xdr::header_size + xdr::encoded_size(body));
    xdr::encode_message(header, body, bytes);
    write(bytes);
  }
  template <DataType D>
  void feed(const D& data, std::uint16_t index = 0) const {
    feed(Kind::data, D::message.interface, D::message.subtype, data, index);
  }
  void end() {
    if (ends_[1] >= 0) ::close(ends_[1]);
    ends_[1] = -1;
  }

 private:
  std::array<int, 2> ends_{-1, -1};
};

class Replaying {
 public:
  Replaying()
      : server_{parse_config(
                    "driver ( name \"playback\" provides [\"position2d:0\" \"position2d:2\" \"power:0\"] input \"" +
                        pipe.path() + "\" alwayson yes )",
                    "test.cfg"),
                {.port = 0, .plugins = {&playback}}},
        thread_{[this] { server_.run(); }},
        robot{"127.0.0.1", server_.port(), {.timeout = 10s}} {}
  ~Replaying() {
    server_.stop();
    thread_.join();
  }
  Replaying(const Replaying&) = delete;
  Replaying& operator=(const Replaying&) = delete;

  bool reads_until(const std::function<bool()>& seen) {
    for (const Time end = Clock::now() + 20s; Clock::now() < end && !seen();) robot.read(50ms);
    return seen();
  }

  Pipe pipe;

 private:
  Server server_;
  std::thread thread_;

 public:
  client::Robot robot;
};

TEST(Playback, publishes_what_it_is_fed_under_the_recorded_devices) {
  Replaying replay;
  const auto& base = replay.robot.position2d(2);
  const auto& power = replay.robot.power();
  replay.pipe.feed(position2d::State{.pose = {1, 2, 3}, .velocity = {.x = 0.5}}, 2);
  replay.pipe.feed(power::State{.valid = power::volts, .voltage_v = 12.5F});
  EXPECT_TRUE(replay.reads_until([&] { return base.count() == 1 && power.count() == 1; }));
  EXPECT_EQ(base.state().pose, (Pose2d{1, 2, 3}));
  EXPECT_EQ(power.voltage_v(), 12.5);
}

TEST(Playback, takes_frames_in_pieces) {
  Replaying replay;
  const auto& base = replay.robot.position2d();
  const position2d::State state{.pose = {.x = 7}};
  std::vector<std::byte> bytes(xdr::header_size + xdr::encoded_size(state));
  xdr::encode_message(xdr::Header{.address = {.interface = position2d::code}, .kind = Kind::data, .subtype = 1}, state,
                      bytes);
  for (const std::byte& byte : bytes) replay.pipe.write({&byte, 1});
  EXPECT_TRUE(replay.reads_until([&] { return base.state().pose.x == 7; }));
}

TEST(Playback, answers_requests_as_the_recorded_device_did) {
  Replaying replay;
  auto& base = replay.robot.position2d();
  EXPECT_THROW((void)base.geometry(), client::RefusedError);  // nothing recorded
  replay.pipe.feed(Kind::ack, position2d::code, position2d::GetGeometry::message.subtype,
                   position2d::Geometry{.size = {.width = 0.3, .length = 0.4, .height = 0}});
  replay.pipe.feed(position2d::State{});
  EXPECT_TRUE(replay.reads_until([&] { return base.count() == 1; }));
  EXPECT_EQ(base.geometry().size.length, 0.4);
}

TEST(Playback, refuses_commands) {
  Replaying replay;
  replay.robot.position2d().set_velocity({.x = 1});
  std::string told;
  EXPECT_TRUE(replay.reads_until([&] {
    for (const auto& event : replay.robot.events()) told += event.text.view();
    return told.find("does not take this command") != std::string::npos;
  })) << told;
}

TEST(Playback, says_when_the_recording_has_ended) {
  Replaying replay;
  auto& base = replay.robot.position2d();
  replay.pipe.end();
  std::string told;
  EXPECT_TRUE(replay.reads_until([&] {
    for (const auto& event : replay.robot.events()) told += event.text.view();
    return told.find("the recording has ended") != std::string::npos;
  })) << told;
  (void)base;
}

TEST(Playback, names_the_device_that_is_not_offered) {
  Replaying replay;
  (void)replay.robot.position2d();
  replay.pipe.feed(position2d::State{}, 1);
  std::string told;
  EXPECT_TRUE(replay.reads_until([&] {
    for (const auto& event : replay.robot.events()) told += event.text.view();
    return told.find("device 4:1, which `provides` does not name") != std::string::npos;
  })) << told;
}

}  // namespace
}  // namespace regista
