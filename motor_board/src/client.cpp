// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <regista/motor_board/client.hpp>

namespace regista::motor_board {

namespace {

using namespace std::chrono_literals;

template <typename Integer>
Integer saturated(double value) {
  using Limits = std::numeric_limits<Integer>;
  if (std::isnan(value)) return 0;
  return static_cast<Integer>(
      std::lround(std::clamp(value, static_cast<double>(Limits::min()), static_cast<double>(Limits::max()))));
}

}  // namespace

std::int32_t milli(double value) { return saturated<std::int32_t>(1000 * value); }

Result<> BoardClient::open() {
  if (Result<> opened = link_->open(); !opened) return opened;
  motor_board_parse_telemetry(&parser_);
  telemetry_ = {};
  heard_ = false;
  silent_ = {};
  kick_.reset();
  return {};
}

Result<> BoardClient::receive(const Tick& tick) {
  received_ = 0;
  std::array<std::uint8_t, 1024> bytes;  // NOLINT(*-member-init): written before it is read
  // What waits beyond this is taken in the next beat; 13 frames are more than come in any.
  const Result<std::size_t> count = link_->receive(tick, bytes);
  if (!count) return count.error();
  for (const std::uint8_t byte : std::span{bytes}.first(*count)) {
    if (motor_board_parse(&parser_, byte) && motor_board_unpack_telemetry(parser_.frame, &telemetry_)) ++received_;
  }
  if (kick_) {
    kick_->waited += tick.dt;
    if (telemetry_.kick_id == kick_->id || kick_->waited > patience) kick_.reset();
  }
  silent_ = received_ > 0 ? Duration{} : silent_ + tick.dt;
  heard_ = heard_ || received_ > 0;
  if (silent_ <= (heard_ ? patience : first_patience)) return {};
  return Error{std::errc::timed_out,
               "the motor board on " + name() + " is silent; is it powered, and the cable right?"};
}

Result<> BoardClient::send(MotorBoardCommand command) {
  command.sequence = ++sequence_;
  if (kick_) {
    command.kick_id = kick_->id;
    command.kick_speed_mmps = kick_->speed_mmps;
    command.kick_angle_mrad = kick_->angle_mrad;
  }
  std::array<std::uint8_t, motor_board_command_size> frame{};
  motor_board_pack_command(&command, frame.data());
  return link_->send(frame);
}

void BoardClient::rest() noexcept {
  kick_.reset();
  (void)send({});
}

Result<> BoardClient::kick(double speed_mps, double angle_rad) {
  if (kick_) return Error{std::errc::device_or_resource_busy, "kick: the one before is under way"};
  if ((telemetry_.status & motor_board_charged) == 0) {
    return Error{std::errc::resource_unavailable_try_again, "kick: the capacitor has " +
                                                                std::to_string(telemetry_.capacitor_dv / 10) +
                                                                " V: send CHARGE 1 and wait until it is charged"};
  }
  const auto next = static_cast<std::uint8_t>(telemetry_.kick_id + 1);
  kick_ = Kick{.id = next == 0 ? std::uint8_t{1} : next,
               .speed_mmps = saturated<std::uint16_t>(1000 * speed_mps),
               .angle_mrad = saturated<std::uint16_t>(1000 * angle_rad)};
  return {};
}

}  // namespace regista::motor_board
