// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cassert>
#include <regista/canopen/lss.hpp>

// Command specifiers of CiA 305.

namespace regista::canopen {
namespace {

enum : std::uint8_t {
  switch_global = 0x04,
  configure_node_id = 0x11,
  configure_bit_timing = 0x13,
  activate_bit_timing = 0x15,
  store_configuration = 0x17,
  select_vendor = 0x40,  // and product, revision, serial number after it
  selected = 0x44,
  identify_vendor = 0x46,  // and product, revision and serial number from and to after it
  identify_unconfigured = 0x4C,
  identify_slave = 0x4F,
  unconfigured_slave = 0x50,
  scan = 0x51,
  inquire_vendor = 0x5A,  // and product, revision, serial number after it
  inquire_id = 0x5E,
};
constexpr std::uint8_t scan_begin = 0x80;

constexpr std::array bit_rates = {1'000'000, 800'000, 500'000, 250'000, 125'000, 0, 50'000, 20'000, 10'000};

CanFrame request(std::uint8_t command, std::uint32_t word = 0, std::array<std::uint8_t, 3> rest = {}) {
  return make_frame(lss_master_id, {command, static_cast<std::uint8_t>(word), static_cast<std::uint8_t>(word >> 8),
                                    static_cast<std::uint8_t>(word >> 16), static_cast<std::uint8_t>(word >> 24),
                                    rest[0], rest[1], rest[2]});
}

std::array<std::uint32_t, 4> parts(const Identity& identity) {
  return {identity.vendor, identity.product, identity.revision, identity.serial};
}

std::uint32_t word_of(const CanFrame& frame) {
  return static_cast<std::uint32_t>(get_le(ByteView{frame.data}.subspan(1, 4)));
}

LssMaster::Word without_value(LssMaster::Done done) {
  return [done = std::move(done)](const Result<std::uint32_t>& result) {
    done(result ? Result<>{} : Result<>{result.error()});
  };
}

}  // namespace

std::string to_string(const Identity& identity) {
  return "vendor 0x" + hex(identity.vendor, 8) + " product 0x" + hex(identity.product, 8) + " revision 0x" +
         hex(identity.revision, 8) + " serial 0x" + hex(identity.serial, 8);
}

void LssMaster::begin(State state, std::vector<CanFrame> frames, std::uint8_t expected, Word done, Time now) {
  assert(!busy());
  state_ = state;
  out_ = std::move(frames);
  next_ = 0;
  expected_ = expected;
  done_ = std::move(done);
  deadline_ = now + options_.timeout;
}

void LssMaster::select(const Identity& identity, Done done, Time now) {
  std::vector<CanFrame> frames;
  std::uint8_t command = select_vendor;
  for (const std::uint32_t part : parts(identity)) frames.push_back(request(command++, part));
  begin(State::answer, std::move(frames), selected, without_value(std::move(done)), now);
}

void LssMaster::switch_all(bool configuration, Done done, Time now) {
  begin(State::sending, {request(switch_global, configuration ? 1 : 0)}, 0, without_value(std::move(done)), now);
}

void LssMaster::set_node_id(NodeId node, Done done, Time now) {
  begin(State::answer, {request(configure_node_id, node)}, configure_node_id, without_value(std::move(done)), now);
}

void LssMaster::set_bit_rate(int bit_rate, Done done, Time now) {
  const auto found = std::ranges::find(bit_rates, bit_rate);
  if (bit_rate == 0 || found == bit_rates.end()) {
    return done(Error{std::errc::invalid_argument, "LSS: no bit rate of CiA 305: " + std::to_string(bit_rate)});
  }
  const auto index = static_cast<std::uint32_t>(found - bit_rates.begin());
  begin(State::answer, {request(configure_bit_timing, index << 8)}, configure_bit_timing,
        without_value(std::move(done)), now);
}

void LssMaster::activate_bit_rate(std::chrono::milliseconds delay, Done done, Time now) {
  begin(State::sending, {request(activate_bit_timing, static_cast<std::uint16_t>(delay.count()))}, 0,
        without_value(std::move(done)), now);
}

void LssMaster::store(Done done, Time now) {
  begin(State::answer, {request(store_configuration)}, store_configuration, without_value(std::move(done)), now);
}

void LssMaster::inquire_node_id(Word id, Time now) {
  begin(State::answer, {request(inquire_id)}, inquire_id, std::move(id), now);
}

void LssMaster::inquire(std::uint8_t command, Word value, Time now) {
  assert(inquire_vendor <= command && command < inquire_id);
  begin(State::answer, {request(command)}, command, std::move(value), now);
}

void LssMaster::fast_scan(Found found, Time now) {
  found_ = std::move(found);
  scanned_ = {};
  part_ = 0;
  bit_ = scan_begin;
  present_ = false;
  begin(State::fast_scan, {}, identify_slave, {}, now);
  ask(now);
}

void LssMaster::ask(Time now) {
  answered_ = false;
  // The last question about a part names the next: it moves on whoever has exactly these bits.
  const bool confirm = bit_ < 0;
  const auto bit = static_cast<std::uint8_t>(confirm ? 0 : bit_);
  const auto following = static_cast<std::uint8_t>(confirm ? (part_ + 1) % 4 : part_);
  out_ = {request(scan, scanned_[part_], {bit, part_, following})};
  next_ = 0;
  deadline_ = now + options_.timeout;
}

void LssMaster::scan_step(bool answered, Time now) {
  if (bit_ == int{scan_begin}) {
    if (!answered) return finish(std::uint32_t{});
    bit_ = 31;
  } else if (bit_ >= 0) {
    if (!answered) scanned_[part_] |= 1U << bit_;
    --bit_;
  } else if (!answered) {
    return finish(Error{std::errc::protocol_error, "LSS fast scan: the node stopped to answer at part " +
                                                       std::to_string(part_) + " 0x" + hex(scanned_[part_], 8)});
  } else if (part_ == 3) {
    present_ = true;
    return finish(std::uint32_t{});
  } else {
    ++part_;
    bit_ = 31;
  }
  ask(now);
}

void LssMaster::finish(Result<std::uint32_t> result) {
  const State state = std::exchange(state_, State::idle);
  deadline_ = Time::max();
  out_.clear();
  next_ = 0;
  if (state == State::fast_scan) {
    const Found found = std::exchange(found_, nullptr);
    if (!result) return found(result.error());
    if (!present_) return found(std::optional<Identity>{});
    return found(std::optional{Identity{scanned_[0], scanned_[1], scanned_[2], scanned_[3]}});
  }
  const Word done = std::exchange(done_, nullptr);
  done(std::move(result));
}

void LssMaster::pop(Time now) {
  ++next_;
  deadline_ = now + options_.timeout;
  if (next_ == out_.size() && state_ == State::sending) finish(std::uint32_t{});
}

void LssMaster::on_frame(const CanFrame& frame, Time now) {
  if (frame.id != lss_slave_id || frame.extended || frame.remote || frame.error || frame.size != 8) return;
  if ((state_ != State::answer && state_ != State::fast_scan) || front() != nullptr || frame.data[0] != expected_)
    return;
  if (state_ == State::fast_scan) {
    answered_ = true;  // others may still answer: the time is waited for
    return;
  }
  (void)now;
  const bool may_refuse =
      expected_ == configure_node_id || expected_ == configure_bit_timing || expected_ == store_configuration;
  if (may_refuse && frame.data[1] != 0) {
    const char* what = expected_ == configure_node_id      ? "node id out of range"
                       : expected_ == configure_bit_timing ? "bit rate not supported"
                       : frame.data[1] == 1                ? "storing not supported"
                                                           : "storage not accessible";
    return finish(Error{std::errc::operation_not_supported, std::string{"LSS: "} + what + ", error " +
                                                                std::to_string(frame.data[1]) + "/" +
                                                                std::to_string(frame.data[2])});
  }
  finish(expected_ == inquire_id ? std::uint32_t{frame.data[1]} : word_of(frame));
}

void LssMaster::on_time(Time now) {
  if (state_ == State::idle || now < deadline_) return;
  if (state_ == State::fast_scan && front() == nullptr) return scan_step(answered_, now);
  finish(Error{std::errc::timed_out, front() != nullptr ? "LSS: the bus takes no frames" : "LSS: no answer"});
}

// --- slave -----------------------------------------------------------------------------------------------------------

std::optional<CanFrame> LssSlave::on_frame(const CanFrame& frame) {
  if (frame.id != lss_master_id || frame.extended || frame.remote || frame.error || frame.size != 8) return {};
  const auto answer = [](std::uint8_t command, std::uint32_t word = 0) {
    CanFrame reply = request(command, word);
    reply.id = lss_slave_id;
    return reply;
  };
  const std::uint8_t command = frame.data[0];
  if (command == switch_global) {
    configuring_ = frame.data[1] == 1;
    // Whoever has a node id keeps it until the next reset.
    if (!configuring_ && node_ == lss_unconfigured) node_ = pending_;
    return {};
  }
  if (command == scan) return on_fast_scan(frame);
  if (command == identify_unconfigured) {
    if (node_ != lss_unconfigured || pending_ != lss_unconfigured) return {};
    return answer(unconfigured_slave);
  }
  if (identify_vendor <= command && command < identify_unconfigured) {
    const int limit = command - identify_vendor;
    if (limit != 0 && limit != identified_) return {};
    identified_ = is_within(limit, word_of(frame)) ? limit + 1 : 0;
    if (identified_ < 6) return {};
    identified_ = 0;
    return answer(identify_slave);
  }
  if (select_vendor <= command && command < selected) {
    const int part = command - select_vendor;
    const bool fits =
        (part == 0 || part == selected_) && word_of(frame) == parts(identity_)[static_cast<std::size_t>(part)];
    selected_ = fits ? part + 1 : 0;
    if (selected_ < 4) return {};
    selected_ = 0;
    configuring_ = true;
    return answer(selected);
  }
  if (!configuring_) return {};
  if (inquire_vendor <= command && command < inquire_id) {
    return answer(command, parts(identity_)[static_cast<std::size_t>(command - inquire_vendor)]);
  }
  switch (command) {
    case inquire_id:
      return answer(command, node_);
    case configure_node_id: {
      const NodeId wanted = frame.data[1];
      const bool good = (first_node <= wanted && wanted <= last_node) || wanted == lss_unconfigured;
      if (good) pending_ = wanted;
      return answer(command, good ? 0 : 1);
    }
    case configure_bit_timing: {
      const std::uint8_t index = frame.data[2];
      const bool good = frame.data[1] == 0 && index < bit_rates.size() && bit_rates[index] != 0;
      if (good) bit_timing_ = index;
      return answer(command, good ? 0 : 1);
    }
    case store_configuration:
      return answer(command);
    default:
      return {};
  }
}

void LssSlave::reset() {
  node_ = pending_;
  configuring_ = false;
  selected_ = identified_ = 0;
}

/// Vendor, product, revision from and to, serial number from and to.
bool LssSlave::is_within(int limit, std::uint32_t value) const {
  switch (limit) {
    case 0:
      return identity_.vendor == value;
    case 1:
      return identity_.product == value;
    case 2:
      return identity_.revision >= value;
    case 3:
      return identity_.revision <= value;
    case 4:
      return identity_.serial >= value;
    default:
      return identity_.serial <= value;
  }
}

std::optional<CanFrame> LssSlave::on_fast_scan(const CanFrame& frame) {
  if (configuring_ || node_ != lss_unconfigured) return {};
  const std::uint8_t bit = frame.data[5];
  const std::uint8_t part = frame.data[6];
  const std::uint8_t following = frame.data[7];
  CanFrame reply = request(identify_slave);
  reply.id = lss_slave_id;
  if (bit == scan_begin) {
    scan_ = 0;
    return reply;
  }
  if (part != scan_ || part > 3 || bit > 31) return {};
  if ((word_of(frame) ^ parts(identity_)[part]) >> bit != 0) return {};
  scan_ = following;
  if (bit == 0 && following < part) configuring_ = true;
  return reply;
}

}  // namespace regista::canopen
