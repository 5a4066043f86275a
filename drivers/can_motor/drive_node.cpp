// SPDX-License-Identifier: Apache-2.0
#include "drive_node.hpp"

#include <algorithm>

namespace regista::can_motor {

using namespace std::chrono_literals;
using canopen::Bytes;
using canopen::ByteView;
using canopen::Cia402State;
using canopen::NmtState;
using canopen::NodeMonitor;
using canopen::ObjectIndex;
using canopen::PdoDirection;
using canopen::PdoMapping;
using canopen::sdo_write;
using canopen::SdoWrite;

namespace {

constexpr auto producer_time = 100ms;  // of the drive's heartbeat
constexpr auto silence = 250ms;        // of the drive, until all stop; of us, until it does
constexpr Duration try_again = 1s;
constexpr Duration patience = 5s;  // with a drive that was started

}  // namespace

DriveNode::DriveNode(canopen::Master& master, canopen::NodeId node, const DriveSettings& settings,
                     std::vector<SdoWrite> dcf, Events events)
    : master_{master},
      node_{node},
      settings_{settings},
      dcf_{std::move(dcf)},
      events_{std::move(events)},
      command_map_{command_map(settings.profile)},
      feedback_map_{feedback_map(settings.profile)},
      command_{master.add_pdo(0x200U + node, command_map_.size_bytes(), false)} {
  subscribe();
}

/// The PDOs have the ids of the pre-defined connection set: 1 speed, 2 position, 3 and 4 what else is measured.
void DriveNode::subscribe() {
  master_.on_pdo(0x180U + node_, [this](ByteView bytes, Time now) { on_feedback(bytes, now); });
  master_.on_pdo(0x280U + node_, [this](ByteView bytes, Time /*now*/) {
    if (!settings_.position || bytes.size() < 4) return;
    const auto position = static_cast<std::int32_t>(canopen::get_le(bytes.first(4)));
    // It rolls over.
    if (position_) {
      increments_ +=
          static_cast<std::int32_t>(static_cast<std::uint32_t>(position) - static_cast<std::uint32_t>(*position_));
    }
    position_ = position;
    fresh_ = true;
  });
  for (std::size_t i = 0; i < 2; ++i) {
    master_.on_pdo(0x380U + 0x100U * static_cast<std::uint32_t>(i) + node_, [this, i](ByteView bytes, Time /*now*/) {
      if (i >= reading_maps_.size() || bytes.size() < reading_maps_[i].size_bytes()) return;
      for (std::size_t at = 0; at < readings_[i].size(); ++at) {
        const Reading& reading = readings_[i][at];
        const double count = reading.is_signed ? static_cast<double>(reading_maps_[i].get_signed(bytes, at))
                                               : static_cast<double>(reading_maps_[i].get(bytes, at));
        measured_.*reading.to = reading.scale * count;
      }
    });
  }
}

// --- the way up ------------------------------------------------------------------------------------------------------

void DriveNode::begin(Time now) {
  ++attempt_;
  heard_.reset();
  state_.reset();
  position_.reset();
  unguarded_.clear();
  due_ = Time::max();
  // Set up in pre-operational; one that is operational stays so until it has no voltage.
  enter(Step::device_type);
  (void)now;
}

void DriveNode::fail(const std::string& why) {
  ++attempt_;
  step_ = Step::resting;
  due_ = master_.now() + try_again;
  if (why != failed_) events_.tell(1, title() + ": " + why);
  failed_ = why;
}

void DriveNode::fail(const Error& error) { fail(reason(error)); }

/// An error of the master's names the node, and so do we.
std::string DriveNode::reason(const Error& error) const {
  std::string text = error.message();
  const std::string node = title() + ": ";
  return text.starts_with(node) ? text.substr(node.size()) : text;
}

/// Trouble first, while it is up: the quick stop goes to it, too. Perhaps it only cannot be heard.
void DriveNode::lose(const std::string& why) {
  events_.trouble(title() + ": " + why);
  failed_ = why;  // told already
  fail(why);
}

void DriveNode::read(ObjectIndex object, std::function<void(const Result<Bytes>&)> done) {
  const Result<> begun = master_.upload(
      node_, object,
      [this, attempt = attempt_, done = std::move(done)](const Result<Bytes>& answer) {
        if (attempt == attempt_) done(answer);
      },
      master_.now());
  if (!begun) fail(begun.error());
}

void DriveNode::configure(std::vector<SdoWrite> writes, std::function<void(const Result<>&)> done) {
  const Result<> begun = master_.configure(
      node_, std::move(writes),
      [this, attempt = attempt_, done = std::move(done)](const Result<>& answer) {
        if (attempt == attempt_) done(answer);
      },
      master_.now());
  if (!begun) fail(begun.error());
}

/// A drive whose PDOs cannot be changed does, if they are as they should be.
void DriveNode::map(const canopen::PdoSettings& settings, std::function<void(const Result<>&)> done) {
  configure(canopen::pdo_writes(node_, settings), [this, settings, done = std::move(done)](const Result<>& mapped) {
    if (mapped || mapped.error().code.category() != canopen::sdo_category()) return done(mapped);
    configure(canopen::fixed_pdo_writes(node_, settings), [done, why = mapped.error()](const Result<>& fixed) {
      const bool refused = !fixed && fixed.error().code.category() == canopen::sdo_category();
      done(refused ? Result<>{why} : fixed);  // of both refusals the first says more
    });
  });
}

canopen::PdoSettings DriveNode::transmitted(int number, PdoMapping mapping) const {
  return {.direction = PdoDirection::transmit,
          .number = number,
          .inhibit_100us = static_cast<std::uint16_t>(10 * settings_.feedback.count()),
          .event_timer_ms = static_cast<std::uint16_t>(settings_.feedback.count()),
          .mapping = std::move(mapping)};
}

void DriveNode::enter(Step step) {
  step_ = step;
  const auto required = [this](Step next) {
    return [this, next](const Result<>& done) { done ? enter(next) : fail(done.error()); };
  };
  const auto optional = [this](std::string& why, Step next) {
    return [this, &why, next](const Result<>& done) {
      // A node that no longer answers is not one that lacks an object.
      if (!done && done.error().code.category() != canopen::sdo_category() &&
          done.error().code != std::errc::io_error) {
        return fail(done.error());
      }
      why = done ? std::string{} : reason(done.error());
      enter(next);
    };
  };
  switch (step) {
    case Step::resting:
      return;
    case Step::device_type:
      return read({0x1000, 0}, [this](const Result<Bytes>& type) {
        if (!type) {
          return fail(type.error().code == std::errc::timed_out
                          ? "does not answer: is it powered, are node id and bit rate right, is the bus terminated?"
                          : reason(type.error()));
        }
        const std::uint64_t profile = canopen::get_le(ByteView{*type}.first(std::min<std::size_t>(2, type->size())));
        if (profile != 402) return fail("is no drive: its device profile (1000:00) is " + std::to_string(profile));
        enter(Step::identity);
      });
    case Step::identity: {
      if (!settings_.vendor && !settings_.product) return enter(Step::target);
      const auto check = [this, attempt = attempt_](const Result<canopen::Identity>& identity) {
        if (attempt != attempt_) return;
        if (!identity) return fail(identity.error());
        const auto wrong = [&](const char* what, const std::optional<std::uint32_t>& wanted, std::uint32_t found) {
          if (!wanted || *wanted == found) return false;
          fail(std::string{"is another drive: "} + what + " 0x" + canopen::hex(found, 8) + ", expected 0x" +
               canopen::hex(*wanted, 8));
          return true;
        };
        if (wrong("vendor", settings_.vendor, identity->vendor)) return;
        if (wrong("product", settings_.product, identity->product)) return;
        enter(Step::target);
      };
      if (const Result<> begun = master_.identify(node_, check, master_.now()); !begun) fail(begun.error());
      return;
    }
    // Whatever it did before us: no speed, then no voltage, and only then out of operational.
    case Step::target: {
      SdoWrite no_speed = sdo_write<std::int32_t>({0x60FF, 0}, 0);
      no_speed.verify = false;
      // In another mode it may refuse, or keep what it has: without voltage it stops all the same, and the settings
      // have it once more.
      return configure({no_speed}, [this](const Result<>&) { enter(Step::rest); });
    }
    case Step::rest: {
      SdoWrite no_voltage = sdo_write<std::uint16_t>({0x6040, 0}, canopen::controlword::disable_voltage);
      no_voltage.verify = false;  // not every drive keeps it
      return configure({no_voltage}, [this](const Result<>& done) {
        if (!done) return fail(done.error());
        if (const Result<> sent = master_.command(canopen::NmtCommand::pre_operational, node_, master_.now()); !sent) {
          return fail(sent.error());
        }
        enter(Step::modes);
      });
    }
    case Step::modes:
      return read({0x6502, 0}, [this](const Result<Bytes>& modes) {
        // One that has this mode only need not list it (CiA 402-2, 8.3.4).
        if (!modes && modes.error().code == canopen::SdoAbort::no_object) return enter(Step::rated_current);
        if (!modes) return fail(modes.error());
        constexpr std::uint64_t profile_velocity = 4;
        if ((canopen::get_le(*modes) & profile_velocity) == 0) {
          return fail("has no profile velocity mode: 6502:00 is 0x" + canopen::hex(canopen::get_le(*modes), 8));
        }
        enter(Step::rated_current);
      });
    case Step::rated_current:
      return read({0x6075, 0}, [this](const Result<Bytes>& rated) {
        // Without it no current can be told, and nothing else is lost.
        const double rated_a =
            rated ? 1e-3 * static_cast<double>(canopen::get_le(*rated)) : std::numeric_limits<double>::quiet_NaN();
        readings_ = readings(settings_.profile, rated_a);
        reading_maps_.clear();
        reading_ = 0;
        enter(Step::settings);
      });
    case Step::settings: {
      std::vector<SdoWrite> writes = dcf_;
      for (SdoWrite& write : writes) write.only_if_different = true;
      std::ranges::move(settings_writes(settings_, node_), std::back_inserter(writes));
      return configure(std::move(writes), required(Step::mode_display));
    }
    case Step::mode_display:
      if (settings_.profile == Profile::sevcon) return enter(Step::producer);  // 6061 is something else there
      return read({0x6061, 0}, [this](const Result<Bytes>& mode) {
        if (mode && !mode->empty() && mode->front() != 3) {
          return fail("stays in mode " + std::to_string(static_cast<std::int8_t>(mode->front())) +
                      " (6061:00) instead of 3");
        }
        enter(Step::producer);
      });
    case Step::producer: {
      std::vector<SdoWrite> writes = canopen::heartbeat_writes(master_.options().id, producer_time, 0ms);
      return configure(std::move(writes), [this](const Result<>& done) {
        watched_ = bool{done};
        master_.watch(node_, {.heartbeat_timeout = watched_ ? Duration{silence} : Duration{}});
        enter(Step::consumer);
      });
    }
    case Step::consumer: {
      std::vector<SdoWrite> writes = canopen::heartbeat_writes(master_.options().id, 0ms, silence);
      for (SdoWrite& write : writes) write.only_if_different = true;
      return configure(std::move(writes), optional(no_consumer_, Step::option));
    }
    case Step::option:
      if (settings_.profile == Profile::sevcon) {
        // RPDO time-out: 2 inhibits the drive.
        return configure({sdo_write<std::uint8_t>({0x5902, 0}, 2)}, optional(no_option_, Step::command));
      }
      return configure({sdo_write<std::int16_t>({0x6007, 0}, 3)}, optional(no_option_, Step::option_readback));
    case Step::option_readback:
      if (no_option_.empty()) return enter(Step::deadline);
      return read({0x6007, 0}, [this](const Result<Bytes>& option) {
        // 1 is a fault, 2 no voltage: the drive may know only one of these.
        const std::uint64_t value = option && option->size() >= 2 ? canopen::get_le(ByteView{*option}.first(2)) : 0;
        if (1 <= value && value <= 3) no_option_.clear();
        enter(Step::deadline);
      });
    case Step::deadline:
      if (no_consumer_.empty()) return enter(Step::command);
      return configure({sdo_write<std::uint16_t>({0x1400, 5}, static_cast<std::uint16_t>(silence.count()))},
                       optional(no_deadline_, Step::command));
    case Step::command: {
      judge_guard();
      canopen::PdoSettings settings{.direction = PdoDirection::receive, .number = 1, .mapping = command_map_};
      return map(settings, required(Step::feedback));
    }
    case Step::feedback:
      return map(transmitted(1, feedback_map_), required(Step::position));
    case Step::position:
      if (!settings_.position) return enter(Step::readings);
      return map(transmitted(2, PdoMapping{{{0x6064, 0}, 32}}), required(Step::readings));
    case Step::readings: {
      if (reading_ == readings_.size()) return enter(Step::starting);
      std::vector<canopen::MappedObject> mapped;
      for (const Reading& reading : readings_[reading_]) mapped.push_back({reading.object, reading.bits});
      PdoMapping mapping{std::move(mapped)};
      return map(transmitted(3 + static_cast<int>(reading_), mapping), [this, mapping](const Result<>& done) {
        // Not every drive measures this: nothing is taken from a PDO that has, or may have, something else.
        reading_maps_.push_back(mapping);
        if (!done) {
          readings_[reading_].clear();
          events_.tell(0, title() + ": does not tell all that it measures: " + reason(done.error()));
        }
        ++reading_;
        enter(Step::readings);
      });
    }
    case Step::starting:
      due_ = master_.now() + patience;
      if (const Result<> sent = master_.command(canopen::NmtCommand::start, node_, master_.now()); !sent) {
        return fail(sent.error());
      }
      return;
    case Step::up:
      due_ = Time::max();
      failed_.clear();
      events_.tell(0, title() + ": up, " + canopen::to_string(*state_));
      return;
  }
}

/// Whether it would stop without us, and if not, why.
void DriveNode::judge_guard() {
  if (settings_.profile == Profile::sevcon) {
    if (no_option_.empty() || no_consumer_.empty()) return;
    unguarded_ = title() + " would go on driving when this server dies: it takes neither 5902 (" + no_option_ +
                 ") nor 1016 (" + no_consumer_ + ")";
    return;
  }
  if (no_option_.empty() && (no_consumer_.empty() || no_deadline_.empty())) return;
  unguarded_ = title() + " would go on driving when this server dies: ";
  if (!no_option_.empty()) {
    unguarded_ += "6007 says that it does nothing then, and cannot be set (" + no_option_ + ")";
  } else {
    unguarded_ += "it takes neither 1016 (" + no_consumer_ + ") nor 1400:05 (" + no_deadline_ + ")";
  }
}

// --- up --------------------------------------------------------------------------------------------------------------

void DriveNode::on_feedback(ByteView bytes, Time now) {
  if (bytes.size() < feedback_map_.size_bytes()) return;
  const auto statusword = static_cast<std::uint16_t>(feedback_map_.get(bytes, 0));
  const auto state = canopen::cia402_state(statusword);
  const auto velocity = static_cast<std::int32_t>(feedback_map_.get_signed(bytes, 1));
  if (heard_) way_ += seconds(now - *heard_) * (static_cast<double>(velocity_) + velocity) / 2;
  heard_ = now;
  velocity_ = velocity;
  const auto before = std::exchange(state_, state);
  if (!settings_.position) fresh_ = true;
  const bool tested = state_ && state_ != Cia402State::not_ready_to_switch_on;
  // A PDO comes in operational only; without a heartbeat nothing else says that it is.
  const bool started = !watched_ || master_.monitor(node_).state() != canopen::NmtState::pre_operational;
  if (step_ == Step::starting && tested && started) {
    enter(Step::up);
  }
  if (step_ != Step::up || before == state_) return;
  if (wanted_) {
    const bool left = before == Cia402State::operation_enabled;
    const bool is_fault = state_ == Cia402State::fault || state_ == Cia402State::fault_reaction_active;
    if (before == Cia402State::fault) may_reset_ = false;
    if (left || (is_fault && !may_reset_)) {
      return events_.trouble(title() + ": " + (state_ ? canopen::to_string(*state_) : "no state of CiA 402"));
    }
  }
  send(now);  // the next step at once
}

void DriveNode::want(bool enabled) {
  wanted_ = enabled;
  may_reset_ = enabled && state_ == Cia402State::fault;
  target_ = 0;
}

void DriveNode::send(Time now) {
  if (step_ != Step::up) return;
  std::uint16_t control = state_ ? canopen::towards_rest(*state_) : canopen::controlword::quick_stop;
  if (wanted_ && state_) {
    control = state_ == Cia402State::fault && may_reset_ ? canopen::controlword::fault_reset
                                                         : canopen::towards_operation(*state_);
  }
  const bool drives = wanted_ && state_ == Cia402State::operation_enabled;
  std::array<std::uint8_t, 8> bytes{};
  command_map_.set(bytes, 0, control);
  command_map_.set(bytes, 1, static_cast<std::uint64_t>(std::int64_t{drives ? target_ : 0}));
  if (settings_.profile == Profile::sevcon) command_map_.set(bytes, 2, settings_.max_torque_permille);
  (void)master_.send_pdo(command_, bytes, now);  // without a bus the driver fails anyway
}

void DriveNode::on_node(NodeMonitor::Event event, Time now) {
  const bool was_up = step_ == Step::up;
  switch (event) {
    case NodeMonitor::Event::none:
      return;
    case NodeMonitor::Event::boot_up:
      begin(now);
      if (was_up) events_.trouble(title() + ": boot-up message, its power was gone");
      return;
    case NodeMonitor::Event::lost:
      if (!was_up) return;
      return lose("heartbeat lost for " + std::to_string(silence.count()) + " ms");
    case NodeMonitor::Event::state_changed:
      if (!was_up || master_.monitor(node_).state() == canopen::NmtState::operational) return;
      // It takes no PDOs any more.
      (void)master_.download(
          node_, {0x6040, 0}, canopen::le_bytes(canopen::controlword::quick_stop, 2), [](const Result<Bytes>&) {}, now);
      return lose("became " + canopen::to_string(*master_.monitor(node_).state()));
    case NodeMonitor::Event::back:
      if (step_ == Step::resting) due_ = now;
      return;
  }
}

void DriveNode::on_emcy(const canopen::Emcy& emcy) {
  if (emcy.code == 0) return;
  std::string text = title() + ": " + canopen::to_string(emcy);
  bool is_warning = false;
  if (settings_.profile == Profile::sevcon) {
    const std::uint16_t fault = sevcon_fault(emcy.more);
    const std::string name = sevcon_fault_text(fault);
    text = title() + ": EMCY fault 0x" + canopen::hex(fault, 4) + (name.empty() ? "" : " " + name);
    is_warning = fault < 0x4800;
    if (emcy.more[2] == 0 && emcy.more[3] == 0 && emcy.more[4] == 0) return;  // it is gone
  }
  is_warning || step_ != Step::up ? events_.tell(1, text) : events_.trouble(text);
}

/// A node that is gone is told by its heartbeat, if it has one; this is for one that only tells no more.
Duration DriveNode::feedback_limit() const { return watched_ ? silence + producer_time : silence; }

void DriveNode::on_time(Time now) {
  if (step_ == Step::up) {
    if (heard_ && now - *heard_ > feedback_limit()) {
      lose("no feedback for " + std::to_string(feedback_limit() / 1ms) + " ms");
    }
    return;
  }
  if (now < due_) return;
  if (step_ == Step::starting) {
    if (const auto state = master_.monitor(node_).state(); watched_ && state && *state != NmtState::operational) {
      return fail("was started and stays " + canopen::to_string(*state) + ": its error register 1001 may say why");
    }
    return fail("was started and tells nothing: its PDO 0x" + canopen::hex(0x180U + node_, 3) + " does not come");
  }
  begin(now);
}

Time DriveNode::next_wake() const {
  if (step_ == Step::up) return heard_ ? *heard_ + feedback_limit() + 1ns : Time::max();
  return due_;
}

std::string DriveNode::describe() const {
  constexpr std::array awaited{"",
                               "an answer to 1000",
                               "its identity, 1018",
                               "standstill, 60FF",
                               "standstill, 6040",
                               "its modes, 6502",
                               "6075",
                               "its settings",
                               "its mode, 6061",
                               "1017",
                               "1016",
                               "what stops it without us",
                               "6007",
                               "1400:05",
                               "set-points, 1400 and 1600",
                               "feedback, 1800 and 1A00",
                               "position, 1801 and 1A01",
                               "measurements, 1802 and on",
                               "its start"};
  if (step_ == Step::resting) return failed_.empty() ? "not asked yet" : failed_;
  if (step_ != Step::up) {
    return std::string{"waits for "} + awaited[static_cast<std::size_t>(step_)] +
           (failed_.empty() ? "" : ", after it failed: " + failed_);
  }
  return state_ ? canopen::to_string(*state_) : "no state of CiA 402";
}

}  // namespace regista::can_motor
