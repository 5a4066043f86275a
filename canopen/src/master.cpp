// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cassert>
#include <regista/canopen/master.hpp>
#include <stdexcept>

namespace regista::canopen {
namespace {

constexpr std::size_t most_transfers = 64;  // that wait for one node

/// An expedited answer that does not say how many bytes it has comes with four (CiA 301, 7.2.4.3.6, s = 0).
bool is_value(const Bytes& read, const Bytes& wanted) {
  return read == wanted ||
         (read.size() == 4 && wanted.size() < 4 && std::ranges::equal(wanted, ByteView{read}.first(wanted.size())));
}

bool is_missing(const Error& error) { return error.code == SdoAbort::no_object || error.code == SdoAbort::no_subindex; }

}  // namespace

Master::Master(CanBus& bus, const Options& options, Events events)
    : bus_{bus}, options_{options}, events_{std::move(events)}, sync_{options.sync}, lss_{options.lss} {
  if (options.id < first_node || options.id > last_node) {
    throw std::invalid_argument{"CANopen master: node id " + std::to_string(options.id) + " is not from 1 to 127"};
  }
  for (int node = 0; node <= int{last_node}; ++node) {
    nodes_.push_back({.monitor = NodeMonitor{static_cast<NodeId>(node), {.heartbeat_timeout = Duration::zero()}}});
  }
}

void Master::watch(NodeId node, const NodeMonitor::Options& options) {
  assert(first_node <= node && node <= last_node);
  nodes_[node].monitor = NodeMonitor{node, options};
  if (std::ranges::find(watched_, node) == watched_.end()) watched_.push_back(node);
}

// --- in --------------------------------------------------------------------------------------------------------------

void Master::on_frame(const CanFrame& frame, Time now) {
  now_ = now;
  if (frame.error) {
    ++statistics_.error_frames;
    const BusReport report = bus_report(frame);
    if (report.transmit_errors) statistics_.transmit_errors = report.transmit_errors;
    if (report.receive_errors) statistics_.receive_errors = report.receive_errors;
    if (report.state) set_bus_state(*report.state, now);
    return;
  }
  ++statistics_.received;
  count_bits(frame, now);
  if (broken()) set_bus_state(BusState::active, now);
  if (frame.extended || frame.remote) return;

  if (const std::uint8_t handler = handler_of_[frame.id & 0x7FFU]; handler != 0) {
    handlers_[handler - 1U](frame.bytes(), now);
    return flush(now);
  }
  const auto node = static_cast<NodeId>(frame.id & 0x7FU);
  const std::uint32_t function = frame.id & 0x780U;
  if (frame.id == lss_slave_id) {
    lss_.on_frame(frame, now);
  } else if (node == 0) {
    return;
  } else if (function == 0x580) {
    if (Channel* channel = nodes_[node].channel.get()) {
      channel->client.on_frame(frame, now);
      start_next(*channel, now);
    }
  } else if (function == heartbeat_id) {
    tell(node, nodes_[node].monitor.on_frame(frame, now));
  } else if (function == emcy_id) {
    if (const auto emcy = Emcy::decode(frame)) {
      nodes_[node].emergencies.add(*emcy, now);
      if (events_.emcy) events_.emcy(node, *emcy);
    }
  }
  flush(now);
}

void Master::tell(NodeId node, NodeMonitor::Event event) {
  if (event != NodeMonitor::Event::none && events_.node) events_.node(node, event);
}

void Master::on_time(Time now) {
  now_ = now;
  for (const NodeId node : watched_) {
    tell(node, nodes_[node].monitor.on_time(now));
    if (const auto question = nodes_[node].monitor.take_question()) (void)urgent(*question, now);
  }
  for (std::size_t i = 0; i < channels_.size(); ++i) {  // callbacks may add some
    channels_[i]->client.on_time(now);
    start_next(*channels_[i], now);
  }
  lss_.on_time(now);

  if (options_.heartbeat > Duration::zero() && now >= heartbeat_at_) {
    heartbeat_at_ = heartbeat_at_ == Time::min() || now - heartbeat_at_ > options_.heartbeat
                        ? now + options_.heartbeat
                        : heartbeat_at_ + options_.heartbeat;
    const auto state = booted_ ? NmtState::operational : NmtState::boot_up;
    const CanFrame beat = make_frame(heartbeat_id + options_.id, {static_cast<std::uint8_t>(state)});
    if (bus_state_ == BusState::down) {
      if (put(beat, now)) set_bus_state(BusState::active, now);  // somebody takes it: the bus is back
    } else if (urgent(beat, now)) {
      booted_ = true;
    }
  }
  if (const auto sync = sync_.on_time(now)) {
    if (urgent(*sync, now)) {
      for (OutgoingPdo& pdo : outgoing_) {
        if (std::exchange(pdo.armed, false)) pdo.pending = true;
      }
    }
  }
  flush(now);
}

Time Master::next_wake() const {
  Time next = std::min(sync_.next_wake(), lss_.next_wake());
  for (const NodeId node : watched_) next = std::min(next, nodes_[node].monitor.next_wake());
  for (const Channel* channel : channels_) next = std::min(next, channel->client.next_wake());
  if (options_.heartbeat > Duration::zero()) next = std::min(next, heartbeat_at_);
  if (waiting() && !broken()) next = std::min(next, std::max(retry_at_, now_));
  return next;
}

// --- out -------------------------------------------------------------------------------------------------------------

Result<> Master::unless_broken(const char* what) const {
  if (broken()) return Error{std::errc::network_down, std::string{what} + ": CAN bus " + to_string(bus_state_)};
  return {};
}

Result<> Master::urgent(const CanFrame& frame, Time now) {
  if (auto usable = unless_broken("send"); !usable) return usable;
  if (urgent_count_ == urgent_.size()) return Error{std::errc::no_buffer_space, "send"};
  urgent_[urgent_count_++] = frame;
  flush(now);
  return {};
}

bool Master::put(const CanFrame& frame, Time now) {
  const Result<> sent = bus_.send(frame);
  if (sent) {
    ++statistics_.sent;
    count_bits(frame, now);
    blocked_since_.reset();
    return true;
  }
  if (sent.error().code == std::errc::no_buffer_space) {
    ++statistics_.saturated;
    if (!blocked_since_) blocked_since_ = now;
    retry_at_ = now + options_.retry;
    // Nobody acknowledges: the controller repeats for ever and never goes bus-off (ISO 11898-1, 12.1.4.2).
    if (now - *blocked_since_ < options_.link_timeout) return false;
  }
  set_bus_state(BusState::down, now);
  return false;
}

void Master::flush(Time now) {
  while (!broken() && now >= retry_at_) {
    if (urgent_count_ > 0) {
      if (!put(urgent_[0], now)) return;
      std::shift_left(urgent_.begin(), urgent_.begin() + static_cast<std::ptrdiff_t>(urgent_count_), 1);
      --urgent_count_;
      continue;
    }
    if (const auto pdo = std::ranges::find(outgoing_, true, &OutgoingPdo::pending); pdo != outgoing_.end()) {
      if (pdo->synchronous && !sync_.in_window(now)) {
        ++statistics_.late_pdos;
      } else if (!put(pdo->frame, now)) {
        return;
      }
      pdo->pending = false;
      continue;
    }
    if (const CanFrame* frame = lss_.front()) {
      if (!put(*frame, now)) return;
      lss_.pop(now);
      continue;
    }
    bool any = false;
    for (std::size_t i = 0; i < channels_.size() && !any; ++i) {
      SdoClient& client = channels_[(turn_ + i) % channels_.size()]->client;
      const CanFrame* frame = client.front();
      if (frame == nullptr) continue;
      if (!put(*frame, now)) return;
      client.pop(now);
      turn_ = (turn_ + i + 1) % channels_.size();
      any = true;
    }
    if (!any) return;
  }
}

bool Master::waiting() const {
  return urgent_count_ > 0 || lss_.front() != nullptr || std::ranges::any_of(outgoing_, &OutgoingPdo::pending) ||
         std::ranges::any_of(channels_, [](const Channel* channel) { return channel->client.front() != nullptr; });
}

void Master::set_bus_state(BusState state, Time now) {
  // Error states come and go with the controller; only a sent or heard frame, or a restart, ends `down` and `off`.
  if (bus_state_ == state) return;
  bus_state_ = state;
  blocked_since_.reset();
  retry_at_ = Time::min();
  if (broken()) discard_all(now);
  if (events_.bus) events_.bus(state);
}

void Master::discard_all(Time now) {
  statistics_.discarded += std::exchange(urgent_count_, 0);
  discard_pdos();
  const Error why{std::errc::network_down, "CAN bus " + to_string(bus_state_)};
  for (std::size_t i = 0; i < channels_.size(); ++i) {  // callbacks may add some
    Channel* channel = channels_[i];
    std::deque<Transfer> waiting;
    waiting.swap(channel->waiting);
    statistics_.discarded += waiting.size();
    channel->client.cancel(why, now);
    for (const Transfer& transfer : waiting) transfer.done(why);
  }
}

void Master::discard_pdos() {
  for (OutgoingPdo& pdo : outgoing_) {
    if (pdo.pending || pdo.armed) ++statistics_.discarded;
    pdo.pending = pdo.armed = false;
  }
}

void Master::count_bits(const CanFrame& frame, Time now) {
  if (options_.bit_rate == 0) return;
  load_bits_ += frame_bits(frame);
  if (now - load_since_ < std::chrono::seconds{1}) return;
  bus_load_ = static_cast<double>(load_bits_) / options_.bit_rate / seconds(now - load_since_);
  load_bits_ = 0;
  load_since_ = now;
}

// --- services --------------------------------------------------------------------------------------------------------

Result<> Master::command(NmtCommand command, NodeId node, Time now) { return urgent(nmt_frame(command, node), now); }

Result<> Master::send_time(std::chrono::sys_time<std::chrono::milliseconds> time, Time now) {
  return urgent(time_frame(time), now);
}

Result<> Master::enqueue(NodeId node, Transfer transfer, Time now) {
  assert(first_node <= node && node <= last_node);
  if (auto usable = unless_broken("SDO"); !usable) return usable;
  std::unique_ptr<Channel>& channel = nodes_[node].channel;
  if (!channel) {
    channel = std::make_unique<Channel>(Channel{.client = {node, options_.sdo}});
    channels_.push_back(channel.get());
  }
  if (channel->waiting.size() >= most_transfers) {
    return Error{std::errc::no_buffer_space, "node " + std::to_string(node) + ": 64 SDO transfers wait"};
  }
  channel->waiting.push_back(std::move(transfer));
  start_next(*channel, now);
  flush(now);
  return {};
}

void Master::start_next(Channel& channel, Time now) {
  if (channel.client.busy() || channel.waiting.empty()) return;
  Transfer next = std::move(channel.waiting.front());
  channel.waiting.pop_front();
  if (next.read) {
    channel.client.upload(next.object, next.transfer, std::move(next.done), now);
  } else {
    channel.client.download(next.object, std::move(next.data), next.transfer, std::move(next.done), now);
  }
}

Result<> Master::upload(NodeId node, ObjectIndex object, SdoDone done, Time now, SdoTransfer transfer) {
  return enqueue(node, {.object = object, .transfer = transfer, .done = std::move(done)}, now);
}

Result<> Master::download(NodeId node, ObjectIndex object, Bytes data, SdoDone done, Time now, SdoTransfer transfer) {
  return enqueue(
      node, {.object = object, .read = false, .data = std::move(data), .transfer = transfer, .done = std::move(done)},
      now);
}

/// A list of writes on its way: each step starts the next, and `at` goes through the list twice.
struct Master::Configuration {
  NodeId node = 0;
  std::vector<SdoWrite> writes;
  std::function<void(Result<>)> done;
  std::size_t at = 0;
  bool verifying = false;
  bool differs = false;  ///< what was read first is not what is wanted
};

Result<> Master::configure(NodeId node, std::vector<SdoWrite> writes, std::function<void(Result<>)> done, Time now) {
  now_ = std::max(now_, now);
  const auto job = std::make_shared<Configuration>(Configuration{node, std::move(writes), std::move(done)});
  if (auto usable = unless_broken("configure"); !usable) return usable;
  if (Channel* channel = nodes_[node].channel.get(); channel != nullptr && channel->configuring) {
    return Error{std::errc::device_or_resource_busy, "node " + std::to_string(node) + ": is being configured"};
  }
  step(job);
  return {};
}

void Master::step(const std::shared_ptr<Configuration>& job) {
  const auto finish = [&](const Result<>& result) {
    if (Channel* channel = nodes_[job->node].channel.get()) channel->configuring = false;
    job->done(result);
  };
  const auto superseded = [&](std::size_t i) {  // written again later, as the COB-ID of a PDO is
    return std::ranges::any_of(job->writes.begin() + static_cast<std::ptrdiff_t>(i) + 1, job->writes.end(),
                               [&](const SdoWrite& later) { return later.object == job->writes[i].object; });
  };
  while (job->at < job->writes.size() && job->verifying && (!job->writes[job->at].verify || superseded(job->at)))
    ++job->at;
  if (job->at == job->writes.size()) {
    if (std::exchange(job->verifying, true)) return finish({});
    job->at = 0;
    return step(job);
  }
  const SdoWrite& write = job->writes[job->at];
  const bool read = job->verifying || (write.only_if_different && !job->differs);
  const auto proceed = [this, job](const Result<Bytes>& result) {
    const SdoWrite& now_done = job->writes[job->at];
    const auto fail = [&](const Error& error) {
      if (Channel* channel = nodes_[job->node].channel.get()) channel->configuring = false;
      job->done(error);
    };
    const bool reading = job->verifying || (now_done.only_if_different && !job->differs);
    if (!result && now_done.optional && is_missing(result.error())) {
      ++job->at;
    } else if (!result && reading && result.error().code == SdoAbort::write_only) {
      job->verifying ? void(++job->at) : void(job->differs = true);
    } else if (!result) {
      return fail(result.error());
    } else if (job->verifying) {
      if (!is_value(*result, now_done.value)) {
        return fail({std::errc::io_error, "node " + std::to_string(job->node) + ": " + to_string(now_done.object) +
                                              " was written and reads back differently"});
      }
      ++job->at;
    } else if (now_done.only_if_different && !job->differs) {
      job->differs = !is_value(*result, now_done.value);
      if (!job->differs) ++job->at;
    } else {
      job->differs = false;
      ++job->at;
    }
    step(job);
  };
  const Result<> begun = read ? upload(job->node, write.object, proceed, now_)
                              : download(job->node, write.object, write.value, proceed, now_);
  if (!begun) return finish(begun.error());
  nodes_[job->node].channel->configuring = true;
}

Result<> Master::identify(NodeId node, std::function<void(Result<Identity>)> done, Time now) {
  struct Job {
    std::array<std::uint32_t, 4> parts{};
    std::optional<Error> failed;
    std::function<void(Result<Identity>)> done;
  };
  auto job = std::make_shared<Job>();
  job->done = std::move(done);
  for (std::uint8_t sub = 1; sub <= 4; ++sub) {
    auto begun = upload(
        node, {0x1018, sub},
        [job, sub](const Result<Bytes>& part) {
          if (part && part->size() <= 8) job->parts[sub - 1U] = static_cast<std::uint32_t>(get_le(*part));
          const bool may_be_missing = sub > 1 && !part && part.error().code.category() == sdo_category();
          if (!part && !may_be_missing && !job->failed) job->failed = part.error();
          if (sub < 4) return;
          if (job->failed) return job->done(*job->failed);
          job->done(Identity{job->parts[0], job->parts[1], job->parts[2], job->parts[3]});
        },
        now);
    if (!begun) return begun;
  }
  return {};
}

// --- PDO -------------------------------------------------------------------------------------------------------------

void Master::on_pdo(std::uint32_t cob_id, PdoHandler handler) {
  if (cob_id >= handler_of_.size() || handlers_.size() == 255) {
    throw std::invalid_argument{"PDO 0x" + hex(cob_id, 3) + ": an 11-bit id, and at most 255 of them"};
  }
  handlers_.push_back(std::move(handler));
  handler_of_[cob_id] = static_cast<std::uint8_t>(handlers_.size());
}

std::size_t Master::add_pdo(std::uint32_t cob_id, std::uint8_t size, bool synchronous) {
  if (cob_id > 0x7FF || size > 8) throw std::invalid_argument{"PDO 0x" + hex(cob_id, 3) + ": 11 bits, 0 to 8 bytes"};
  outgoing_.push_back({.frame = {.id = cob_id, .size = size}, .synchronous = synchronous});
  return outgoing_.size() - 1;
}

Result<> Master::send_pdo(std::size_t pdo, std::span<const std::uint8_t, 8> bytes, Time now) {
  if (auto usable = unless_broken("PDO"); !usable) return usable;
  OutgoingPdo& outgoing = outgoing_.at(pdo);
  if (outgoing.pending || outgoing.armed) ++statistics_.replaced_pdos;
  std::ranges::copy(bytes, outgoing.frame.data.begin());
  if (outgoing.synchronous) {
    outgoing.armed = true;
    outgoing.pending = false;  // what missed its SYNC has been replaced
    return {};
  }
  outgoing.pending = true;
  flush(now);
  return {};
}

Result<> Master::request_pdo(std::uint32_t cob_id, std::uint8_t size, Time now) {
  return urgent({.id = cob_id, .remote = true, .size = size}, now);
}

std::vector<SdoWrite> heartbeat_writes(NodeId master, std::chrono::milliseconds producer,
                                       std::chrono::milliseconds consumer) {
  std::vector<SdoWrite> writes;
  // CiA 301, 7.5.2.19: the node in bits 16 to 23, milliseconds below.
  const auto watched = static_cast<std::uint32_t>(master) << 16 | static_cast<std::uint16_t>(consumer.count());
  if (consumer.count() > 0) writes.push_back(sdo_write<std::uint32_t>({0x1016, 1}, watched));
  if (producer.count() > 0) {
    writes.push_back(sdo_write<std::uint16_t>({0x1017, 0}, static_cast<std::uint16_t>(producer.count())));
  }
  return writes;
}

}  // namespace regista::canopen
