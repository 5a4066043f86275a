// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/canopen/virtual_bus.hpp>

namespace regista::canopen {
namespace {

/// The frame whose bits are dominant longer wins (ISO 11898-1, 10.3): base id, then data before remote and 11 bits
/// before 29, then the rest of the id.
std::uint64_t arbitration(const CanFrame& frame) {
  const std::uint64_t base = frame.extended ? frame.id >> 18 : frame.id;
  const std::uint64_t rest = frame.extended ? frame.id & 0x3FFFFU : 0;
  const std::uint64_t is_remote = frame.remote ? 1 : 0;
  const std::uint64_t first = frame.extended ? 1 : is_remote;  // SRR is recessive
  return base << 22 | first << 21 | (frame.extended ? 1ULL : 0ULL) << 20 | rest << 1 | (frame.extended ? is_remote : 0);
}

}  // namespace

Result<> VirtualBus::Port::send(const CanFrame& frame) {
  if (off_) return Error{std::errc::network_down, "send"};
  if (transmit_.size() >= bus_.queue_) return Error{std::errc::no_buffer_space, "send"};
  transmit_.push_back({frame, bus_.now_});
  return {};
}

Result<std::optional<ReceivedFrame>> VirtualBus::Port::receive() {
  if (received_.empty()) return std::optional<ReceivedFrame>{};
  const ReceivedFrame frame = received_.front();
  received_.pop_front();
  return std::optional{frame};
}

void VirtualBus::Port::bus_off() {
  off_ = true;
  transmit_.clear();
  received_.push_back({error_frame(BusState::off), bus_.now_});
}

void VirtualBus::Port::restart() {
  off_ = false;
  received_.push_back({error_frame(BusState::active), bus_.now_});
}

VirtualBus::Port& VirtualBus::attach() { return *ports_.emplace_back(std::make_unique<Port>(*this)); }

void VirtualBus::arbitrate() {
  const auto takes_part = [](const auto& port) { return port->connected_ && !port->off_; };
  // A lone node repeats its frame for ever, because nobody acknowledges it.
  if (std::ranges::count_if(ports_, takes_part) < 2) return;
  Time start = Time::max();
  for (const auto& port : ports_) {
    if (takes_part(port) && !port->transmit_.empty()) start = std::min(start, port->transmit_.front().since);
  }
  if (start == Time::max()) return;
  start = std::max(start, free_at_);
  Port* winner = nullptr;
  for (const auto& port : ports_) {
    if (!takes_part(port) || port->transmit_.empty() || port->transmit_.front().since > start) continue;
    if (winner == nullptr ||
        arbitration(port->transmit_.front().frame) < arbitration(winner->transmit_.front().frame)) {
      winner = port.get();
    }
  }
  const CanFrame frame = winner->transmit_.front().frame;
  winner->transmit_.pop_front();
  const int bits = frame_bits(frame);
  bits_ += static_cast<std::uint64_t>(bits);
  ++frames_;
  on_the_wire_ = {winner, frame, start + bus_time(bits, bit_rate_)};
}

void VirtualBus::deliver(const OnTheWire& done) {
  free_at_ = done.end;
  if (lose(done.frame)) return;
  for (const auto& port : ports_) {
    if (port.get() != done.from && port->connected_ && !port->off_) port->received_.push_back({done.frame, done.end});
  }
}

void VirtualBus::on_time(Time now) {
  now_ = std::max(now, now_);
  while (true) {
    if (!on_the_wire_) arbitrate();
    if (!on_the_wire_ || on_the_wire_->end > now_) return;
    const OnTheWire done = *on_the_wire_;
    on_the_wire_.reset();
    deliver(done);
  }
}

Time VirtualBus::next_wake() const { return on_the_wire_ ? on_the_wire_->end : Time::max(); }

}  // namespace regista::canopen
