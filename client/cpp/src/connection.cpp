// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <regista/client/connection.hpp>

#include "socket.hpp"

namespace regista::client {

namespace {

using namespace std::chrono_literals;

constexpr std::size_t bytes_per_read = std::size_t{1} << 20;
constexpr std::size_t most_notices = 256;
constexpr Duration first_back_off = 100ms;
constexpr Duration longest_back_off = 1s;

/// The extension's subtypes of interface `player` begin here; a stock server knows none.
constexpr std::uint8_t first_extension = 100;

std::string text(Duration duration) { return std::to_string(duration / 1ms) + " ms"; }

std::string own_name() {
  char host[256] = "?";
  (void)::gethostname(host, sizeof host - 1);
  return std::string{program_invocation_short_name}.substr(0, 30) + '@' + std::string{host}.substr(0, 30);
}

/// As stock receivers need it: every text ends with a NUL. False: a count is larger than Player's buffer.
template <typename M>
bool make_fit(M& message) {
  bool fits = true;
  for_each_field(message, [&](const auto& field, auto& value) {
    using Value = std::remove_cvref_t<decltype(value)>;
    if constexpr (std::same_as<Value, Text>) {
      std::string& bytes = value.bytes();
      if (!bytes.empty() && bytes.back() != '\0') bytes.push_back('\0');
      fits = fits && bytes.size() <= field.max_count;
    } else if constexpr (is_vector<Value>) {
      fits = fits && value.size() <= field.max_count;
    }
  });
  return fits;
}

template <typename M>
constexpr bool has_counts = [] {
  return fields<M>.apply([](const auto&... field) {
    return (false || ... ||
            (std::same_as<typename std::remove_cvref_t<decltype(field)>::Value, Text> ||
             is_vector<typename std::remove_cvref_t<decltype(field)>::Value>));
  });
}();

regista::Error refusal(std::span<const std::byte> body, bool extended) {
  player::Reason reason;
  if (extended && xdr::decode(body, reason) && reason.tag == player::Reason::mark) {
    return {std::error_code{reason.error, refusal_category()}, std::string{reason.text.view()}};
  }
  return {std::error_code{no_reason, refusal_category()}, "no reason given"};
}

/// A device that could not be opened: an ACK may say so, too (a stock driver whose Setup failed).
Result<std::string> opened(const Result<std::span<const std::byte>>& body) {
  if (!body) return body.error();
  player::Subscribe reply;
  if (const Result<> decoded = xdr::decode(*body, reply); !decoded) return decoded.error();
  if (reply.access == player::Access::error) {
    return regista::Error{std::error_code{no_reason, refusal_category()}, "its driver could not start: see its log"};
  }
  return std::string{reply.driver.view()};
}

/// The same error; what it says begins with what was asked.
regista::Error asked_for(std::string asked, const regista::Error& error) {
  return {error.code, error.what.empty() ? std::move(asked) : asked + ": " + error.what};
}

player::Subscribe subscribe_request(Address address, player::Access access) {
  return {.address = {.interface = address.interface, .index = address.index}, .access = access};
}

regista::Error interruption() { return {std::errc::interrupted, "a signal came"}; }

/// False: a signal came.
bool sleep_until(Time time) {
  const auto whole = std::chrono::floor<std::chrono::seconds>(time.time_since_epoch());
  const timespec until{.tv_sec = whole.count(), .tv_nsec = (time.time_since_epoch() - whole).count()};
  return ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) != EINTR;
}

/// No matter how long: a Time does not overflow.
Time later(Time now, Duration duration) { return now + std::clamp(duration, Duration{}, Duration{24h}); }

}  // namespace

std::string to_string(Address address) {
  const std::string_view name = interface_name(address.interface);
  return (name.empty() ? "interface " + std::to_string(address.interface) : std::string{name}) + ':' +
         std::to_string(address.index);
}

Connection::Connection(std::string host, std::uint16_t port, Options options)
    : host_{std::move(host)}, port_{port}, options_{std::move(options)}, error_{Errc::lost, ""} {
  if (options_.name.empty()) options_.name = own_name();
}

Connection::~Connection() { close(); }

// ---- Connecting

void Connection::start() {
  drop({Errc::lost, "connecting again"});
  wanted_ = true;
  socket_ = std::make_unique<Socket>(host_, port_);
  state_ = State::connecting;
  banner_.clear();
  framer_ = xdr::Framer{};
  extension_.reset();
  step_ = 0;
  armed_ = false;
  probed_at_.reset();
  attempt_until_ = later(Clock::now(), options_.timeout);
}

Result<> Connection::connect() {
  start();
  while (state_ != State::ready) {
    if (const Result<> taken = take_in(attempt_until_); !taken) return taken;
  }
  return {};
}

void Connection::next_step() {
  const auto go_on = [this](std::string_view asked) {
    return [this, asked](Result<std::span<const std::byte>> body) {
      if (body) {
        next_step();
      } else if (state_ != State::closed) {
        (void)fail(asked_for(std::string{asked}, body.error()));
      }
    };
  };
  const auto ask = [this](const AnyRequest& request, OnReply on_reply) {
    if (const Result<> sent = begin(server_address, request, std::move(on_reply)); !sent) (void)fail(sent.error());
  };
  switch (step_++) {
    case 0:
      return ask(player::Extend{}, [this](Result<std::span<const std::byte>> body) {
        if (!body && body.error().code.category() != refusal_category()) return;  // fail() is under way
        player::Extension extension;
        if (body && xdr::decode(*body, extension)) extension_ = std::move(extension);
        next_step();
      });
    case 1:
      return ask(player::SetDataMode{options_.mode}, go_on("DATAMODE"));
    case 2:
      if (!extended()) return next_step();
      return ask(player::Identify{.name = options_.name, .priority = options_.priority}, go_on("IDENTIFY"));
    default:
      for (const Subscription& subscription : subscriptions_) {
        if (!subscription.open) return subscribe_step(subscription.address);
      }
      state_ = State::ready;
      ++generation_;
      back_off_ = {};
  }
}

void Connection::subscribe_step(Address address) {
  const Result<> sent = begin(server_address, subscribe_request(address, player::Access::open),
                              [this, address](Result<std::span<const std::byte>> body) {
                                if (state_ == State::closed) return;
                                const Result<std::string> driver = opened(body);
                                Subscription* subscription = find(address);
                                if (!driver) {
                                  (void)fail(asked_for(to_string(address), driver.error()));
                                } else if (subscription != nullptr) {
                                  subscription->open = true;
                                  subscription->driver = *driver;
                                  next_step();
                                }
                              });
  if (!sent) (void)fail(sent.error());
}

void Connection::close() {
  bool polite = connected();
  for (const Slot* slot : {&in_flight_, &stop_}) {
    while (polite && *slot) polite = bool{take_in((*slot)->deadline)};
  }
  for (auto it = subscriptions_.rbegin(); polite && it != subscriptions_.rend(); ++it) {
    if (it->open && it->address != server_address) {
      polite = bool{exchange(server_address, subscribe_request(it->address, player::Access::close))};
    }
  }
  // A stock server forgets what it has not yet parsed when the connection ends: an answer says that it has.
  if (polite) (void)exchange(server_address, player::GetDeviceList{});
  wanted_ = false;
  drop({Errc::lost, "closed"});
}

void Connection::abandon() {
  wanted_ = false;
  drop({Errc::lost, "left to the parent process"});
}

void Connection::drop(const regista::Error& error) {
  socket_.reset();
  state_ = State::closed;
  error_ = error;
  backlog_.clear();
  for (Subscription& subscription : subscriptions_) subscription.open = subscription.address == server_address;
  for (Slot* slot : {&in_flight_, &stop_}) {
    if (*slot) finish(*slot, error);
  }
}

regista::Error Connection::fail(regista::Error error) {
  back_off_ = std::clamp(back_off_ * 2, first_back_off, longest_back_off);
  retry_at_ = Clock::now() + back_off_;
  drop(error);
  return error;
}

std::string Connection::server() const {
  return extension_ && !extension_->server.view().empty() ? std::string{extension_->server.view()} : banner_;
}

// ---- Sending

template <typename Any>
Result<> Connection::transmit(Address to, const Any& any, std::uint32_t sequence) {
  if (socket_ == nullptr || state_ < State::handshake) return error_;
  const auto encode = [&]<typename M>(const M& message) -> Result<> {
    constexpr Message m = M::message;
    if (m.interface != any_interface && m.interface != to.interface) {
      return regista::Error{std::errc::invalid_argument, std::string{m.name} + " to a " + to_string(to)};
    }
    // HasCapability crashes a stock server.
    const bool ours =
        (m.interface == player::code && m.subtype >= first_extension) || std::same_as<M, property::HasCapability>;
    if (ours && !extended() && !std::same_as<M, player::Extend>) return regista::Error{Errc::stock, ""};
    const xdr::Header header{
        .address = {.robot = to == server_address ? 0u : port_, .interface = to.interface, .index = to.index},
        .kind = m.kind,
        .subtype = m.subtype,
        .timestamp_s = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count(),
        .sequence = sequence};
    out_.resize(xdr::header_size + xdr::encoded_size(message));
    (void)xdr::encode_message(header, message, out_);
    return {};
  };
  const Result<> encoded = std::visit(
      [&]<typename M>(const M& message) -> Result<> {
        if constexpr (has_counts<M>) {
          M fit = message;
          if (!make_fit(fit)) {
            return regista::Error{std::errc::invalid_argument,
                                  std::string{M::message.name} + " holds too many elements"};
          }
          return encode(fit);
        } else {
          return encode(message);
        }
      },
      any);
  if (!encoded) return encoded;

  if (const Result<> flushed = flush(); !flushed) return flushed;
  if (!backlog_.empty()) return regista::Error{Errc::congested, ""};
  const Result<std::size_t> sent = socket_->send(out_);
  if (!sent) return fail(sent.error());
  backlog_.assign(out_.begin() + static_cast<std::ptrdiff_t>(*sent), out_.end());
  return {};
}

Result<> Connection::flush() {
  if (backlog_.empty()) return {};
  const Result<std::size_t> sent = socket_->send(backlog_);
  if (!sent) return fail(sent.error());
  backlog_.erase(backlog_.begin(), backlog_.begin() + static_cast<std::ptrdiff_t>(*sent));
  return {};
}

Result<> Connection::send(Address to, const AnyCommand& command) {
  if (!connected()) return error_;
  return transmit(to, command, 0);
}

Result<> Connection::begin(Address to, const AnyRequest& request, OnReply on_reply) {
  Slot& slot = slot_for(request);
  if (slot) return regista::Error{Errc::busy, ""};
  const auto [subtype, name] =
      std::visit([]<typename M>(const M&) { return std::pair{M::message.subtype, M::message.name}; }, request);
  sequence_ = std::max(sequence_ + 1, 1u);  // 0 is what a stock driver answers
  if (const Result<> sent = transmit(to, request, sequence_); !sent) return sent;
  slot = InFlight{.address = to,
                  .subtype = subtype,
                  .sequence = sequence_,
                  .deadline = state_ == State::ready ? later(Clock::now(), options_.timeout) : attempt_until_,
                  .name = name,
                  .on_reply = std::move(on_reply)};
  return {};
}

/// The server itself answers a STOP of everything, whatever its drivers owe.
Connection::Slot& Connection::slot_for(const AnyRequest& request) {
  const auto* stop = std::get_if<player::Stop>(&request);
  return stop != nullptr && stop->address.interface == 0 ? stop_ : in_flight_;
}

Result<> Connection::post(Address to, const AnyRequest& request, OnReply on_reply) {
  if (!connected()) return error_;
  return begin(to, request, std::move(on_reply));
}

Result<std::vector<std::byte>> Connection::exchange(Address to, const AnyRequest& request) {
  Slot& slot = slot_for(request);
  while (connected() && slot) {
    if (const Result<> taken = take_in(slot->deadline); !taken) return taken.error();
  }
  std::optional<Result<std::vector<std::byte>>> answer;
  const Result<> sent = post(to, request, [&](Result<std::span<const std::byte>> body) {
    if (body) {
      answer = std::vector<std::byte>{body->begin(), body->end()};
    } else {
      answer = body.error();
    }
  });
  if (!sent) return sent.error();
  while (!answer) {
    Result<> taken = take_in(slot->deadline);
    // A signal may also have come while data did.
    if (taken && !answer && interrupted()) taken = interruption();
    if (!taken && !answer) {
      if (slot) slot->on_reply = [](const auto&) {};  // nobody waits for it any more
      return taken.error();
    }
  }
  return *std::move(answer);
}

Result<AnyReply> Connection::request(Address to, const AnyRequest& request) {
  const Result<std::vector<std::byte>> body = exchange(to, request);
  if (!body) return body.error();
  return std::visit(
      [&]<typename M>(const M&) -> Result<AnyReply> {
        typename M::Reply reply;
        if (const Result<> decoded = xdr::decode(std::span{*body}, reply); !decoded) return decoded.error();
        return AnyReply{std::move(reply)};
      },
      request);
}

Result<std::string> Connection::subscribe(Address from, OnData on_data) {
  if (find(from) != nullptr) return regista::Error{std::errc::already_connected, to_string(from)};
  subscriptions_.push_back({.address = from, .on_data = std::move(on_data), .open = from == server_address});
  if (!connected() || from == server_address) return std::string{};
  const Result<std::vector<std::byte>> body = exchange(server_address, subscribe_request(from, player::Access::open));
  Result<std::string> driver = opened(body ? Result<std::span<const std::byte>>{std::span{*body}} : body.error());
  note_open(from, driver);
  return driver;
}

Result<> Connection::subscribe(Address from, OnData on_data, OnOpen on_open) {
  if (find(from) != nullptr) return regista::Error{std::errc::already_connected, to_string(from)};
  Result<> sent = post(server_address, subscribe_request(from, player::Access::open),
                       [this, from, on_open = std::move(on_open)](const Result<std::span<const std::byte>>& body) {
                         const Result<std::string> driver = opened(body);
                         note_open(from, driver);
                         on_open(driver);
                       });
  if (sent) subscriptions_.push_back({.address = from, .on_data = std::move(on_data)});
  return sent;
}

/// What became of a subscription.
void Connection::note_open(Address from, const Result<std::string>& driver) {
  if (Subscription* subscription = find(from); driver && subscription != nullptr) {
    subscription->open = true;
    subscription->driver = *driver;
  } else {
    std::erase_if(subscriptions_, [&](const Subscription& s) { return s.address == from; });
    std::erase_if(kept_, [&](const auto& kept) { return kept.first.first == from; });
  }
}

Result<> Connection::unsubscribe(Address from) {
  const Subscription* subscription = find(from);
  if (subscription == nullptr) return {};
  const bool open = subscription->open && from != server_address;
  std::erase_if(subscriptions_, [&](const Subscription& s) { return s.address == from; });
  std::erase_if(kept_, [&](const auto& kept) { return kept.first.first == from; });
  if (!open || !connected()) return {};
  const Result<std::vector<std::byte>> body = exchange(server_address, subscribe_request(from, player::Access::close));
  if (!body) return body.error();
  return {};
}

Connection::Subscription* Connection::find(Address address) {
  const auto it = std::ranges::find(subscriptions_, address, &Subscription::address);
  return it == subscriptions_.end() ? nullptr : &*it;
}

// ---- Receiving

Result<std::size_t> Connection::read(Duration timeout) {
  Time until = later(Clock::now(), timeout);
  delivered_ = 0;
  synched_ = false;
  delivering_ = true;
  const struct Guard {
    bool& flag;
    ~Guard() { flag = false; }
  } guard{delivering_};
  deliver_kept();
  if (delivered_ > 0) until = Time::min();  // only what is there

  const bool pull = options_.mode == player::DataMode::pull;
  for (;;) {
    if (pull && connected() && !armed_) {
      // The answer is the data; the ACK says nothing.
      const Result<> asked = transmit(server_address, AnyRequest{player::GetData{}}, 0);
      armed_ = bool{asked};
    }
    if (const Result<> taken = take_in(until); !taken) {
      if (delivered_ > 0) break;  // the next call tells
      if (!wanted_ || !options_.reconnect || taken.error().code == std::errc::interrupted) return taken.error();
    }
    if (pull ? synched_ : delivered_ > 0) break;
    if (Clock::now() >= until) break;
  }
  return delivered_;
}

void Connection::deliver_kept() {
  for (const Kept& notice : std::exchange(notices_, {})) {
    if (const Subscription* subscription = find(server_address)) {
      subscription->on_data(notice.header, notice.data, notice.arrival);
      ++delivered_;
    }
  }
  for (const auto& [key, kept] : std::exchange(kept_, {})) {
    if (const Subscription* subscription = find(key.first)) {
      subscription->on_data(kept.header, kept.data, kept.arrival);
      ++delivered_;
    }
  }
}

/// Go on with whatever is under way until bytes came or it is `until`. Fails when the connection does.
Result<> Connection::take_in(Time until) {
  for (;;) {
    const Time now = Clock::now();
    if (state_ == State::closed) {
      if (!wanted_ || !options_.reconnect) return error_;
      if (now >= retry_at_) {
        start();
      } else if (now >= until) {
        return {};
      } else {
        if (!sleep_until(std::min(until, retry_at_)) && interrupted()) return interruption();
        continue;
      }
    }
    if (state_ == State::connecting) {
      const Result<bool> connected = socket_->connect(now, attempt_until_);
      if (!connected) return fail(connected.error());
      if (*connected) state_ = State::greeting;
    }
    bool came = false;
    if (state_ >= State::greeting) {
      const Result<bool> received = receive(now);
      if (!received) return fail(received.error());
      came = *received;
    }
    if (state_ >= State::handshake) {
      if (const Result<> flushed = flush(); !flushed) return flushed;
    }
    if (state_ != State::closed) on_time(now);
    if (state_ == State::closed) return error_;
    if (came || now >= until) return {};
    if (!socket_->wait(std::min(until, wake_time()), !backlog_.empty()) && interrupted()) return interruption();
  }
}

/// True when bytes came.
Result<bool> Connection::receive(Time now) {
  if (state_ == State::greeting) {
    std::array<std::byte, xdr::banner_size> banner{};
    const Result<std::size_t> size = socket_->receive(std::span{banner}.first(xdr::banner_size - banner_.size()));
    if (!size) return size.error();
    for (std::size_t i = 0; i < *size; ++i) banner_.push_back(static_cast<char>(banner[i]));
    constexpr std::string_view player = "Player";
    const std::size_t known = std::min(banner_.size(), player.size());
    if (banner_.compare(0, known, player, 0, known) != 0) {
      std::string printable;
      for (const char c : banner_) printable += c >= ' ' && c <= '~' ? c : '.';
      return regista::Error{Errc::foreign, "it greets with '" + printable + "'"};
    }
    if (banner_.size() < xdr::banner_size) return *size > 0;
    banner_.resize(std::min(banner_.find('\0'), banner_.size()));
    state_ = State::handshake;
    next_step();
    return true;
  }
  bool any = false;
  for (std::size_t total = 0; total < bytes_per_read && state_ != State::closed;) {
    const std::span<std::byte> space = framer_.space();
    const Result<std::size_t> size = socket_->receive(space);
    if (!size) {
      if (any) break;  // what came before comes first
      return size.error();
    }
    if (*size == 0) break;
    any = true;
    heard_ = now;
    probed_at_.reset();
    framer_.commit(*size);
    take_frames(now);
    if (*size < space.size()) break;
    total += *size;
  }
  return any;
}

void Connection::take_frames(Time now) {
  while (state_ != State::closed) {
    const Result<std::optional<xdr::Frame>> next = framer_.next();
    if (!next) {
      (void)fail({Errc::foreign, next.error().message()});
      return;
    }
    if (!*next) return;
    const xdr::Frame& frame = **next;
    switch (frame.header.kind) {
      case Kind::data:
        take_data(frame, now);
        break;
      case Kind::ack:
      case Kind::nack:
        take_reply(frame);
        break;
      case Kind::synch: {
        armed_ = false;
        synched_ = true;
        player::SynchOverflow overflow;
        if (frame.header.subtype == player::SynchOverflow::message.subtype && xdr::decode(frame.body, overflow)) {
          counters_.dropped_by_server += overflow.dropped;
        }
        break;
      }
      case Kind::command:
      case Kind::request:
        ++counters_.stray;
        break;
      default:
        (void)fail({Errc::foreign, "message of type " + std::to_string(static_cast<int>(frame.header.kind))});
        return;
    }
  }
}

void Connection::take_data(const xdr::Frame& frame, Time now) {
  const Address from{frame.header.address.interface, frame.header.address.index};
  const Subscription* subscription = find(from);
  if (subscription == nullptr) {
    ++counters_.unwanted;
    return;
  }
  if (!xdr::decode_any(frame.header, frame.body, data_)) {
    ++counters_.undecodable;
    return;
  }
  if (delivering_) {
    ++delivered_;
    subscription->on_data(frame.header, data_, now);
  } else if (from == server_address) {
    notices_.push_back({frame.header, data_, now});
    if (notices_.size() > most_notices) {
      notices_.pop_front();
      ++counters_.notices;
    }
  } else {
    const auto [place, is_new] =
        kept_.insert_or_assign(std::pair{from, frame.header.subtype}, Kept{frame.header, data_, now});
    if (!is_new) ++counters_.superseded;
  }
}

void Connection::take_reply(const xdr::Frame& frame) {
  const xdr::Header& header = frame.header;
  const Address from{header.address.interface, header.address.index};
  const auto awaits = [&](const Slot& slot) {
    return slot && slot->address == from && slot->subtype == header.subtype &&
           (header.sequence == 0 || header.sequence == slot->sequence);
  };
  if (Slot* slot = awaits(in_flight_) ? &in_flight_ : awaits(stop_) ? &stop_ : nullptr) {
    if (header.kind == Kind::ack) {
      finish(*slot, frame.body);
    } else {
      finish(*slot, refusal(frame.body, extended()));
    }
  } else if (from == server_address && header.subtype == player::GetData::message.subtype) {
    if (header.kind == Kind::nack) armed_ = false;
  } else if (from != server_address || header.subtype != player::SetDataMode::message.subtype) {
    ++counters_.stray;
  }
}

void Connection::finish(Slot& slot, Result<std::span<const std::byte>> body) {
  const OnReply on_reply = std::move(std::exchange(slot, std::nullopt)->on_reply);
  on_reply(body);
}

// ---- Time

/// Silence is not yet a failure: half-way through the time-out the server is asked for a sign of life.
void Connection::on_time(Time now) {
  if (state_ < State::ready) {
    if (now >= attempt_until_) {
      const std::string phase = state_ == State::connecting ? "connecting"
                                : state_ == State::greeting ? "no greeting"
                                                            : "no answer to " + std::string{in_flight_->name};
      (void)fail({Errc::no_answer, phase + ", " + text(options_.timeout)});
    }
    return;
  }
  if (in_flight_ || stop_) {
    heard_ = now;  // an answer is being waited for already
    for (Slot* slot : {&in_flight_, &stop_}) {
      if (*slot && now >= (*slot)->deadline) finish(*slot, regista::Error{Errc::no_answer, text(options_.timeout)});
    }
    return;
  }
  if (!probed_at_) {
    if (now - heard_ < options_.timeout / 2) return;
    // Any server acknowledges the mode that it has; with no effect.
    probed_at_ = now;
    (void)transmit(server_address, AnyRequest{player::SetDataMode{options_.mode}}, 0);
  } else if (now - *probed_at_ >= options_.timeout / 2) {
    (void)fail({Errc::no_answer, "the server has been silent for " + text(now - heard_)});
  }
}

Time Connection::wake_time() const {
  switch (state_) {
    case State::closed:
      return wanted_ && options_.reconnect ? retry_at_ : Time::max();
    case State::connecting:
      return std::min(attempt_until_, socket_->next_try());
    case State::greeting:
    case State::handshake:
      return attempt_until_;
    case State::ready:
      break;
  }
  if (in_flight_ && stop_) return std::min(in_flight_->deadline, stop_->deadline);
  if (in_flight_ || stop_) return in_flight_ ? in_flight_->deadline : stop_->deadline;
  return probed_at_.value_or(heard_) + options_.timeout / 2;
}

int Connection::fileno() const { return socket_ == nullptr ? -1 : socket_->descriptor(); }

short Connection::poll_events() const { return socket_ == nullptr ? short{0} : socket_->events(!backlog_.empty()); }

}  // namespace regista::client
