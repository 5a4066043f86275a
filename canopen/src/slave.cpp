// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/canopen/slave.hpp>

namespace regista::canopen {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr std::uint32_t off = 0x80000000;
constexpr std::uint32_t no_remote = 0x40000000;
constexpr std::size_t most_waiting = 64;
constexpr Duration retry = microseconds{500};

bool is_mapping(std::uint16_t index) {
  return (0x1600 <= index && index < 0x1800) || (0x1A00 <= index && index < 0x1C00);
}
bool is_pdo(std::uint16_t index) { return 0x1400 <= index && index < 0x1C00; }

Identity identity_of(const ObjectDictionary& dictionary) {
  const auto part = [&](std::uint8_t sub) {
    const ObjectEntry* entry = dictionary.find({0x1018, sub});
    return entry == nullptr || entry->value.size() > 8 ? 0U : static_cast<std::uint32_t>(get_le(entry->value));
  };
  return {part(1), part(2), part(3), part(4)};
}

std::int64_t number_of(const ObjectEntry& entry, ByteView data) {
  const std::uint64_t value = get_le(data);
  if (!is_signed(entry.type)) return static_cast<std::int64_t>(value);
  const std::uint64_t sign = 1ULL << (8 * data.size() - 1);
  return static_cast<std::int64_t>((value ^ sign) - sign);
}

}  // namespace

Slave::Slave(CanBus& bus, NodeId node, ObjectDictionary dictionary, Events events, const SdoServer::Options& sdo)
    : bus_{bus},
      node_{node},
      dictionary_{std::move(dictionary)},
      pristine_{dictionary_},
      events_{std::move(events)},
      sdo_options_{sdo},
      lss_{identity_of(dictionary_), node} {}

// --- the dictionary --------------------------------------------------------------------------------------------------

std::uint64_t Slave::get(ObjectIndex object) const {
  const ObjectEntry* entry = dictionary_.find(object);
  return entry == nullptr || entry->value.size() > 8 ? 0 : get_le(entry->value);
}

void Slave::set(ObjectIndex object, std::uint64_t value) {
  const auto found = dictionary_.objects.find(object);
  if (found == dictionary_.objects.end()) return;
  Bytes& bytes = found->second.value;
  for (std::size_t i = 0; i < bytes.size(); ++i)
    bytes[i] = i < 8 ? static_cast<std::uint8_t>(value >> (8 * i)) : std::uint8_t{0};
}

void Slave::set_bytes(ObjectIndex object, ByteView bytes) {
  const auto found = dictionary_.objects.find(object);
  if (found != dictionary_.objects.end()) found->second.value.assign(bytes.begin(), bytes.end());
}

Result<Bytes> Slave::read_object(ObjectIndex object) {
  const ObjectEntry* entry = dictionary_.find(object);
  if (entry == nullptr) {
    const auto at = dictionary_.objects.lower_bound({object.index, 0});
    const bool other_subs = at != dictionary_.objects.end() && at->first.index == object.index;
    return Error{other_subs ? SdoAbort::no_subindex : SdoAbort::no_object, ""};
  }
  if (!entry->readable()) return Error{SdoAbort::write_only, ""};
  if (events_.reading) events_.reading(object);
  return entry->value;
}

Result<> Slave::write_object(ObjectIndex object, ByteView data) {
  if (const auto refused = change(object, data)) return Error{*refused, ""};
  return {};
}

std::size_t Slave::short_size(ObjectIndex object) const {
  const ObjectEntry* entry = dictionary_.find(object);
  const std::size_t size = entry == nullptr ? 0 : size_of(entry->type);
  return 1 <= size && size <= 4 ? size : 4;
}

/// A write from outside.
std::optional<SdoAbort> Slave::change(ObjectIndex object, ByteView data) {
  const auto found = dictionary_.objects.find(object);
  if (found == dictionary_.objects.end()) {
    return read_object(object).error().code == SdoAbort::no_subindex ? SdoAbort::no_subindex : SdoAbort::no_object;
  }
  ObjectEntry& entry = found->second;
  if (!entry.writable()) return SdoAbort::read_only;
  if (const std::size_t size = size_of(entry.type); size != 0 && data.size() != size) {
    return data.size() > size ? SdoAbort::too_long : SdoAbort::too_short;
  }
  if (entry.low && number_of(entry, data) < *entry.low) return SdoAbort::value_too_low;
  if (entry.high && number_of(entry, data) > *entry.high) return SdoAbort::value_too_high;
  if (const auto refused = check_mapping(object, data)) return refused;
  // CiA 301, 7.5.2.6: only 0, which erases the history.
  if (object == ObjectIndex{0x1003, 0} && data[0] != 0) return SdoAbort::value;
  Bytes before(data.begin(), data.end());
  before.swap(entry.value);
  if (events_.written) {
    if (const auto refused = events_.written(object, data)) {
      entry.value = std::move(before);
      return refused;
    }
  }
  if (is_pdo(object.index)) reload_ = true;
  if (object.index == 0x1016) load_consumers();
  if (object.index == 0x1017) heartbeat_at_ = now_;
  return {};
}

/// CiA 301, 7.5.2.36: a mapping is changed while its PDO does not exist, its entries while their number is 0.
std::optional<SdoAbort> Slave::check_mapping(ObjectIndex object, ByteView data) const {
  if (!is_mapping(object.index) || data.size() > 8) return {};
  const auto parameters = static_cast<std::uint16_t>(object.index - 0x0200);
  if ((get({parameters, 1}) & off) == 0) return SdoAbort::unsupported_access;
  const std::uint64_t value = get_le(data);
  if (object.sub != 0) return get({object.index, 0}) != 0 ? std::optional{SdoAbort::unsupported_access} : std::nullopt;
  unsigned bits = 0;
  for (std::uint64_t i = 1; i <= value; ++i) {
    const auto code = static_cast<std::uint32_t>(get({object.index, static_cast<std::uint8_t>(i)}));
    const MappedObject mapped = MappedObject::from_code(code);
    const bool is_dummy = mapped.object.index < 0x20;  // CiA 301, 7.4.7.1: fills a gap
    const ObjectEntry* entry = dictionary_.find(mapped.object);
    if (!is_dummy && entry == nullptr) return SdoAbort::no_object;
    if (!is_dummy && (!entry->mappable || mapped.bits > 8 * entry->value.size())) return SdoAbort::not_mappable;
    bits += mapped.bits;
    if (mapped.bits == 0 || bits > 64) return SdoAbort::pdo_length;
  }
  return {};
}

// --- states ----------------------------------------------------------------------------------------------------------

void Slave::power_on(Time now) {
  now_ = now;
  powered_ = true;
  reset(true, now);
}

void Slave::reset(bool application, Time now) {
  if (application) {
    dictionary_ = pristine_;
  } else {
    for (const auto& [object, entry] : pristine_.objects) {
      if (0x1000 <= object.index && object.index < 0x2000) dictionary_.objects[object] = entry;
    }
  }
  out_.clear();
  guard_toggle_ = false;
  receive_.clear();
  transmit_.clear();
  heartbeat_at_ = Time::max();
  lss_.reset();
  node_ = lss_.node();
  sdo_.reset();
  if (node_ == lss_unconfigured) {
    state_ = NmtState::boot_up;
    return;
  }
  sdo_.emplace(node_, static_cast<SdoObjects&>(*this), sdo_options_);
  send(make_frame(heartbeat_id + node_, {0}));
  heartbeat_at_ = now;
  load_consumers();
  enter(NmtState::pre_operational, now);
}

void Slave::enter(NmtState state, Time now) {
  if (state == state_) return;
  state_ = state;
  if (state == NmtState::operational) load_pdos(now);
  if (events_.state) events_.state(state);
}

void Slave::load_consumers() {
  consumers_.clear();
  for (std::uint64_t sub = 1; sub <= std::min<std::uint64_t>(get({0x1016, 0}), 0x7F); ++sub) {
    const std::uint64_t value = get({0x1016, static_cast<std::uint8_t>(sub)});
    const auto node = static_cast<NodeId>(value >> 16 & 0x7FU);
    const milliseconds time{value & 0xFFFFU};
    if (node != 0 && time.count() != 0) consumers_.push_back({node, time});
  }
}

void Slave::load_pdos(Time now) {
  reload_ = false;
  receive_.clear();
  transmit_.clear();
  const auto load = [&](std::uint16_t first, std::vector<Pdo>& pdos) {
    for (auto at = dictionary_.objects.lower_bound({first, 1});
         at != dictionary_.objects.end() && at->first.index < first + 0x200; ++at) {
      if (at->first.sub != 1) continue;
      const std::uint16_t parameters = at->first.index;
      const auto mapping = static_cast<std::uint16_t>(parameters + 0x200);
      const std::uint64_t cob_id = get({parameters, 1});
      if ((cob_id & off) != 0) continue;
      std::vector<MappedObject> mapped;
      unsigned bits = 0;
      for (std::uint64_t sub = 1; sub <= std::min<std::uint64_t>(get({mapping, 0}), 64); ++sub) {
        const std::uint64_t code = get({mapping, static_cast<std::uint8_t>(sub)});
        const auto object = MappedObject::from_code(static_cast<std::uint32_t>(code));
        bits += object.bits;
        if (object.bits == 0 || bits > 64) break;
        mapped.push_back(object);
      }
      Pdo pdo{.cob_id = static_cast<std::uint32_t>(cob_id & 0x7FFU),
              .transmission = static_cast<std::uint8_t>(get({parameters, 2})),
              .remote_allowed = (cob_id & no_remote) == 0,
              .inhibit = microseconds{100 * get({parameters, 3})},
              .event_timer = milliseconds{get({parameters, 5})},
              .mapping = PdoMapping{std::move(mapped)}};
      if (first == 0x1800 && pdo.event_timer > Duration::zero()) pdo.due = now;
      pdos.push_back(std::move(pdo));
    }
  };
  load(0x1400, receive_);
  load(0x1800, transmit_);
}

void Slave::emergency(const Emcy& emcy, Time now) {
  set({0x1001, 0}, emcy.code == 0 ? 0 : emcy.error_register);
  if (emcy.code != 0) {
    const auto last = static_cast<std::uint8_t>(
        std::count_if(dictionary_.objects.begin(), dictionary_.objects.end(),
                      [](const auto& object) { return object.first.index == 0x1003 && object.first.sub > 0; }));
    for (std::uint8_t sub = last; sub > 1; --sub) set({0x1003, sub}, get({0x1003, static_cast<std::uint8_t>(sub - 1)}));
    set({0x1003, 1}, emcy.code);
    set({0x1003, 0}, std::min<std::uint64_t>(get({0x1003, 0}) + 1, last));
  }
  if ((get({0x1014, 0}) & off) != 0 || state_ == NmtState::boot_up) return;
  send(emcy.encode(node_));
  flush(now);
}

// --- in --------------------------------------------------------------------------------------------------------------

void Slave::on_frame(const CanFrame& frame, Time now) {
  now_ = now;
  if (!powered_) power_on(now);
  if (frame.error || frame.extended) return;
  if (const auto answer = lss_.on_frame(frame)) send(*answer);
  if (lss_.node() != node_) reset(false, now);
  if (frame.id == nmt_id && !frame.remote) {
    on_nmt(frame, now);
  } else if (state_ == NmtState::boot_up) {
    // waits for a node id
  } else if (frame.id == heartbeat_id + node_ && frame.remote) {
    send(make_frame(heartbeat_id + node_,
                    {static_cast<std::uint8_t>(static_cast<unsigned>(state_) | (guard_toggle_ ? 0x80U : 0U))}));
    guard_toggle_ = !guard_toggle_;
  } else if (frame.remote) {
    for (Pdo& pdo : transmit_) {
      if (state_ == NmtState::operational && pdo.cob_id == frame.id && pdo.remote_allowed) transmit(pdo, now);
    }
  } else if (frame.id == 0x600U + node_) {
    if (state_ != NmtState::stopped) sdo_->on_frame(frame, now);
  } else if (frame.id == sync_id) {
    if (state_ == NmtState::operational) on_sync(now);
  } else {
    for (Consumer& consumer : consumers_) {
      if (frame.id == heartbeat_id + consumer.node && frame.size == 1 && frame.data[0] != 0) {
        consumer.due = now + consumer.time;
      }
    }
    for (Pdo& pdo : receive_) {
      if (state_ != NmtState::operational || pdo.cob_id != frame.id) continue;
      if (frame.size < pdo.mapping.size_bytes()) {
        emergency({.code = 0x8210, .error_register = 0x11}, now);
        continue;
      }
      pdo.bytes = frame.data;
      if (pdo.event_timer > Duration::zero()) pdo.due = now + pdo.event_timer;
      if (pdo.transmission <= 240) {
        pdo.pending = true;
      } else {
        apply(pdo);
      }
    }
  }
  flush(now);
}

void Slave::on_nmt(const CanFrame& frame, Time now) {
  if (frame.size < 2 || (frame.data[1] != 0 && frame.data[1] != node_) || node_ == lss_unconfigured) return;
  switch (static_cast<NmtCommand>(frame.data[0])) {
    case NmtCommand::start:
      return enter(NmtState::operational, now);
    case NmtCommand::stop:
      return enter(NmtState::stopped, now);
    case NmtCommand::pre_operational:
      return enter(NmtState::pre_operational, now);
    case NmtCommand::reset_node:
      return reset(true, now);
    case NmtCommand::reset_communication:
      return reset(false, now);
  }
}

void Slave::apply(Pdo& pdo) {
  pdo.pending = false;
  const auto objects = pdo.mapping.objects();
  for (std::size_t i = 0; i < objects.size(); ++i) {
    if (objects[i].object.index < 0x20) continue;
    const std::uint64_t value = pdo.mapping.get(pdo.bytes, i);
    const ObjectEntry* entry = dictionary_.find(objects[i].object);
    if (entry != nullptr && entry->value.size() <= 8)
      (void)change(objects[i].object, le_bytes(value, entry->value.size()));
  }
}

void Slave::on_sync(Time now) {
  for (Pdo& pdo : receive_) {
    if (pdo.pending) apply(pdo);
  }
  for (Pdo& pdo : transmit_) {
    if (pdo.transmission > 240) continue;
    const bool is_due = pdo.transmission == 0 ? !pdo.sent || packed(pdo) != pdo.bytes : ++pdo.syncs >= pdo.transmission;
    if (is_due) {
      pdo.syncs = 0;
      transmit(pdo, now);
    }
  }
}

void Slave::on_time(Time now) {
  now_ = now;
  if (!powered_) power_on(now);
  if (reload_) load_pdos(now);
  if (sdo_) sdo_->on_time(now);
  const milliseconds beat{get({0x1017, 0})};
  if (beat.count() != 0 && now >= heartbeat_at_) {
    send(make_frame(heartbeat_id + node_, {static_cast<std::uint8_t>(state_)}));
    heartbeat_at_ = now + beat;
  } else if (beat.count() == 0) {
    heartbeat_at_ = Time::max();
  }
  for (Consumer& consumer : consumers_) {
    if (!consumer.due || now < *consumer.due) continue;
    consumer.due.reset();
    emergency({.code = 0x8130, .error_register = 0x11}, now);
    if (events_.silent) events_.silent(0x8130);
  }
  if (state_ == NmtState::operational) {
    for (Pdo& pdo : receive_) {
      if (!pdo.due || now < *pdo.due) continue;
      pdo.due.reset();
      emergency({.code = 0x8250, .error_register = 0x11}, now);
      if (events_.silent) events_.silent(0x8250);
    }
    for (Pdo& pdo : transmit_) {
      if (pdo.transmission < 254 || now < pdo.inhibited_until) continue;
      const bool timed = pdo.due && now >= *pdo.due;
      if (timed || packed(pdo) != pdo.bytes || !pdo.sent) transmit(pdo, now);
    }
  }
  flush(now);
}

Time Slave::next_wake() const {
  Time next = std::min(heartbeat_at_, retry_at_);
  if (!powered_ || reload_) return Time::min();
  if (sdo_) next = std::min(next, sdo_->next_wake());
  for (const Consumer& consumer : consumers_) next = std::min(next, consumer.due.value_or(Time::max()));
  if (state_ == NmtState::operational) {
    for (const Pdo& pdo : receive_) next = std::min(next, pdo.due.value_or(Time::max()));
    for (const Pdo& pdo : transmit_) {
      if (pdo.transmission >= 254 && pdo.due) next = std::min(next, std::max(*pdo.due, pdo.inhibited_until));
    }
  }
  return next;
}

// --- out -------------------------------------------------------------------------------------------------------------

std::array<std::uint8_t, 8> Slave::packed(const Pdo& pdo) {
  std::array<std::uint8_t, 8> bytes{};
  const auto objects = pdo.mapping.objects();
  for (std::size_t i = 0; i < objects.size(); ++i) {
    if (objects[i].object.index < 0x20) continue;
    if (events_.reading) events_.reading(objects[i].object);
    pdo.mapping.set(bytes, i, get(objects[i].object));
  }
  return bytes;
}

void Slave::transmit(Pdo& pdo, Time now) {
  pdo.bytes = packed(pdo);
  pdo.sent = true;
  if (pdo.event_timer > Duration::zero()) pdo.due = now + pdo.event_timer;
  pdo.inhibited_until = now + pdo.inhibit;
  CanFrame frame{.id = pdo.cob_id, .size = pdo.mapping.size_bytes(), .data = pdo.bytes};
  send(frame);
}

void Slave::send(const CanFrame& frame) {
  if (out_.size() < most_waiting) out_.push_back(frame);
}

void Slave::flush(Time now) {
  retry_at_ = Time::max();
  while (!out_.empty() && bus_.send(out_.front())) out_.pop_front();
  while (out_.empty() && sdo_ && sdo_->front() != nullptr && bus_.send(*sdo_->front())) sdo_->pop(now);
  if (!out_.empty() || (sdo_ && sdo_->front() != nullptr)) retry_at_ = now + retry;
}

}  // namespace regista::canopen
