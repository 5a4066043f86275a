// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <regista/sim/can_drives.hpp>

namespace regista::sim {
namespace {

using namespace canopen;
using enum DataType;

struct Object {
  ObjectIndex object;
  DataType type;
  std::uint64_t value = 0;
  Access access = Access::read_write;
  bool mappable = false;
};

void add(ObjectDictionary& dictionary, const Object& object) {
  dictionary.objects[object.object] = {.name = to_string(object.object),
                                       .type = object.type,
                                       .access = object.access,
                                       .mappable = object.mappable,
                                       .value = le_bytes(object.value, size_of(object.type))};
}

ObjectDictionary dictionary_of(NodeId node, const CanDriveParameters& p) {
  constexpr auto read_only = Access::read_only;
  const auto whole = [](double value) { return static_cast<std::uint64_t>(std::llround(value)); };
  const auto rpm = [&](double value) { return whole(value / p.rpm_per_unit); };
  ObjectDictionary d;
  for (const Object& object : std::initializer_list<Object>{
           {{0x1000, 0}, unsigned32, p.sevcon ? 0xFFFF0192U : 0x00020192U, read_only},
           {{0x1001, 0}, unsigned8, 0, read_only},
           {{0x1005, 0}, unsigned32, p.sevcon ? 0x40000080U : 0x80U},
           {{0x1014, 0}, unsigned32, p.sevcon ? 0U : 0x80U + node},
           {{0x1017, 0}, unsigned16, 0},
           {{0x1018, 0}, unsigned8, 4, read_only},
           {{0x1018, 1}, unsigned32, p.vendor, read_only},
           {{0x1018, 2}, unsigned32, p.product, read_only},
           {{0x1018, 3}, unsigned32, 1, read_only},
           {{0x1018, 4}, unsigned32, node, read_only},
           {{0x6040, 0}, unsigned16, 0, Access::read_write, true},
           {{0x6041, 0}, unsigned16, 0, read_only, true},
           {{0x606C, 0}, integer32, 0, read_only, true},
           {{0x6077, 0}, integer16, 0, read_only, true},
           {{0x6078, 0}, integer16, 0, read_only, true},
           {{0x6071, 0}, integer16, 0, Access::read_write, true},
           {{0x6072, 0}, unsigned16, 1000, Access::read_write, true},
           {{0x6080, 0}, unsigned32, rpm(p.motion.max_speed_rpm)},
           {{0x6083, 0}, unsigned32, rpm(p.motion.accel_rpm_per_s)},
           {{0x6060, 0}, integer8, p.sevcon ? 4U : 3U},
           {{0x6502, 0}, unsigned32, p.sevcon ? 0xCU : 0x4U, read_only},
           {{0x60FF, 0}, integer32, 0, Access::read_write, true},
       }) {
    add(d, object);
  }
  if (p.sevcon) {
    add(d, {{0x4600, 3}, integer16, 35, read_only, true});
    add(d, {{0x5100, 1}, unsigned16, whole(16 * p.volts), read_only, true});
    add(d, {{0x5100, 2}, integer16, 0, read_only, true});
    add(d, {{0x5100, 3}, unsigned16, whole(16 * p.volts), read_only, true});
    add(d, {{0x5100, 4}, integer8, 30, read_only, true});
    if (p.watches_master) add(d, {{0x5902, 0}, unsigned8, 0});
  } else {
    add(d, {{0x603F, 0}, unsigned16, 0, read_only, true});
    add(d, {{0x605A, 0}, integer16, 2});
    add(d, {{0x6061, 0}, integer8, 3, read_only, true});
    add(d, {{0x6064, 0}, integer32, 0, read_only, true});
    add(d, {{0x6075, 0}, unsigned32, 20'000, read_only});
    add(d, {{0x6079, 0}, unsigned32, whole(1000 * p.volts), read_only, true});
    add(d, {{0x6084, 0}, unsigned32, rpm(p.motion.decel_rpm_per_s)});
    add(d, {{0x6085, 0}, unsigned32, rpm(p.motion.quick_stop_rpm_per_s)});
    add(d, {{0x60FE, 0}, unsigned8, 2, read_only});
    add(d, {{0x60FE, 1}, unsigned32, 0});
    add(d, {{0x60FE, 2}, unsigned32, 0});
  }
  if (p.watches_master) {
    add(d, {{0x1016, 0}, unsigned8, 1, read_only});
    add(d, {{0x1016, 1}, unsigned32, 0});
    if (!p.sevcon) add(d, {{0x6007, 0}, integer16, 0});
  }
  for (std::uint16_t i = 0; i < 4; ++i) {
    for (const bool receive : {true, false}) {
      const auto index = static_cast<std::uint16_t>((receive ? 0x1400 : 0x1800) + i);
      const std::uint32_t cob_id = (receive ? 0x200U : 0x180U) + 0x100U * i + node;
      add(d, {{index, 0}, unsigned8, 5, read_only});
      add(d, {{index, 1}, unsigned32, 0x80000000U | cob_id});
      add(d, {{index, 2}, unsigned8, 255});
      if (!receive) add(d, {{index, 3}, unsigned16, 0});
      if (!receive || (p.watches_master && !p.sevcon)) add(d, {{index, 5}, unsigned16, 0});
      const auto mapping = static_cast<std::uint16_t>(index + 0x200);
      for (std::uint8_t sub = 0; sub <= 8; ++sub) add(d, {{mapping, sub}, sub == 0 ? unsigned8 : unsigned32, 0});
    }
  }
  if (p.change) p.change(d);
  return d;
}

}  // namespace

CanDrive::CanDrive(CanBus& bus, NodeId node, const CanDriveParameters& parameters)
    : parameters_{parameters},
      drive_{parameters.motion},
      slave_{bus,
             node,
             dictionary_of(node, parameters),
             {.written = [this](ObjectIndex object, ByteView bytes) { return written(object, bytes); },
              .reading = [this](ObjectIndex object) { reading(object); },
              .state =
                  [this](NmtState state) {
                    if (state != NmtState::operational) abort_connection(0);
                  },
              .silent = [this](std::uint16_t code) { abort_connection(code); }},
             {}} {}

std::optional<SdoAbort> CanDrive::written(ObjectIndex object, ByteView bytes) {
  if (object == ObjectIndex{0x6040, 0} || object == ObjectIndex{0x60FF, 0}) {
    const auto target = static_cast<std::int32_t>(slave_.get({0x60FF, 0}));
    drive_.write(static_cast<std::uint16_t>(slave_.get({0x6040, 0})), target * parameters_.rpm_per_unit);
    if (faulted_ && drive_.error_code() == 0) {
      faulted_ = false;
      slave_.emergency({}, *stepped_);
    }
  }
  const double rpm = static_cast<double>(get_le(bytes)) * parameters_.rpm_per_unit;
  const auto set_motion = [&](double Cia402DriveParameters::* what) -> std::optional<SdoAbort> {
    if (rpm <= 0) return SdoAbort::value_too_low;
    parameters_.motion.*what = rpm;
    drive_.configure(parameters_.motion);
    return {};
  };
  switch (object.index) {
    case 0x6080:
      return set_motion(&Cia402DriveParameters::max_speed_rpm);
    case 0x6083:
      return set_motion(&Cia402DriveParameters::accel_rpm_per_s);
    case 0x6084:
      return set_motion(&Cia402DriveParameters::decel_rpm_per_s);
    case 0x6085:
      return set_motion(&Cia402DriveParameters::quick_stop_rpm_per_s);
    default:
      break;
  }
  if (object == ObjectIndex{0x6060, 0}) {
    if (get_le(bytes) != 3 && get_le(bytes) != 4) return SdoAbort::value;
    slave_.set({0x6061, 0}, get_le(bytes));
  }
  return {};
}

void CanDrive::reading(ObjectIndex object) {
  switch (object.index) {
    case 0x6041:
      return slave_.set(object, drive_.statusword());
    case 0x603F:
      return slave_.set(object, drive_.error_code());
    case 0x606C:
      return slave_.set(object,
                        static_cast<std::uint64_t>(std::llround(drive_.speed_rpm() / parameters_.rpm_per_unit)));
    case 0x6064:  // rolls over, as it does in a drive
      return slave_.set(object, static_cast<std::uint64_t>(std::llround(drive_.turns() * parameters_.increments)));
    default:
      return;
  }
}

void CanDrive::abort_connection(std::uint16_t code) {
  const auto state = drive_.state();
  if (state != Cia402State::operation_enabled) return;
  // CiA 402-2, 6007: 0 nothing, 1 a fault, 2 disable voltage, 3 quick stop. A Gen4 stops with a fault.
  switch (parameters_.sevcon ? 1 : slave_.get({0x6007, 0})) {
    case 1:
      drive_.fail(code == 0 ? 0x8000 : code);
      faulted_ = true;
      break;
    case 2:
      drive_.write(controlword::disable_voltage, 0);
      break;
    case 3:
      drive_.write(controlword::quick_stop, 0);
      break;
    default:
      break;
  }
}

void CanDrive::power_cycle(Time now) {
  drive_ = Cia402Drive{parameters_.motion};
  faulted_ = false;
  slave_.power_on(now);
}

void CanDrive::fail(std::uint16_t code, Time now) {
  drive_.fail(code);
  faulted_ = true;
  slave_.emergency({.code = code, .error_register = 0x01}, now);
}

void CanDrive::step(Time now) {
  drive_.step(now - stepped_.value_or(now));
  stepped_ = now;
}

void CanDrive::on_frame(const CanFrame& frame, Time now) {
  step(now);
  slave_.on_frame(frame, now);
}

void CanDrive::on_time(Time now) {
  step(now);
  slave_.on_time(now);
}

Time CanDrive::next_wake() const { return slave_.next_wake(); }

CanDrives::CanDrives(std::span<const NodeId> nodes, const CanDriveParameters& parameters, int bit_rate)
    : bus_{bit_rate}, port_{&bus_.attach()} {
  for (const NodeId node : nodes) {
    drive_ports_.push_back(&bus_.attach());
    drives_.emplace_back(*drive_ports_.back(), node, parameters);
  }
}

Result<> CanDrives::run(Station& master, Time now) {
  if (!now_) now_ = now;
  while (true) {
    if (Result<> settled = settle(master, *now_); !settled) return settled;
    Time next = std::min(bus_.next_wake(), master.next_wake());
    for (const CanDrive& drive : drives_) next = std::min(next, drive.next_wake());
    if (next > now) break;
    now_ = std::max(*now_, next);
  }
  if (now <= *now_) return {};
  now_ = now;
  return settle(master, now);
}

Result<> CanDrives::settle(Station& master, Time now) {
  bus_.on_time(now);
  if (Result<> served = serve(*port_, master, now); !served) return served;
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    if (Result<> served = serve(*drive_ports_[i], drives_[i], now); !served) return served;
  }
  bus_.on_time(now);
  return {};
}

}  // namespace regista::sim
