// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <regista/ssl/log_file.hpp>
#include <regista/ssl/referee.hpp>
#include <regista/ssl/tracked.hpp>
#include <regista/ssl/vision.hpp>

namespace regista::ssl {
namespace {

std::vector<std::byte> bytes(std::initializer_list<int> values) {
  std::vector<std::byte> result;
  for (const int value : values) result.push_back(static_cast<std::byte>(value));
  return result;
}

// Written by hand from the league's field numbers and the encoding of protocol buffers: tag = number << 3 | type, where
// 0 is a varint, 1 eight bytes, 2 counted bytes, 5 four bytes; little-endian.
const auto detection_by_hand = bytes({
    0x0A, 0x4C,                                               // 1: detection, 76 bytes
    0x08, 0xB1, 0x38,                                         // 1: frame_number 7217
    0x11, 0,    0,    0,    0,    0,    0,    0x24, 0x40,     // 2: t_capture 10.0
    0x19, 0,    0,    0,    0,    0,    0x80, 0x24, 0x40,     // 3: t_sent 10.25
    0x20, 0x03,                                               // 4: camera_id 3
    0x2A, 0x0F,                                               // 5: ball, 15 bytes
    0x0D, 0,    0,    0x80, 0x3F,                             //    1: confidence 1
    0x1D, 0,    0,    0x7A, 0x44,                             //    3: x 1000 mm
    0x25, 0,    0,    0xFA, 0xC3,                             //    4: y -500 mm
    0x32, 0x20,                                               // 6: yellow robot, 32 bytes
    0x0D, 0,    0,    0,    0x3F,                             //    1: confidence 0.5
    0x10, 0x0B,                                               //    2: robot_id 11
    0x1D, 0,    0,    0xFA, 0x44,                             //    3: x 2000 mm
    0x25, 0,    0,    0x7A, 0x44,                             //    4: y 1000 mm
    0x2D, 0,    0,    0xC0, 0x3F,                             //    5: orientation 1.5
    0x35, 0,    0,    0,    0,    0x3D, 0,    0,    0,    0,  //    6, 7: pixels
    0x3A, 0x00,                                               // 7: blue robot of which nothing is known
});

TEST(VisionPacket, is_read_as_the_league_writes_it) {
  VisionDecoder decoder;
  const auto packet = decoder.decode(detection_by_hand);
  ASSERT_TRUE(packet) << packet.error().message();
  ASSERT_TRUE((*packet)->detection);
  const Detection& frame = *(*packet)->detection;
  EXPECT_EQ(frame.frame_number, 7217U);
  EXPECT_EQ(frame.t_capture_s, 10.0);
  EXPECT_EQ(frame.t_sent_s, 10.25);
  EXPECT_EQ(frame.camera, 3U);
  ASSERT_EQ(frame.balls.size(), 1U);
  EXPECT_DOUBLE_EQ(frame.balls[0].x_m, 1.0);
  EXPECT_DOUBLE_EQ(frame.balls[0].y_m, -0.5);
  ASSERT_EQ(frame.robots.size(), 1U);
  EXPECT_EQ(frame.robots[0].id, (RobotId{Team::yellow, 11}));
  EXPECT_DOUBLE_EQ(frame.robots[0].x_m, 2.0);
  EXPECT_DOUBLE_EQ(frame.robots[0].y_m, 1.0);
  EXPECT_EQ(frame.robots[0].heading_rad, 1.5);
  EXPECT_EQ(frame.unusable, 1U);
}

TEST(VisionPacket, carries_how_a_camera_sees_the_field) {
  VisionPacket packet;
  packet.detection =
      Detection{.robots = {{.id = {Team::yellow, 3}, .pixel_x = 100.5, .pixel_y = 20.25, .height_m = 0.15}},
                .balls = {{.x_m = 1, .pixel_x = 3, .pixel_y = 4, .area_px = 27}}};
  // Turned by 90° about z, and then upside down about x: q = (1, 0, 0, 0) (0, 0, ½√2, ½√2).
  const double half = std::sqrt(0.5);
  packet.geometry = Geometry{.length_m = 9,
                             .width_m = 6,
                             .goal_width_m = 1.8,
                             .defence_depth_m = 1,
                             .defence_width_m = 2,
                             .circle_radius_m = 0.5,
                             .cameras = {{.camera = 5,
                                          .focal_px = 560.5,
                                          .principal_x_px = 390,
                                          .principal_y_px = 290,
                                          .distortion = 0.0625,
                                          .rotation = {half, -half, 0, 0},
                                          .translation = {.x = 0.5, .y = -0.25, .z = 4},
                                          .width_px = 780,
                                          .height_px = 580}}};
  VisionDecoder decoder;
  const auto again = decoder.decode(encode(packet));
  ASSERT_TRUE(again);
  const Detection& frame = *(*again)->detection;
  EXPECT_EQ(frame.robots[0].pixel_x, 100.5);
  EXPECT_EQ(frame.robots[0].pixel_y, 20.25);
  EXPECT_NEAR(frame.robots[0].height_m, 0.15, 1e-9);
  EXPECT_EQ(frame.balls[0].pixel_x, 3);
  EXPECT_EQ(frame.balls[0].area_px, 27U);
  const Geometry& geometry = *(*again)->geometry;
  EXPECT_EQ(geometry.goal_width_m, 1.8);
  EXPECT_EQ(geometry.defence_width_m, 2);
  EXPECT_EQ(geometry.circle_radius_m, 0.5);
  ASSERT_EQ(geometry.cameras.size(), 1U);
  const CameraCalibration& camera = geometry.cameras[0];
  EXPECT_EQ(camera.camera, 5U);
  EXPECT_EQ(camera.focal_px, 560.5);
  EXPECT_EQ(camera.distortion, 0.0625);
  EXPECT_NEAR(camera.rotation[1], -half, 1e-7);
  EXPECT_EQ(camera.width_px, 780U);
  EXPECT_EQ(camera.height_px, 580U);
  // The camera's x is the field's -y, its y the field's -x, its z looks down: so (0.5, -0.25, 4) seen from it is this.
  const Point3d place = position(camera);
  EXPECT_NEAR(place.x, -0.25, 1e-6);
  EXPECT_NEAR(place.y, 0.5, 1e-6);
  EXPECT_NEAR(place.z, 4, 1e-6);
}

TEST(VisionPacket, survives_encoding) {
  VisionPacket packet;
  packet.detection = Detection{.camera = 2,
                               .frame_number = 9,
                               .t_capture_s = 1.5,
                               .t_sent_s = 1.75,
                               .robots = {{.id = {Team::blue, 15}, .x_m = -1.25, .y_m = 0.5, .heading_rad = -3}},
                               .balls = {{.x_m = 0.25, .y_m = 4, .z_m = 0.125}}};
  packet.geometry = Geometry{.length_m = 12, .width_m = 9, .boundary_m = 0.3, .cameras = {}, .rolling_mps2 = 0.25};
  VisionDecoder decoder;
  const auto again = decoder.decode(encode(packet));
  ASSERT_TRUE(again);
  const Detection& frame = *(*again)->detection;
  EXPECT_EQ(frame.camera, 2U);
  EXPECT_EQ(frame.robots[0].id, (RobotId{Team::blue, 15}));
  EXPECT_EQ(frame.robots[0].x_m, -1.25);
  EXPECT_EQ(frame.robots[0].heading_rad, -3);
  EXPECT_EQ(frame.balls[0].z_m, 0.125);
  EXPECT_EQ((*again)->geometry->length_m, 12);
  EXPECT_EQ((*again)->geometry->rolling_mps2, 0.25);
  EXPECT_FALSE((*again)->geometry->is_2010);
}

TEST(VisionPacket, of_2010_tells_the_field_in_another_layout) {
  // 2: geometry { 1: field { 1: line_width 10, 2: field_length 6050, 3: field_width 4050, 4: boundary_width 250,
  // 5: referee_width 425, 6: goal_width 700, 7: goal_depth 180 } }: today's layout takes it for a field of 10 mm.
  VisionDecoder decoder;
  const auto packet = decoder.decode(bytes({0x12, 0x16, 0x0A, 0x14, 0x08, 0x0A, 0x10, 0xA2, 0x2F, 0x18, 0xD2, 0x1F,
                                            0x20, 0xFA, 0x01, 0x28, 0xA9, 0x03, 0x30, 0xBC, 0x05, 0x38, 0xB4, 0x01}));
  ASSERT_TRUE(packet) << packet.error().message();
  ASSERT_TRUE((*packet)->geometry);
  EXPECT_TRUE((*packet)->geometry->is_2010);
  EXPECT_DOUBLE_EQ((*packet)->geometry->length_m, 6.05);
  EXPECT_DOUBLE_EQ((*packet)->geometry->width_m, 4.05);
  EXPECT_DOUBLE_EQ((*packet)->geometry->boundary_m, 0.25);
}

TEST(VisionPacket, that_is_cut_anywhere_is_refused_or_read_but_never_a_crash) {
  VisionDecoder decoder;
  for (std::size_t size = 0; size < detection_by_hand.size(); ++size)
    EXPECT_FALSE(decoder.decode(std::span{detection_by_hand}.first(size))) << size;
}

TEST(VisionPacket, of_not_finite_numbers_shows_no_robot) {
  auto datagram = detection_by_hand;
  const auto nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(datagram.data() + 2 + 3 + 9 + 9 + 2 + 17 + 2 + 5 + 2 + 1, &nan, sizeof nan);  // the yellow robot's x
  VisionDecoder decoder;
  const auto packet = decoder.decode(datagram);
  ASSERT_TRUE(packet);
  EXPECT_TRUE((*packet)->detection->robots.empty());
  EXPECT_EQ((*packet)->detection->unusable, 2U);
}

TEST(Referee, is_read_as_the_league_writes_it) {
  // 1: packet_timestamp 1, 2: stage 0, 4: command HALT, 5: command_counter 7, 6: command_timestamp 1, 7: a team's name
  const auto halt = bytes({0x08, 1, 0x10, 0, 0x20, 0, 0x28, 7, 0x30, 1, 0x3A, 3, 0x0A, 1, 0x41});
  const auto referee = decode_referee(halt);
  ASSERT_TRUE(referee) << referee.error().message();
  EXPECT_EQ(referee->command, Command::halt);
  EXPECT_EQ(referee->command_counter, 7U);
  EXPECT_FALSE(decode_referee({})) << "an empty datagram is no HALT";
  EXPECT_FALSE(decode_referee(detection_by_hand));
  EXPECT_EQ(decode_referee(encode(Referee{Command::force_start, 8}))->command, Command::force_start);
}

TEST(TrackedFrame, is_read_as_the_league_writes_it) {
  // 1: uuid "u", 2: source_name "s", 3: frame { 1: 5, 2: 10.0, 4: robot { 1: { 1: 3, 2: 2 (blue) }, 2: { 1: 1.5, 2: -2
  // }, 3: 0.5, 4: { 1: 1, 2: 0 } } }
  const auto packet = bytes({0x0A, 1,    'u',  0x12, 1,    's',  0x1A, 0x30, 0x08, 5,    0x11, 0,    0, 0,
                             0,    0,    0,    0x24, 0x40, 0x22, 0x23, 0x0A, 4,    0x08, 3,    0x10, 2, 0x12,
                             10,   0x0D, 0,    0,    0xC0, 0x3F, 0x15, 0,    0,    0,    0xC0, 0x1D, 0, 0,
                             0,    0x3F, 0x22, 10,   0x0D, 0,    0,    0x80, 0x3F, 0x15, 0,    0,    0, 0});
  const auto frame = decode_tracked(packet);
  ASSERT_TRUE(frame) << frame.error().message();
  EXPECT_EQ(frame->uuid, "u");
  EXPECT_EQ(frame->timestamp_s, 10.0);
  ASSERT_EQ(frame->robots.size(), 1U);
  EXPECT_EQ(frame->robots[0].id, (RobotId{Team::blue, 3}));
  EXPECT_EQ(frame->robots[0].pose, (Pose2d{1.5, -2, 0.5}));
  EXPECT_EQ(frame->robots[0].velocity, (FieldVelocity{1, 0, 0}));

  const auto again = decode_tracked(encode(*frame));
  ASSERT_TRUE(again);
  EXPECT_EQ(again->robots[0].pose, frame->robots[0].pose);
  EXPECT_EQ(again->robots[0].id, frame->robots[0].id);
}

TEST(LogFile, is_written_as_the_league_reads_it) {
  const std::string name = testing::TempDir() + "regista_ssl_log";
  const auto datagram = bytes({1, 2, 3});
  {
    LogWriter log{name};
    ASSERT_TRUE(log.write(0x0102030405060708, LogType::referee, datagram));
  }
  std::ifstream file{name, std::ios::binary};
  const std::string written{std::istreambuf_iterator<char>{file}, {}};
  constexpr char expected[] = "SSL_LOG_FILE\0\0\0\1\1\2\3\4\5\6\7\10\0\0\0\3\0\0\0\3\1\2\3";
  EXPECT_EQ(written, (std::string{expected, sizeof expected - 1}));

  LogReader log{name};
  const auto record = log.next();
  ASSERT_TRUE(record && *record);
  EXPECT_EQ((*record)->received_ns, 0x0102030405060708);
  EXPECT_EQ((*record)->type, LogType::referee);
  EXPECT_EQ((*record)->datagram, datagram);
  const auto end = log.next();
  ASSERT_TRUE(end);
  EXPECT_FALSE(*end);
}

TEST(LogFile, that_was_cut_short_says_so) {
  const std::string name = testing::TempDir() + "regista_ssl_cut_log";
  std::ofstream{name, std::ios::binary}.write("SSL_LOG_FILE\0\0\0\1\0\0\0\0\0\0\0\0\0\0\0\4\0\0\0\5ab", 34);
  LogReader log{name};
  EXPECT_FALSE(log.next());
  std::ofstream{name} << "something else";
  EXPECT_THROW(LogReader{name}, std::runtime_error);
}

}  // namespace
}  // namespace regista::ssl
