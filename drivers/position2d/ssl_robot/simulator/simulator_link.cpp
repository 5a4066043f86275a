// SPDX-License-Identifier: Apache-2.0
#include "simulator_link.hpp"

#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "ssl_robot.hpp"

namespace regista {

namespace {

using namespace std::chrono_literals;

constexpr double degree = std::numbers::pi / 180;
constexpr double radps_per_rpm = 2 * std::numbers::pi / 60;

/// Writes protobuf's wire format: each field with its number, in ascending order.
class Writer {
 public:
  Writer& number(int field, std::uint64_t value) {
    varint(static_cast<std::uint64_t>(field) << 3);
    varint(value);
    return *this;
  }
  Writer& real(int field, double value) {
    varint(static_cast<std::uint64_t>(field) << 3 | 5);
    fixed(std::bit_cast<std::uint32_t>(static_cast<float>(value)), 4);
    return *this;
  }
  Writer& real64(int field, double value) {
    varint(static_cast<std::uint64_t>(field) << 3 | 1);
    fixed(std::bit_cast<std::uint64_t>(value), 8);
    return *this;
  }
  Writer& message(int field, const Writer& inner) {
    varint(static_cast<std::uint64_t>(field) << 3 | 2);
    varint(inner.bytes_.size());
    bytes_.insert(bytes_.end(), inner.bytes_.begin(), inner.bytes_.end());
    return *this;
  }
  [[nodiscard]] const std::vector<std::uint8_t>& bytes() const { return bytes_; }

 private:
  void varint(std::uint64_t value) {
    for (; value >= 0x80; value >>= 7) bytes_.push_back(static_cast<std::uint8_t>(value | 0x80));
    bytes_.push_back(static_cast<std::uint8_t>(value));
  }
  void fixed(std::uint64_t value, int size) {
    for (int i = 0; i < size; ++i) bytes_.push_back(static_cast<std::uint8_t>(value >> 8 * i));
  }

  std::vector<std::uint8_t> bytes_;
};

/// Reads it: field by field, skipping what it does not know. Bytes that make no sense end it.
class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : bytes_{bytes} {}

  struct Field {
    std::uint64_t number = 0;
    std::uint64_t value = 0;                ///< of a varint
    std::span<const std::uint8_t> inner{};  ///< of a message
  };

  std::optional<Field> next() {
    const auto key = varint();
    if (!key) return {};
    Field field{.number = *key >> 3};
    switch (*key & 7) {
      case 0: {
        const auto value = varint();
        if (!value) return {};
        field.value = *value;
        return field;
      }
      case 1:
        return skip(8) ? std::optional{field} : std::nullopt;
      case 2: {
        const auto size = varint();
        if (!size || *size > bytes_.size()) return {};
        field.inner = bytes_.first(static_cast<std::size_t>(*size));
        bytes_ = bytes_.subspan(static_cast<std::size_t>(*size));
        return field;
      }
      case 5:
        return skip(4) ? std::optional{field} : std::nullopt;
      default:
        return {};
    }
  }

 private:
  bool skip(std::size_t size) {
    if (size > bytes_.size()) return false;
    bytes_ = bytes_.subspan(size);
    return true;
  }
  std::optional<std::uint64_t> varint() {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 64 && !bytes_.empty(); shift += 7) {
      const std::uint8_t byte = bytes_.front();
      bytes_ = bytes_.subspan(1);
      value |= static_cast<std::uint64_t>(byte & 0x7F) << shift;
      if ((byte & 0x80) == 0) return value;
    }
    return {};
  }

  std::span<const std::uint8_t> bytes_;
};

std::vector<std::uint8_t> grsim_packet(const Writer& robot, bool yellow) {
  Writer commands;
  commands.real64(1, 0).number(2, yellow ? 1 : 0).message(3, robot);
  return Writer{}.message(1, commands).bytes();
}

}  // namespace

std::vector<std::uint8_t> league_packet(const SimulatorCommand& command) {
  Writer local;  // forward, left, angular
  local.real(1, command.velocity.x).real(2, command.velocity.y).real(3, command.velocity.w);
  Writer robot;
  robot.number(1, command.robot).message(2, Writer{}.message(2, local));
  if (command.kick_mps > 0) robot.real(3, command.kick_mps).real(4, command.kick_rad / degree);
  robot.real(5, command.dribbler_radps / radps_per_rpm);
  return Writer{}.message(1, robot).bytes();
}

std::vector<std::uint8_t> league_packet(const SimulatorBrake& brake) {
  Writer wheels;  // front right, back right, back left, front left
  wheels.real(1, 0).real(2, 0).real(3, 0).real(4, 0);
  Writer robot;
  robot.number(1, brake.robot).message(2, Writer{}.message(1, wheels));
  return Writer{}.message(1, robot).bytes();
}

std::vector<std::uint8_t> grsim_packet(const SimulatorCommand& command) {
  Writer robot;
  robot.number(1, command.robot)
      .real(2, command.kick_mps * std::cos(command.kick_rad))
      .real(3, command.kick_mps * std::sin(command.kick_rad))
      .real(4, command.velocity.x)
      .real(5, command.velocity.y)
      .real(6, command.velocity.w)
      .number(7, command.dribbler_radps > 0 ? 1 : 0)
      .number(8, 0);
  return grsim_packet(robot, command.yellow);
}

std::vector<std::uint8_t> grsim_packet(const SimulatorBrake& brake) {
  Writer robot;
  robot.number(1, brake.robot).real(2, 0).real(3, 0).real(4, 0).real(5, 0).real(6, 0).number(7, 0).number(8, 1);
  for (int wheel = 9; wheel <= 12; ++wheel) robot.real(wheel, 0);
  return grsim_packet(robot, brake.yellow);
}

std::optional<bool> ball_contact(std::span<const std::uint8_t> response, std::uint32_t robot) {
  Reader reader{response};
  while (const auto field = reader.next()) {
    if (field->number != 2) continue;  // feedback
    Reader feedback{field->inner};
    std::uint64_t id = 0;
    std::optional<bool> contact;
    while (const auto inner = feedback.next()) {
      if (inner->number == 1) id = inner->value;
      if (inner->number == 2) contact = inner->value != 0;
    }
    if (id == robot && contact) return contact;
  }
  return {};
}

SimulatorLink::SimulatorLink(SimulatorAddress address, const control::Kinematics& kinematics, double wheel_radius_m,
                             double edges_per_rad)
    : address_{std::move(address)},
      kinematics_{kinematics},
      wheel_radius_m_{wheel_radius_m},
      edges_per_rad_{edges_per_rad},
      name_{"the simulator at " + address_.host + ':' + std::to_string(address_.port)} {}

Result<> SimulatorLink::open() {
  close();
  addrinfo hints{};
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (const int failed = ::getaddrinfo(address_.host.c_str(), std::to_string(address_.port).c_str(), &hints, &found);
      failed != 0) {
    return Error{std::errc::host_unreachable, name_ + ": " + ::gai_strerror(failed)};
  }
  socket_ = ::socket(found->ai_family, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  const bool connected = socket_ >= 0 && ::connect(socket_, found->ai_addr, found->ai_addrlen) == 0;
  const int error = errno;
  ::freeaddrinfo(found);
  if (!connected) return Error{std::error_code{error, std::generic_category()}, name_};
  motor_board_start(&firmware_);
  firmware_.telemetry.battery_mv = 12'000;  // none is simulated
  answers_ = false;
  std::ranges::fill(edges_, 0.0);
  return {};
}

void SimulatorLink::close() noexcept {
  if (socket_ >= 0) ::close(std::exchange(socket_, -1));
}

Result<> SimulatorLink::send(std::span<const std::uint8_t> bytes) {
  for (const std::uint8_t byte : bytes) answers_ = motor_board_take(&firmware_, byte, now_us()) || answers_;
  return radio();
}

std::uint32_t SimulatorLink::now_us() const { return static_cast<std::uint32_t>(now_ / 1us); }

Result<> SimulatorLink::listen() {
  std::array<std::uint8_t, 2048> packet{};
  for (int i = 0; i < 16; ++i) {
    const ssize_t size = ::recv(socket_, packet.data(), packet.size(), 0);
    if (size < 0) return errno == ECONNREFUSED ? failed(errno) : Result<>{};
    const auto contact = ball_contact(std::span{packet}.first(static_cast<std::size_t>(size)), address_.robot);
    if (!contact) continue;
    firmware_.telemetry.status =
        static_cast<std::uint8_t>((firmware_.telemetry.status & ~motor_board_ball) | (*contact ? motor_board_ball : 0));
  }
  return {};
}

Result<> SimulatorLink::transmit(std::span<const std::uint8_t> packet) {
  if (::send(socket_, packet.data(), packet.size(), 0) >= 0 || errno == EAGAIN || errno == ENOBUFS) return {};
  return failed(errno);
}

Error SimulatorLink::failed(int error) const {
  return {std::error_code{error, std::generic_category()}, name_ + (error == ECONNREFUSED ? " (is it started?)" : "")};
}

Result<> SimulatorLink::radio() {
  control::WheelSpeeds rims(motor_board_wheels);
  const MotorBoardCommand& is = firmware_.command;
  const bool drives = (is.flags & motor_board_drive) != 0;
  for (std::size_t i = 0; i < rims.size(); ++i) rims[i] = drives ? 1e-3 * is.wheel_mradps[i] * wheel_radius_m_ : 0;
  SimulatorCommand command{.robot = address_.robot,
                           .yellow = address_.yellow,
                           .velocity = kinematics_.body(rims),
                           .dribbler_radps = static_cast<double>(is.dribbler_radps)};
  if (motor_board_take_kick(&firmware_, true)) {  // a simulator's kicker is always ready
    command.kick_mps = 1e-3 * is.kick_speed_mmps;
    command.kick_rad = 1e-3 * is.kick_angle_mrad;
  }
  if (Result<> sent = transmit(address_.grsim ? grsim_packet(command) : league_packet(command)); !sent) return sent;
  if (drives) return {};
  // After the velocity, which is for simulators that know no wheels.
  const SimulatorBrake brake{.robot = address_.robot, .yellow = address_.yellow};
  return transmit(address_.grsim ? grsim_packet(brake) : league_packet(brake));
}

Result<std::size_t> SimulatorLink::receive(const Tick& tick, std::span<std::uint8_t> bytes) {
  for (std::size_t i = 0; i < motor_board_wheels; ++i) {
    const std::int32_t set = firmware_.command.wheel_mradps[i];
    edges_[i] += 1e-3 * set * edges_per_rad_ * seconds(tick.dt);
    firmware_.telemetry.count[i] = static_cast<std::int32_t>(std::llround(edges_[i]));
    firmware_.telemetry.speed_mradps[i] = set;
  }
  now_ += tick.dt;
  if (Result<> heard = listen(); !heard) return heard.error();
  firmware_.telemetry.status |= motor_board_charged;
  motor_board_tick(&firmware_, now_us());
  if (!std::exchange(answers_, false) || bytes.size() < motor_board_telemetry_size) return std::size_t{0};
  return motor_board_answer(&firmware_, now_us(), bytes.data());
}

std::unique_ptr<Driver> simulated_robot(Setup& setup, SimulatorAddress address) {
  auto link = std::make_unique<SimulatorLink>(std::move(address), ssl_kinematics(setup.config),
                                              setup.config.length("wheel_radius", 0.035, {.min = 1e-6}),
                                              setup.config.number("ticks", 144, {.min = 1}) / (2 * std::numbers::pi));
  return std::make_unique<SslRobot>(setup, std::move(link), nullptr,
                                    control::FieldEstimatorConfig{.fix_sd_m = 0.008, .wheels_sd_mps = 0.4});
}

}  // namespace regista
