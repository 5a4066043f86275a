// SPDX-License-Identifier: Apache-2.0
#include "imu.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace regista {

namespace {

constexpr double gravity_mps2 = 9.80665;  // what both manuals mean by g
constexpr int most_reads = 8;             // in one beat; the rest comes with the next

microstrain::Protocol read_protocol(const Section& config) {
  const std::string protocol = config.text("protocol");
  if (protocol == "single_byte") return microstrain::Protocol::single_byte;
  if (protocol == "mip") return microstrain::Protocol::mip;
  throw config.error("protocol", R"(must be "single_byte" (3DM-GX3-25) or "mip" (3DM-GX3-35, GX4, GX5))");
}

Eigen::Matrix3d read_mount(const Section& config) {
  if (!config.has("mount")) return Eigen::Matrix3d::Identity();
  const auto angles = config.angles("mount");
  if (angles.size() != 3) throw config.error("mount", "must be three angles: [roll pitch yaw]");
  return (Eigen::AngleAxisd{angles[2], Eigen::Vector3d::UnitZ()} *
          Eigen::AngleAxisd{angles[1], Eigen::Vector3d::UnitY()} *
          Eigen::AngleAxisd{angles[0], Eigen::Vector3d::UnitX()})
      .toRotationMatrix();
}

std::unique_ptr<motor_board::BoardLink> link_to_imu(const Section& config) {
  const auto baud = static_cast<int>(config.integer("baud", 115'200, {.min = 1, .max = 100'000'000}));
  try {
    return motor_board::serial_link(config.text("port"), baud);
  } catch (const std::invalid_argument& wrong) {
    throw config.error("baud", wrong.what());
  }
}

Eigen::Vector3d vector(const std::array<float, 3>& v) { return Eigen::Vector3f{v[0], v[1], v[2]}.cast<double>(); }

std::string text(double value) {
  char line[32];
  (void)std::snprintf(line, sizeof line, "%.3g", value);
  return line;
}

}  // namespace

InertialSample to_house(const microstrain::Sample& sample, const Eigen::Matrix3d& body_from_chip,
                        double declination_rad) {
  // The sensor's x ahead, y right, z down to x ahead, y left, z up, and back.
  const Eigen::Matrix3d chip_from_sensor = Eigen::Vector3d{1, -1, -1}.asDiagonal();
  const Eigen::Matrix3d body_from_sensor = body_from_chip * chip_from_sensor;
  // Magnetic north, east, down to true north, east, down; then to east, north, up.
  const Eigen::Matrix3d true_from_magnetic =
      Eigen::AngleAxisd{declination_rad, Eigen::Vector3d::UnitZ()}.toRotationMatrix();
  Eigen::Matrix3d field_from_true;
  field_from_true << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  const Eigen::Matrix3d sensor_from_magnetic =
      Eigen::Map<const Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>{sample.sensor_from_earth.data()}.cast<double>();
  return {.acceleration_mps2 = gravity_mps2 * (body_from_sensor * vector(sample.acceleration_g)),
          .rate_radps = body_from_sensor * vector(sample.rate_radps),
          .field_gauss = body_from_sensor * vector(sample.field_gauss),
          .field_from_body =
              field_from_true * true_from_magnetic * sensor_from_magnetic.transpose() * body_from_sensor.transpose()};
}

Orientation3d to_orientation(const Eigen::Matrix3d& rotation) {
  return {.roll = std::atan2(rotation(2, 1), rotation(2, 2)),
          .pitch = std::atan2(-rotation(2, 0), std::hypot(rotation(2, 1), rotation(2, 2))),
          .yaw = std::atan2(rotation(1, 0), rotation(0, 0))};
}

ImuDriver::ImuDriver(Setup& setup) : ImuDriver{setup, link_to_imu(setup.config)} {}

ImuDriver::ImuDriver(Setup& setup, std::unique_ptr<motor_board::BoardLink> link)
    : port_{setup.provide<Imu>()},
      skipped_{setup.property<std::int32_t>("skipped", 0, {.read_only = true})},
      protocol_{read_protocol(setup.config)},
      sample_rate_hz_{setup.config.number("sample_rate", 100, {.min = 1, .max = 1000})},
      body_from_chip_{read_mount(setup.config)},
      declination_rad_{setup.config.angle("declination", 0, {.min = -std::numbers::pi, .max = std::numbers::pi})},
      timeout_{setup.config.duration("timeout", std::chrono::seconds{1}, {.min = 0.05, .max = 60})},
      link_{std::move(link)},
      reader_{protocol_} {
  port_.on<imu::SetDataType>([this](const imu::SetDataType& request) -> Result<Empty> {
    if (request.subtype < imu::State::message.subtype || request.subtype > imu::Euler::message.subtype) {
      return Error{std::errc::not_supported, "there are data 1 to 4: state, samples, quaternion, Euler angles"};
    }
    with_quaternion_ = with_quaternion_ || request.subtype == imu::Quaternion::message.subtype;
    with_euler_ = with_euler_ || request.subtype == imu::Euler::message.subtype;
    return Empty{};
  });
}

Result<> ImuDriver::open() {
  reader_ = microstrain::Reader{protocol_};
  skipped_.set(0);
  silence_ = {};
  heard_ = false;
  if (Result<> opened = link_->open(); !opened) return opened;
  return link_->send(protocol_ == microstrain::Protocol::mip ? microstrain::ask_mip()
                                                             : microstrain::start_single_byte());
}

void ImuDriver::close() noexcept {
  if (link_->descriptor() >= 0) {
    (void)link_->send(protocol_ == microstrain::Protocol::mip ? microstrain::stop_mip()
                                                              : microstrain::stop_single_byte());
  }
  link_->close();
}

std::span<const int> ImuDriver::descriptors() const {
  descriptor_[0] = link_->descriptor();
  return descriptor_;
}

Result<> ImuDriver::read(const Tick& tick) {
  silence_ += tick.dt;
  newest_.reset();
  for (int i = 0; i < most_reads; ++i) {
    const Result<std::size_t> received = link_->receive(tick, reader_.space());
    if (!received) return received.error();
    if (*received == 0) break;
    heard_ = true;
    reader_.filled(*received);
    while (const auto packet = reader_.next()) {
      if (packet->sample) newest_ = packet->sample;
      if (packet->answer) {
        if (Result<> taken = take(*packet->answer); !taken) return taken;
      }
    }
  }
  skipped_.set(
      static_cast<std::int32_t>(std::min<std::uint64_t>(reader_.skipped(), std::numeric_limits<std::int32_t>::max())));
  if (newest_) {
    silence_ = {};
    heard_ = false;
  }
  if (silence_ >= timeout_) return silent();
  return {};
}

Result<> ImuDriver::take(const microstrain::Answer& answer) {
  if (answer.error != 0) {
    return Error{std::errc::protocol_error, "the IMU on " + link_->name() + " refused " + to_string(answer)};
  }
  if (answer.base_hz == 0) return {};
  const double decimation = std::clamp(std::round(answer.base_hz / sample_rate_hz_), 1.0, 1000.0);
  return link_->send(microstrain::start_mip(static_cast<std::uint16_t>(decimation)));
}

Error ImuDriver::silent() const {
  const std::string since = link_->name() + ": no sample for " + text(seconds(silence_)) + " s";
  if (!heard_) return {std::errc::timed_out, since + ", nothing at all: is the IMU on, is `port` right?"};
  return {std::errc::timed_out, since + ", only other bytes: are `baud` and `protocol` right?"};
}

void ImuDriver::publish() {
  if (!newest_) return;
  const InertialSample sample = to_house(*newest_, body_from_chip_, declination_rad_);
  const Eigen::Vector3f acceleration = sample.acceleration_mps2.cast<float>();
  const Eigen::Vector3f rate = sample.rate_radps.cast<float>();
  const Eigen::Vector3f field = sample.field_gauss.cast<float>();
  const imu::Calibrated samples{.acceleration_x = acceleration.x(),
                                .acceleration_y = acceleration.y(),
                                .acceleration_z = acceleration.z(),
                                .rate_x = rate.x(),
                                .rate_y = rate.y(),
                                .rate_z = rate.z(),
                                .field_x = field.x(),
                                .field_y = field.y(),
                                .field_z = field.z()};
  const Orientation3d orientation = to_orientation(sample.field_from_body);
  port_.send(samples);
  port_.send(imu::State{.pose = {.roll = orientation.roll, .pitch = orientation.pitch, .yaw = orientation.yaw}});
  if (with_quaternion_) {
    const Eigen::Quaternionf q{sample.field_from_body.cast<float>()};
    port_.send(imu::Quaternion{.samples = samples, .q0 = q.w(), .q1 = q.x(), .q2 = q.y(), .q3 = q.z()});
  }
  if (with_euler_) port_.send(imu::Euler{.samples = samples, .orientation = orientation});
}

}  // namespace regista
