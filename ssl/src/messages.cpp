// SPDX-License-Identifier: Apache-2.0
#include <ssl.pb.h>

#include <cmath>
#include <regista/ssl/referee.hpp>
#include <regista/ssl/tracked.hpp>
#include <regista/ssl/vision.hpp>

namespace regista::ssl {

Point3d position(const CameraCalibration& camera) {
  // Turn -t back by the quaternion's conjugate: v + 2 q × (q × v + w v), with q = -(x, y, z).
  const auto& [x, y, z, w] = camera.rotation;
  const auto cross = [](const Point3d& a, const Point3d& b) {
    return Point3d{.x = a.y * b.z - a.z * b.y, .y = a.z * b.x - a.x * b.z, .z = a.x * b.y - a.y * b.x};
  };
  const Point3d v{.x = -camera.translation.x, .y = -camera.translation.y, .z = -camera.translation.z};
  const Point3d q{.x = -x, .y = -y, .z = -z};
  const Point3d u = cross(q, v);
  const Point3d twice = cross(q, {.x = u.x + w * v.x, .y = u.y + w * v.y, .z = u.z + w * v.z});
  return {.x = v.x + 2 * twice.x, .y = v.y + 2 * twice.y, .z = v.z + 2 * twice.z};
}

namespace {

constexpr double mm = 0.001;
/// No field is larger: what is further away is a broken float. [m]
constexpr double farthest_m = 100;

Error bad(const char* what) { return {std::errc::bad_message, what}; }

template <typename Message>
bool parse(Message& message, std::span<const std::byte> bytes) {
  return message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

template <typename Message>
std::vector<std::byte> serialise(const Message& message) {
  std::vector<std::byte> bytes(message.ByteSizeLong());
  (void)message.SerializeToArray(bytes.data(), static_cast<int>(bytes.size()));
  return bytes;
}

double share(float value) { return value >= 0 && value <= 1 ? value : 0; }

double finite(float value) { return std::isfinite(value) ? value : 0; }

bool is_on_earth(double x_m, double y_m) { return std::abs(x_m) < farthest_m && std::abs(y_m) < farthest_m; }

template <typename Robots>
void take_robots(const Robots& robots, Team team, Detection& out) {
  for (const proto::DetectedRobot& robot : robots) {
    const double x = robot.x_mm() * mm;
    const double y = robot.y_mm() * mm;
    const bool has_heading = robot.has_heading_rad() && std::abs(robot.heading_rad()) < 1e3F;
    if (!robot.has_id() || robot.id() >= robots_per_team || !robot.has_x_mm() || !robot.has_y_mm() ||
        !is_on_earth(x, y)) {
      ++out.unusable;
      continue;
    }
    out.robots.push_back({.id = {team, static_cast<std::uint8_t>(robot.id())},
                          .x_m = x,
                          .y_m = y,
                          .heading_rad = has_heading ? std::optional{wrap_angle(robot.heading_rad())} : std::nullopt,
                          .confidence = share(robot.confidence()),
                          .pixel_x = finite(robot.pixel_x()),
                          .pixel_y = finite(robot.pixel_y()),
                          .height_m = finite(robot.height_mm()) * mm});
  }
}

bool take_detection(const proto::DetectionFrame& frame, Detection& out) {
  out.camera = frame.camera();
  out.frame_number = frame.frame_number();
  out.t_capture_s = frame.t_capture_s();
  out.t_sent_s = frame.has_t_sent_s() ? frame.t_sent_s() : frame.t_capture_s();
  out.robots.clear();
  out.balls.clear();
  out.unusable = 0;
  constexpr double latest_s = 1e12;  // in 30 000 years: what is beyond is a broken double
  if (!frame.has_t_capture_s() || !(std::abs(out.t_capture_s) < latest_s) || !(std::abs(out.t_sent_s) < latest_s))
    return false;
  take_robots(frame.yellow(), Team::yellow, out);
  take_robots(frame.blue(), Team::blue, out);
  for (const proto::DetectedBall& ball : frame.balls()) {
    const double x = ball.x_mm() * mm;
    const double y = ball.y_mm() * mm;
    const double z = ball.z_mm() * mm;
    if (!ball.has_x_mm() || !ball.has_y_mm() || !is_on_earth(x, y) || !is_on_earth(z, 0)) {
      ++out.unusable;
    } else {
      out.balls.push_back({.x_m = x,
                           .y_m = y,
                           .z_m = z,
                           .confidence = share(ball.confidence()),
                           .pixel_x = finite(ball.pixel_x()),
                           .pixel_y = finite(ball.pixel_y()),
                           .area_px = ball.area_px()});
    }
  }
  return true;
}

/// Both layouts parse as either. In that of 2010 the first number is the width of a line, in that of today the length
/// of the field.
bool take_field(const std::string& bytes, Geometry& out) {
  constexpr std::int32_t shortest_field_mm = 1000;
  const auto plausible = [](std::int32_t length_mm) { return length_mm >= shortest_field_mm && length_mm < 100'000; };
  if (proto::FieldSize field;
      field.ParseFromString(bytes) && plausible(field.length_mm()) && plausible(field.width_mm())) {
    out.length_m = field.length_mm() * mm;
    out.width_m = field.width_mm() * mm;
    out.boundary_m = field.boundary_mm() * mm;
    out.goal_width_m = field.goal_width_mm() * mm;
    out.goal_depth_m = field.goal_depth_mm() * mm;
    out.defence_depth_m = field.penalty_area_depth_mm() * mm;
    out.defence_width_m = field.penalty_area_width_mm() * mm;
    out.circle_radius_m = field.centre_circle_radius_mm() * mm;
    out.is_2010 = false;
    return true;
  }
  proto::FieldSize2010 old;
  if (!old.ParseFromString(bytes) || !plausible(old.length_mm()) || !plausible(old.width_mm())) return false;
  out.length_m = old.length_mm() * mm;
  out.width_m = old.width_mm() * mm;
  out.boundary_m = old.boundary_mm() * mm;
  out.goal_width_m = old.goal_width_mm() * mm;
  out.goal_depth_m = old.goal_depth_mm() * mm;
  out.defence_depth_m = out.defence_width_m = out.circle_radius_m = 0;
  out.is_2010 = true;
  return true;
}

CameraCalibration to_calibration(const proto::CameraCalibration& in) {
  return {.camera = in.camera(),
          .focal_px = finite(in.focal_length_px()),
          .principal_x_px = finite(in.principal_x_px()),
          .principal_y_px = finite(in.principal_y_px()),
          .distortion = finite(in.distortion()),
          .rotation = {finite(in.q0()), finite(in.q1()), finite(in.q2()), finite(in.q3())},
          .translation = {.x = finite(in.tx_mm()) * mm, .y = finite(in.ty_mm()) * mm, .z = finite(in.tz_mm()) * mm},
          .width_px = in.image_width_px(),
          .height_px = in.image_height_px()};
}

void put(const CameraCalibration& camera, proto::CameraCalibration& out) {
  const auto& [x, y, z, w] = camera.rotation;
  const Point3d& t = camera.translation;
  out.set_camera(camera.camera);
  out.set_focal_length_px(static_cast<float>(camera.focal_px));
  out.set_principal_x_px(static_cast<float>(camera.principal_x_px));
  out.set_principal_y_px(static_cast<float>(camera.principal_y_px));
  out.set_distortion(static_cast<float>(camera.distortion));
  out.set_q0(static_cast<float>(x));
  out.set_q1(static_cast<float>(y));
  out.set_q2(static_cast<float>(z));
  out.set_q3(static_cast<float>(w));
  out.set_tx_mm(static_cast<float>(t.x / mm));
  out.set_ty_mm(static_cast<float>(t.y / mm));
  out.set_tz_mm(static_cast<float>(t.z / mm));
  const Point3d place = position(camera);
  out.set_world_x_mm(static_cast<float>(place.x / mm));
  out.set_world_y_mm(static_cast<float>(place.y / mm));
  out.set_world_z_mm(static_cast<float>(place.z / mm));
  out.set_image_width_px(camera.width_px);
  out.set_image_height_px(camera.height_px);
}

bool take_geometry(const proto::GeometryData& data, Geometry& out) {
  if (!take_field(data.field(), out)) return false;
  out.cameras.clear();
  for (const proto::CameraCalibration& camera : data.cameras()) out.cameras.push_back(to_calibration(camera));
  out.rolling_mps2.reset();
  const proto::RollingModel& model = data.models().straight();
  // The league writes it as an acceleration, hence below 0.
  if (model.has_roll_mps2() && std::abs(model.roll_mps2()) < 10) out.rolling_mps2 = std::abs(model.roll_mps2());
  return true;
}

void put(const Pose2d& pose, proto::TrackedRobot& out) {
  out.mutable_position()->set_x(static_cast<float>(pose.x));
  out.mutable_position()->set_y(static_cast<float>(pose.y));
  out.set_heading_rad(static_cast<float>(pose.heading));
}

}  // namespace

struct VisionDecoder::Impl {
  proto::VisionPacket message;
  VisionPacket packet;
  // Kept while a packet lacks them, so that their memory is.
  Detection detection;
  Geometry geometry;
};

VisionDecoder::VisionDecoder() : impl_{std::make_unique<Impl>()} {}
VisionDecoder::~VisionDecoder() = default;

Result<const VisionPacket*> VisionDecoder::decode(std::span<const std::byte> datagram) {
  auto& [message, packet, detection, geometry] = *impl_;
  if (!parse(message, datagram)) return bad("not an SSL-Vision packet");
  if (packet.detection) detection = *std::exchange(packet.detection, std::nullopt);
  if (packet.geometry) geometry = *std::exchange(packet.geometry, std::nullopt);
  if (message.has_detection()) {
    if (!take_detection(message.detection(), detection)) return bad("an SSL-Vision frame without time");
    packet.detection = std::move(detection);
  }
  if (message.has_geometry() && take_geometry(message.geometry(), geometry)) packet.geometry = std::move(geometry);
  if (!message.has_detection() && !message.has_geometry()) return bad("neither detection nor geometry");
  return &packet;
}

std::vector<std::byte> encode(const VisionPacket& packet) {
  proto::VisionPacket message;
  if (packet.detection) {
    proto::DetectionFrame& frame = *message.mutable_detection();
    frame.set_frame_number(packet.detection->frame_number);
    frame.set_t_capture_s(packet.detection->t_capture_s);
    frame.set_t_sent_s(packet.detection->t_sent_s);
    frame.set_camera(packet.detection->camera);
    for (const DetectedBall& ball : packet.detection->balls) {
      proto::DetectedBall& out = *frame.add_balls();
      out.set_confidence(static_cast<float>(ball.confidence));
      out.set_x_mm(static_cast<float>(ball.x_m / mm));
      out.set_y_mm(static_cast<float>(ball.y_m / mm));
      if (ball.z_m != 0) out.set_z_mm(static_cast<float>(ball.z_m / mm));
      out.set_pixel_x(static_cast<float>(ball.pixel_x));
      out.set_pixel_y(static_cast<float>(ball.pixel_y));
      if (ball.area_px != 0) out.set_area_px(ball.area_px);
    }
    for (const DetectedRobot& robot : packet.detection->robots) {
      proto::DetectedRobot& out = robot.id.team == Team::yellow ? *frame.add_yellow() : *frame.add_blue();
      out.set_confidence(static_cast<float>(robot.confidence));
      out.set_id(robot.id.number);
      out.set_x_mm(static_cast<float>(robot.x_m / mm));
      out.set_y_mm(static_cast<float>(robot.y_m / mm));
      if (robot.heading_rad) out.set_heading_rad(static_cast<float>(*robot.heading_rad));
      out.set_pixel_x(static_cast<float>(robot.pixel_x));
      out.set_pixel_y(static_cast<float>(robot.pixel_y));
      if (robot.height_m != 0) out.set_height_mm(static_cast<float>(robot.height_m / mm));
    }
  }
  if (packet.geometry) {
    const auto to_mm = [](double metres) { return static_cast<std::int32_t>(std::lround(metres / mm)); };
    proto::FieldSize field;
    field.set_length_mm(to_mm(packet.geometry->length_m));
    field.set_width_mm(to_mm(packet.geometry->width_m));
    field.set_goal_width_mm(to_mm(packet.geometry->goal_width_m));
    field.set_goal_depth_mm(to_mm(packet.geometry->goal_depth_m));
    field.set_boundary_mm(to_mm(packet.geometry->boundary_m));
    if (packet.geometry->defence_depth_m > 0) field.set_penalty_area_depth_mm(to_mm(packet.geometry->defence_depth_m));
    if (packet.geometry->defence_width_m > 0) field.set_penalty_area_width_mm(to_mm(packet.geometry->defence_width_m));
    if (packet.geometry->circle_radius_m > 0)
      field.set_centre_circle_radius_mm(to_mm(packet.geometry->circle_radius_m));
    message.mutable_geometry()->set_field(field.SerializeAsString());
    for (const CameraCalibration& camera : packet.geometry->cameras)
      put(camera, *message.mutable_geometry()->add_cameras());
    if (packet.geometry->rolling_mps2)
      message.mutable_geometry()->mutable_models()->mutable_straight()->set_roll_mps2(-*packet.geometry->rolling_mps2);
  }
  return serialise(message);
}

Result<TrackedFrame> decode_tracked(std::span<const std::byte> datagram) {
  proto::TrackerPacket message;
  if (!parse(message, datagram) || !message.has_uuid()) return bad("not a tracked-vision packet");
  TrackedFrame frame{.uuid = message.uuid(),
                     .source_name = message.source_name(),
                     .frame_number = message.frame().frame_number(),
                     .timestamp_s = message.frame().timestamp_s(),
                     .robots = {},
                     .balls = {}};
  if (!std::isfinite(frame.timestamp_s)) return bad("a tracked-vision packet without time");
  for (const proto::TrackedRobot& robot : message.frame().robots()) {
    const Pose2d pose{.x = robot.position().x(), .y = robot.position().y(), .heading = robot.heading_rad()};
    if (robot.id().number() >= robots_per_team || robot.id().team() < 1 || robot.id().team() > 2 ||
        !robot.has_position() || !robot.has_heading_rad() || !is_on_earth(pose.x, pose.y) ||
        !(std::abs(pose.heading) < 1e3))
      continue;
    TrackedRobot& out = frame.robots.emplace_back();
    out.id = {robot.id().team() == 1 ? Team::yellow : Team::blue, static_cast<std::uint8_t>(robot.id().number())};
    out.pose = {.x = pose.x, .y = pose.y, .heading = wrap_angle(pose.heading)};
    const FieldVelocity velocity{.x = robot.velocity().x(), .y = robot.velocity().y(), .w = robot.turn_rate_radps()};
    if (robot.has_velocity() && is_on_earth(velocity.x, velocity.y) && std::isfinite(velocity.w))
      out.velocity = velocity;
    if (robot.has_visibility()) out.visibility = share(robot.visibility());
  }
  for (const proto::TrackedBall& ball : message.frame().balls()) {
    const proto::Vector3& p = ball.position();
    if (!is_on_earth(p.x(), p.y()) || !is_on_earth(p.z(), 0)) continue;
    TrackedBall& out = frame.balls.emplace_back();
    out.position = {.x = p.x(), .y = p.y(), .z = p.z()};
    const proto::Vector3& v = ball.velocity();
    if (ball.has_velocity() && is_on_earth(v.x(), v.y()) && is_on_earth(v.z(), 0))
      out.velocity = Point3d{.x = v.x(), .y = v.y(), .z = v.z()};
    if (ball.has_visibility()) out.visibility = share(ball.visibility());
  }
  return frame;
}

std::vector<std::byte> encode(const TrackedFrame& frame) {
  proto::TrackerPacket message;
  message.set_uuid(frame.uuid);
  message.set_source_name(frame.source_name);
  proto::TrackedFrame& out = *message.mutable_frame();
  out.set_frame_number(frame.frame_number);
  out.set_timestamp_s(frame.timestamp_s);
  for (const TrackedBall& ball : frame.balls) {
    const auto put_point = [](const Point3d& point, proto::Vector3& vector) {
      vector.set_x(static_cast<float>(point.x));
      vector.set_y(static_cast<float>(point.y));
      vector.set_z(static_cast<float>(point.z));
    };
    proto::TrackedBall& to = *out.add_balls();
    put_point(ball.position, *to.mutable_position());
    if (ball.velocity) put_point(*ball.velocity, *to.mutable_velocity());
    to.set_visibility(static_cast<float>(ball.visibility));
  }
  for (const TrackedRobot& robot : frame.robots) {
    proto::TrackedRobot& to = *out.add_robots();
    to.mutable_id()->set_number(robot.id.number);
    to.mutable_id()->set_team(robot.id.team == Team::yellow ? 1 : 2);
    put(robot.pose, to);
    if (robot.velocity) {
      to.mutable_velocity()->set_x(static_cast<float>(robot.velocity->x));
      to.mutable_velocity()->set_y(static_cast<float>(robot.velocity->y));
      to.set_turn_rate_radps(static_cast<float>(robot.velocity->w));
    }
    to.set_visibility(static_cast<float>(robot.visibility));
  }
  return serialise(message);
}

Result<Referee> decode_referee(std::span<const std::byte> datagram) {
  proto::RefereePacket message;
  // The command is required by the league; an empty datagram would else be a HALT.
  if (!parse(message, datagram) || !message.has_command() || message.command() > 255 || !message.has_command_counter())
    return bad("not a referee packet");
  return Referee{.command = static_cast<Command>(message.command()), .command_counter = message.command_counter()};
}

std::vector<std::byte> encode(const Referee& referee) {
  proto::RefereePacket message;
  message.set_packet_timestamp_us(0);
  message.set_stage(0);
  message.set_command(static_cast<std::uint32_t>(referee.command));
  message.set_command_counter(referee.command_counter);
  message.set_command_timestamp_us(0);
  return serialise(message);
}

}  // namespace regista::ssl
