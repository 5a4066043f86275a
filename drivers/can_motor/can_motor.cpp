// SPDX-License-Identifier: Apache-2.0
#include "can_motor.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <regista/canopen/eds.hpp>
#include <sstream>

namespace regista {

using can_motor::BusLink;
using can_motor::DriveNode;
using can_motor::Profile;
using canopen::NodeId;

namespace {

constexpr std::size_t most_drives = 8;
constexpr double rpm_per_radps = 60 / (2 * std::numbers::pi);
constexpr Duration diagnosis_period = std::chrono::milliseconds{250};
// A float is exact enough for the angle of a wheel up to here; beyond it rolls over.
constexpr double roll_over_rad = 512 * 2 * std::numbers::pi;

std::vector<NodeId> read_nodes(const Section& config) {
  std::vector<NodeId> nodes;
  for (const double number : config.numbers("nodes", {.min = canopen::first_node, .max = canopen::last_node})) {
    const auto node = static_cast<NodeId>(number);
    if (node != number) throw config.error("nodes", "must be whole numbers");
    if (std::ranges::find(nodes, node) != nodes.end()) throw config.error("nodes", "has the same node twice");
    nodes.push_back(node);
  }
  if (nodes.empty() || nodes.size() > most_drives) throw config.error("nodes", "must be one to eight node ids");
  return nodes;
}

std::optional<std::uint32_t> read_hex(const Section& config, const char* key) {
  if (!config.has(key)) return {};
  const std::string text = config.text(key);
  const std::string_view digits = std::string_view{text}.substr(text.starts_with("0x") ? 2 : 0);
  std::uint32_t value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value, 16);
  if (error != std::errc{} || end != digits.data() + digits.size()) {
    throw config.error(key, "must be a hexadecimal number of up to eight digits, such as \"0x1E\"");
  }
  return value;
}

Profile read_profile(const Section& config) {
  const std::string profile = config.text("profile", "cia402");
  if (profile == "cia402") return Profile::cia402;
  if (profile == "sevcon") return Profile::sevcon;
  throw config.error("profile", R"(must be "cia402" or "sevcon")");
}

double read_units_per_radps(const Section& config) {
  return rpm_per_radps * config.number("gear", 1, {.min = 1e-3}) / config.number("velocity_unit", 1, {.min = 1e-6});
}

can_motor::DriveSettings read_settings(const Section& config) {
  const double units = read_units_per_radps(config);
  const auto in_units = [&](double radps) {
    return static_cast<std::uint32_t>(std::clamp(std::ceil(radps * units), 1.0, 2147483647.0));
  };
  const auto ramp = [&](const char* key) {
    return config.has(key) ? std::optional{in_units(config.angle(key, {.min = 1e-3}))} : std::nullopt;
  };
  const Duration feedback = config.duration("feedback", std::chrono::milliseconds{20}, {.min = 0.001, .max = 0.1});
  return {
      .profile = read_profile(config),
      .vendor = read_hex(config, "vendor"),
      .product = read_hex(config, "product"),
      .position = config.number("increments", 0, {.min = 0}) > 0,
      .max_speed = in_units(config.angle("wheel_speed", {.min = 1e-3})),
      .accel = ramp("wheel_accel"),
      .decel = ramp("wheel_decel"),
      .quick_stop = ramp("quick_stop"),
      .max_torque_permille = static_cast<std::uint16_t>(10 * config.number("torque", 100, {.min = 0.1, .max = 300})),
      .feedback = std::chrono::round<std::chrono::milliseconds>(feedback)};
}

std::vector<std::vector<canopen::SdoWrite>> read_dcf(const Section& config, std::span<const NodeId> nodes) {
  std::vector<std::vector<canopen::SdoWrite>> writes(nodes.size());
  const std::vector<std::string> files = config.texts("dcf", {});
  if (files.empty()) return writes;
  if (files.size() != 1 && files.size() != nodes.size()) {
    throw config.error("dcf", "must be one file for all nodes, or one for each");
  }
  const auto folder = std::filesystem::path{config.place_of("dcf").file}.parent_path();
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    try {
      writes[i] = canopen::load_eds((folder / files[files.size() == 1 ? 0 : i]).string(), nodes[i]).configuration();
    } catch (const std::exception& wrong) {
      throw config.error("dcf", std::string{"cannot be used: "} + wrong.what());
    }
  }
  return writes;
}

std::unique_ptr<BusLink> read_bus(const Section& config) {
  const std::string bus = config.text("bus");
  if (bus != "simulated") return can_motor::make_bus_link(bus);
  const double rpm_per_unit = config.number("velocity_unit", 1, {.min = 1e-6});
  const can_motor::DriveSettings settings = read_settings(config);
  sim::CanDriveParameters parameters{.sevcon = settings.profile == Profile::sevcon,
                                     .increments = static_cast<std::int32_t>(config.number("increments", 4096)),
                                     .rpm_per_unit = rpm_per_unit};
  parameters.motion.max_speed_rpm = 1.5 * settings.max_speed * rpm_per_unit;
  // From rest to the largest speed in half a second, and back in a quarter, unless the .cfg says otherwise.
  parameters.motion.accel_rpm_per_s = 2 * parameters.motion.max_speed_rpm;
  parameters.motion.decel_rpm_per_s = 2 * parameters.motion.max_speed_rpm;
  parameters.motion.quick_stop_rpm_per_s = 4 * parameters.motion.max_speed_rpm;
  const std::vector<NodeId> nodes = read_nodes(config);
  return std::make_unique<can_motor::SimulatedBusLink>(
      nodes, parameters, static_cast<int>(config.integer("bit_rate", 500'000, {.min = 20'000, .max = 1'000'000})));
}

std::vector<CanMotor::Relay> read_relays(const Section& config, std::span<const NodeId> nodes) {
  std::vector<CanMotor::Relay> relays;
  for (const std::string& text : config.texts("relays", {})) {
    std::istringstream words{text};
    int node = 0;
    std::string object;
    unsigned bit = 0;
    const bool complete = static_cast<bool>(words >> node >> object >> bit) && bit < 32;
    const auto index = canopen::ObjectDictionary{}.parse(object);
    if (!complete || !index) {
      throw config.error("relays", "must be like \"5 60FE:01 16\": node, object, bit; not \"" + text + '"');
    }
    if (std::ranges::find(nodes, node) == nodes.end()) {
      throw config.error("relays", "has node " + std::to_string(node) + ", which is not in 'nodes'");
    }
    relays.push_back({static_cast<NodeId>(node), *index, bit});
  }
  if (relays.size() > 32) throw config.error("relays", "must be at most 32");
  return relays;
}

}  // namespace

CanMotor::CanMotor(Setup& setup) : CanMotor{setup, read_bus(setup.config)} {}

CanMotor::CanMotor(Setup& setup, std::unique_ptr<BusLink> link)
    : wheels_{setup.provide<Actarray>()},
      power_{setup.provide<Power>()},
      relays_port_{setup.provide<Dio>()},
      bus_text_{setup.property<std::string>("bus", "closed", {.read_only = true})},
      nodes_{read_nodes(setup.config)},
      settings_{read_settings(setup.config)},
      options_{
          .master = static_cast<NodeId>(setup.config.integer("master", 127, {.min = 1, .max = 127})),
          .bit_rate = static_cast<int>(setup.config.integer("bit_rate", 500'000, {.min = 20'000, .max = 1'000'000})),
          .cycle = setup.config.duration("cycle", std::chrono::milliseconds{20}, {.min = 0.001, .max = 0.1})},
      dcf_{read_dcf(setup.config, nodes_)},
      relays_{read_relays(setup.config, nodes_)},
      fastest_radps_{setup.config.angle("wheel_speed")},
      link_{std::move(link)},
      targets_(nodes_.size()),
      angles_rad_(nodes_.size()) {
  const Section& config = setup.config;
  (void)config.text("bus", "");
  if (std::ranges::find(nodes_, options_.master) != nodes_.end())
    throw config.error("master", "must be none of 'nodes'");
  if (fastest_radps_ * read_units_per_radps(config) > std::numeric_limits<std::int32_t>::max()) {
    throw config.error("velocity_unit", "is too small: 'wheel_speed' does not fit into 60FF");
  }
  const std::vector<double> reversed = config.numbers("reversed", {});
  for (const double node : reversed) {
    if (std::ranges::find(nodes_, node) == nodes_.end()) throw config.error("reversed", "must be some of 'nodes'");
  }
  const double increments = config.number("increments", 0, {.min = 0, .max = 1e9});
  for (const NodeId node : nodes_) {
    const double sign = std::ranges::find(reversed, node) == reversed.end() ? 1 : -1;
    units_per_radps_.push_back(sign * read_units_per_radps(config));
    rad_per_increment_.push_back(
        increments > 0 ? sign * 2 * std::numbers::pi / (increments * config.number("gear", 1, {.min = 1e-3})) : 0);
    const std::string name = "node" + std::to_string(node);
    diagnoses_.push_back({setup.property<std::string>(name, "closed", {.read_only = true}),
                          setup.property<std::string>(name + ".emcy", "", {.read_only = true})});
  }
  state_.actuators.resize(nodes_.size());

  wheels_.on<actarray::SpeedCommand>([this](const actarray::SpeedCommand& command) -> Result<> {
    std::array<float, most_drives> speeds{};
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      speeds[i] = static_cast<float>(targets_[i] / units_per_radps_[i]);
    }
    if (command.joint < -1 || std::cmp_greater_equal(std::max(command.joint, 0), nodes_.size())) {
      return Error{std::errc::invalid_argument, "there is no wheel " + std::to_string(command.joint) + ", only 0 to " +
                                                    std::to_string(nodes_.size() - 1) + ", and -1 for all"};
    }
    if (command.joint < 0) {
      speeds.fill(command.speed);
    } else {
      speeds[static_cast<std::size_t>(command.joint)] = command.speed;
    }
    return set_speeds(std::span{speeds}.first(nodes_.size()));
  });
  wheels_.on<actarray::MultiSpeedCommand>([this](const actarray::MultiSpeedCommand& command) -> Result<> {
    if (command.speeds.size() != nodes_.size()) {
      return Error{std::errc::invalid_argument, "there are " + std::to_string(nodes_.size()) + " wheels, and " +
                                                    std::to_string(command.speeds.size()) + " speeds"};
    }
    return set_speeds(command.speeds);
  });
  wheels_.on<actarray::SetPower>([this](const actarray::SetPower& request, Responder<Empty> responder) {
    std::ranges::fill(targets_, 0);
    if (request.on == 0) {
      group_->power_off(wheels_.now());
      return responder.answer(Empty{});
    }
    group_->enable(
        [to = std::make_shared<Responder<Empty>>(std::move(responder))](const Result<>& done) {
          to->answer(done ? Result<Empty>{Empty{}} : Result<Empty>{done.error()});
        },
        wheels_.now());
  });
  relays_port_.on<dio::OutputCommand>([this](const dio::OutputCommand& command) { return switch_relays(command); });
  wheels_.on<actarray::GetGeometry>([this](const auto&) -> Result<actarray::Geometry> {
    actarray::Geometry geometry;
    geometry.actuators.resize(
        nodes_.size(),
        {.type = actarray::ActuatorType::rotary, .axis = {.y = 1}, .speed = static_cast<float>(fastest_radps_)});
    return geometry;
  });
}

CanMotor::~CanMotor() = default;

/// Outputs are objects of a drive, whose other bits are not ours: read, change, write.
Result<> CanMotor::switch_relays(const dio::OutputCommand& command) {
  if (command.count > relays_.size()) {
    return Error{std::errc::invalid_argument, "there are " + std::to_string(relays_.size()) + " relays, and " +
                                                  std::to_string(command.count) + " bits"};
  }
  for (std::size_t i = 0; i < command.count; ++i) {
    if (const DriveNode& drive = drive_of(relays_[i]); !drive.ready()) {
      return Error{std::errc::not_connected, "node " + std::to_string(drive.node()) + ": " + drive.describe()};
    }
  }
  const std::uint32_t meant = command.count < 32 ? (1U << command.count) - 1 : ~0U;
  wanted_outputs_ = (wanted_outputs_ & ~meant) | (command.bits & meant);
  for (std::size_t i = 0; i < command.count; ++i) {
    const auto is_same = [&](const Relay& other) {
      return other.node == relays_[i].node && other.object == relays_[i].object;
    };
    if (std::find_if(relays_.begin(), relays_.end(), is_same) != relays_.begin() + static_cast<std::ptrdiff_t>(i)) {
      continue;  // the first of an object switches all of it
    }
    if (Result<> begun = switch_object(relays_[i]); !begun) return begun;
  }
  return {};
}

const DriveNode& CanMotor::drive_of(const Relay& relay) const {
  return *std::ranges::find(group_->drives(), relay.node, &DriveNode::node);
}

Result<> CanMotor::switch_object(const Relay& relay) {
  canopen::Master& master = group_->master();
  const auto told = [this](const Error& error) { relays_port_.tell(2, "relays: " + error.message()); };
  std::uint64_t ours = 0;
  for (const Relay& other : relays_) {
    if (other.node == relay.node && other.object == relay.object) ours |= 1ULL << other.bit;
  }
  if (relay.object == canopen::ObjectIndex{0x60FE, 1}) {
    // CiA 402-2, 60FE: what is not in the mask stays as it is.
    const auto masked = [told](const Result<canopen::Bytes>& done) {
      if (!done) told(done.error());
    };
    if (Result<> begun = master.download(relay.node, {0x60FE, 2}, canopen::le_bytes(ours, 4), masked, now_); !begun) {
      return begun;
    }
  }
  return master.upload(
      relay.node, relay.object,
      [this, relay, ours, told](const Result<canopen::Bytes>& before) {
        if (!before) return told(before.error());
        if (before->empty() || before->size() > 8) {
          return told({std::errc::bad_message, "node " + std::to_string(relay.node) + ": " + to_string(relay.object) +
                                                   " has " + std::to_string(before->size()) + " bytes, not 1 to 8"});
        }
        std::uint32_t switched = 0;  // which of our outputs
        std::uint64_t value = canopen::get_le(*before) & ~ours;
        for (std::size_t i = 0; i < relays_.size(); ++i) {
          if (relays_[i].node != relay.node || relays_[i].object != relay.object) continue;
          switched |= 1U << i;
          if ((wanted_outputs_ >> i & 1) != 0) value |= 1ULL << relays_[i].bit;
        }
        const std::uint32_t as_written = wanted_outputs_ & switched;
        const auto written = [this, told, switched, as_written](const Result<canopen::Bytes>& done) {
          if (!done) return told(done.error());
          outputs_ = (outputs_ & ~switched) | as_written;
          relays_port_.send(dio::State{.count = static_cast<std::uint32_t>(relays_.size()), .bits = outputs_});
        };
        const Result<> begun = group_->master().download(
            relay.node, relay.object, canopen::le_bytes(value, before->size()), written, group_->master().now());
        if (!begun) told(begun.error());
      },
      now_);
}

Result<> CanMotor::open() {
  const auto bus = link_->open();
  if (!bus) return bus.error();
  const can_motor::DriveGroup::Events events{
      .stopped =
          [this](const std::string& reason) {
            std::ranges::fill(targets_, 0);
            wheels_.tell(2, reason);
            wheels_.stop(reason);
          },
      .tell = [this](std::uint8_t severity, const std::string& text) { wheels_.tell(severity, text); }};
  group_ = std::make_unique<can_motor::DriveGroup>(**bus, nodes_, settings_, dcf_, options_, events);
  link_->join(*group_);
  descriptor_ = link_->descriptor();
  std::ranges::fill(targets_, 0);
  wanted_outputs_ = outputs_ = 0;
  return {};
}

void CanMotor::close() noexcept {
  for (std::size_t i = 0; group_ && i < nodes_.size(); ++i) {
    const DriveNode& drive = group_->drives()[i];
    angles_rad_[i] += settings_.position ? rad_per_increment_[i] * static_cast<double>(drive.increments())
                                         : drive.way() / units_per_radps_[i];
  }
  link_->close();
  group_.reset();
  descriptor_ = -1;
}

void CanMotor::halt() noexcept {
  std::ranges::fill(targets_, 0);
  if (group_) group_->power_off(now_);
}

Result<> CanMotor::set_speeds(std::span<const float> radps) {
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const double limited = std::clamp(static_cast<double>(radps[i]), -fastest_radps_, fastest_radps_);
    targets_[i] = static_cast<std::int32_t>(std::lround(limited * units_per_radps_[i]));
  }
  if (Result<> set = group_->set_targets(targets_, wheels_.now()); !set) {
    std::ranges::fill(targets_, 0);
    return set;
  }
  return {};
}

Result<> CanMotor::read(const Tick& tick) {
  now_ = tick.now;
  if (Result<> ran = link_->run(tick.now); !ran) return ran;
  if (group_->broken()) return *group_->broken();
  // What was wanted of a drive that went away is not wanted of the one that comes back.
  for (std::size_t i = 0; i < relays_.size(); ++i) {
    if (drive_of(relays_[i]).ready()) continue;
    wanted_outputs_ &= ~(1U << i);
    outputs_ &= ~(1U << i);
  }
  if (now_ - diagnosed_ >= diagnosis_period) diagnose(now_);
  return {};
}

double CanMotor::radps_of(std::size_t drive) const {
  return group_->drives()[drive].velocity() / units_per_radps_[drive];
}

void CanMotor::publish() {
  std::deque<DriveNode>& drives = group_->drives();
  // All wheels together, and each message of theirs once; wheels of drives that are down keep their place.
  const auto waits = [](const DriveNode& drive) { return drive.ready() && !drive.fresh(); };
  if (std::ranges::none_of(drives, &DriveNode::fresh) || std::ranges::any_of(drives, waits)) return;
  double voltage_v = 0;
  double power_w = 0;
  int voltages = 0;
  int currents = 0;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    DriveNode& drive = drives[i];
    (void)drive.take_fresh();
    const double angle_rad =
        angles_rad_[i] + (settings_.position ? rad_per_increment_[i] * static_cast<double>(drive.increments())
                                             : drive.way() / units_per_radps_[i]);
    const double current_a = drive.measured().motor_a;
    state_.actuators[i] = {
        .position = static_cast<float>(std::remainder(angle_rad, roll_over_rad)),
        .speed = drive.ready() ? static_cast<float>(radps_of(i)) : 0.0F,
        .current_a = std::isfinite(current_a) ? static_cast<float>(current_a) : 0.0F,
        .state = drive.velocity() != 0 ? actarray::ActuatorState::moving : actarray::ActuatorState::idle};
    if (const double volts = drive.measured().voltage_v; drive.ready() && std::isfinite(volts)) {
      voltage_v += volts;
      ++voltages;
      if (const double amperes = drive.measured().supply_a; std::isfinite(amperes)) {
        power_w += volts * amperes;
        ++currents;
      }
    }
  }
  state_.motors_on = group_->enabled() ? 1 : 0;
  wheels_.send(state_);
  // Again and again: whoever comes later learns how many relays there are, and how they stand.
  if (!relays_.empty()) {
    relays_port_.send(dio::State{.count = static_cast<std::uint32_t>(relays_.size()), .bits = outputs_});
  }
  if (voltages == 0) return;
  // Drives of one robot have one supply.
  power_.send(power::State{.valid = power::volts | (currents > 0 ? power::watts : 0U),
                           .voltage_v = static_cast<float>(voltage_v / voltages),
                           .power_w = static_cast<float>(power_w)});
}

void CanMotor::diagnose(Time now) {
  diagnosed_ = now;
  const canopen::Master& master = group_->master();
  const canopen::Master::Statistics& counted = master.statistics();
  const auto errors = [](const char* name, const std::optional<std::uint8_t>& counter) {
    return counter ? std::string{", "} + name + " errors " + std::to_string(*counter) : std::string{};
  };
  bus_text_.set(canopen::to_string(master.bus_state()) + ", load " +
                std::to_string(static_cast<int>(std::lround(100 * master.bus_load()))) + " %, " +
                std::to_string(counted.sent) + " sent, " + std::to_string(counted.received) + " received, " +
                std::to_string(counted.saturated) + " times full, " + std::to_string(counted.discarded) + " discarded" +
                errors("transmit", counted.transmit_errors) + errors("receive", counted.receive_errors));
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const DriveNode& drive = group_->drives()[i];
    std::string text = drive.describe();
    if (drive.ready()) {
      const auto value = [&](double number, const char* unit) {
        if (std::isfinite(number)) text += ", " + std::to_string(static_cast<int>(std::lround(number))) + unit;
      };
      value(radps_of(i) * rpm_per_radps, " rpm of the wheel");
      value(drive.measured().voltage_v, " V");
      value(drive.measured().supply_a, " A of the supply");
      value(drive.measured().motor_a, " A of the motor");
      value(drive.measured().motor_c, " °C of the motor");
      value(drive.measured().heatsink_c, " °C of the heatsink");
      if (!drive.unguarded().empty()) text += "; " + drive.unguarded();
    }
    diagnoses_[i].state.set(std::move(text));
    std::string history;
    for (const canopen::EmcyHistory::Entry& entry : master.emergencies(nodes_[i]).entries()) {
      if (!history.empty()) history += "; ";
      history += std::to_string(std::lround(seconds(now - entry.time))) + " s ago " + canopen::to_string(entry.emcy);
    }
    diagnoses_[i].emcy.set(std::move(history));
  }
}

}  // namespace regista
