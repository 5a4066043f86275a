// SPDX-License-Identifier: Apache-2.0
#include "session.hpp"

#include <netinet/tcp.h>
#include <sys/socket.h>

#include <algorithm>
#include <asio/buffer.hpp>

namespace regista {

namespace {

using namespace std::chrono_literals;

constexpr std::size_t pieces_at_once = 64;
constexpr int unsent_in_kernel = 16 * 1024;  // what waits there can no longer be replaced by something newer
constexpr int user_timeout_ms = 5000;

void set_option(int socket, int level, int name, int value) { ::setsockopt(socket, level, name, &value, sizeof value); }

void tune(int socket) {
  set_option(socket, IPPROTO_TCP, TCP_NODELAY, 1);
  set_option(socket, IPPROTO_TCP, TCP_QUICKACK, 1);
  set_option(socket, IPPROTO_TCP, TCP_NOTSENT_LOWAT, unsent_in_kernel);
  // A peer that vanished is closed in five seconds, whether something was sent to it or not.
  set_option(socket, IPPROTO_TCP, TCP_USER_TIMEOUT, user_timeout_ms);
  set_option(socket, SOL_SOCKET, SO_KEEPALIVE, 1);
  set_option(socket, IPPROTO_TCP, TCP_KEEPIDLE, 2);
  set_option(socket, IPPROTO_TCP, TCP_KEEPINTVL, 1);
  set_option(socket, IPPROTO_TCP, TCP_KEEPCNT, 3);
}

SharedBytes copy(std::span<const std::byte> bytes) {
  return std::make_shared<const std::vector<std::byte>>(bytes.begin(), bytes.end());
}

std::string mib(std::size_t bytes) {
  const std::size_t tenths = (bytes * 10 + (1 << 19)) >> 20;
  return std::to_string(tenths / 10) + '.' + std::to_string(tenths % 10) + " MiB";
}

std::string one_decimal(Duration duration) {
  const auto tenths = duration / 100ms;
  return std::to_string(tenths / 10) + '.' + std::to_string(tenths % 10) + " s";
}

}  // namespace

Session::Session(SessionOwner& owner, SessionId id, asio::ip::tcp::socket socket, const SessionLimits& limits)
    : owner_{owner},
      id_{id},
      socket_{std::move(socket)},
      coalesce_timer_{socket_.get_executor()},
      limits_{limits},
      framer_{limits.max_message} {
  asio::error_code error;
  const auto remote = socket_.remote_endpoint(error);
  peer_ = remote.address().to_string() + ':' + std::to_string(remote.port());
  local_port_ = socket_.local_endpoint(error).port();
  name = "player@" + peer_;
  socket_.non_blocking(true, error);
  tune(socket_.native_handle());
}

void Session::start(std::string_view banner) {
  send(std::as_bytes(std::span{banner}));
  read();
}

void Session::read() {
  if (closed_ || input_ended_) return;
  const std::span<std::byte> space = framer_.space();
  socket_.async_read_some(asio::buffer(space.data(), space.size()),
                          [self = shared_from_this()](const asio::error_code& error, std::size_t size) {
                            if (self->closed_) return;
                            self->on_bytes(size);
                            if (error) {
                              self->end_input();
                            } else {
                              self->read();
                            }
                          });
}

void Session::on_bytes(std::size_t size) {
  // The kernel falls back to delayed acknowledgements by itself; a stock client's Nagle would then wait for them.
  set_option(socket_.native_handle(), IPPROTO_TCP, TCP_QUICKACK, 1);
  framer_.commit(size);
  while (!closed_) {
    const Result<std::optional<xdr::Frame>> frame = framer_.next();
    if (!frame) return finish("protocol error: " + frame.error().what);
    if (!*frame) break;
    ++messages_in;
    message_begun_ = {};
    owner_.on_message(*this, **frame);
  }
  if (framer_.within_message() && message_begun_ == Time{}) message_begun_ = Clock::now();
}

void Session::end_input() {
  if (input_ended_ || closed_) return;
  input_ended_ = true;
  owner_.on_end_of_input(*this);
  flush();
}

void Session::close(const std::string& reason) {
  if (closed_) return;
  close_reason_ = reason;
  flush();
  finish(reason);
}

void Session::finish(const std::string& reason) {
  if (closed_) return;
  closed_ = true;
  if (!input_ended_) {
    input_ended_ = true;
    owner_.on_end_of_input(*this);
  }
  asio::error_code ignored;
  coalesce_timer_.cancel();
  socket_.shutdown(asio::ip::tcp::socket::shutdown_both, ignored);
  socket_.close(ignored);
  owner_.on_closed(*this, reason);
}

std::string Session::slow(Time now) const {
  return "slow consumer, " + mib(committed_bytes_) + " pending for " + one_decimal(now - progress_);
}

void Session::send(std::span<const std::byte> message) {
  if (closed_) return;
  ++messages_out;
  std::size_t sent = 0;
  if (committed_.empty()) {
    const iovec piece{const_cast<std::byte*>(message.data()), message.size()};
    sent = write({&piece, 1});
    if (closed_ || sent == message.size()) return;
    progress_ = Clock::now();
  }
  commit({.bytes = copy(message)});
  if (committed_.size() == 1) sent_of_front_ = sent;
  if (committed_bytes_ > limits_.max_control || committed_.size() > limits_.max_control_messages) {
    std::string reason = slow(Clock::now());
    if (committed_bytes_ <= limits_.max_control) {
      reason += ": more than " + std::to_string(limits_.max_control_messages) + " messages";
    }
    return finish(reason);
  }
  flush();
}

void Session::commit(Queued item) {
  committed_bytes_ += item.bytes->size();
  committed_.push_back(std::move(item));
}

void Session::send_data() {
  data_requested_ = true;
  if (!data_.empty()) commit_data_and_synch();
}

void Session::commit_data_and_synch() {
  data_requested_ = false;
  for (Queued& item : data_) commit(std::move(item));
  data_.clear();
  data_bytes_ = 0;

  std::array<std::byte, xdr::header_size + 4> synch;
  xdr::Header header{.address = {.interface = player::code}, .kind = Kind::synch, .subtype = 1};
  std::size_t size = 0;
  if (const std::uint32_t dropped = std::exchange(dropped_since_synch_, 0); dropped > 0) {
    header.subtype = player::SynchOverflow::message.subtype;
    size = xdr::encode_message(header, player::SynchOverflow{dropped}, synch);
  } else {
    size = xdr::encode_message(header, player::SynchOk{}, synch);
  }
  commit({.bytes = copy(std::span{synch}.first(size))});
  flush();
}

std::int32_t Session::rule_for(const DataMessage& message) const {
  const auto matches = [](std::int32_t pattern, std::int32_t value) { return pattern == -1 || pattern == value; };
  const auto rule = std::ranges::find_if(rules_, [&](const player::AddReplaceRule& r) {
    return matches(r.interface, message.address().interface) && matches(r.index, message.address().index) &&
           matches(r.kind, static_cast<std::int32_t>(Kind::data)) && matches(r.subtype, message.subtype());
  });
  return rule == rules_.end() ? 0 : rule->replace;
}

void Session::add_rule(const player::AddReplaceRule& rule) {
  const auto same = std::ranges::find_if(rules_, [&](const player::AddReplaceRule& r) {
    return r.interface == rule.interface && r.index == rule.index && r.kind == rule.kind && r.subtype == rule.subtype;
  });
  constexpr std::size_t most_rules = 256;
  if (same != rules_.end()) {
    same->replace = rule.replace;
  } else if (rules_.size() < most_rules) {
    rules_.push_back(rule);
  }
}

void Session::deliver(DataMessage& message, Time now) {
  if (closed_) return;
  constexpr std::int32_t replace = 1;
  constexpr std::int32_t ignore = 2;
  const std::int32_t rule = rules_.empty() ? 0 : rule_for(message);
  if (rule == ignore) return;
  ++messages_out;
  const bool at_once =
      mode_ == player::DataMode::push && coalescing_ == Duration{} && committed_.empty() && data_.empty();
  if (at_once) {
    const iovec piece{const_cast<std::byte*>(message.bytes().data()), message.bytes().size()};
    const std::size_t sent = write({&piece, 1});
    if (closed_ || sent == message.bytes().size()) return;
    if (sent > 0) {  // the rest must follow
      progress_ = now;
      commit({.bytes = message.keep()});
      sent_of_front_ = sent;
      return flush();
    }
  }
  if (rule == replace) {
    const auto older = std::ranges::find_if(data_, [&](const Queued& item) {
      return item.address == message.address() && item.subtype == message.subtype();
    });
    if (older != data_.end()) {
      data_bytes_ -= older->bytes->size();
      data_.erase(older);
    }
  }
  queue_data(message, now);
  if (mode_ == player::DataMode::pull) {
    if (data_requested_) commit_data_and_synch();
  } else if (coalescing_ > Duration{}) {
    if (coalescing_now_) return;
    coalescing_now_ = true;
    coalesce_timer_.expires_after(coalescing_);
    coalesce_timer_.async_wait([self = shared_from_this()](const asio::error_code& error) {
      self->coalescing_now_ = false;
      if (!error && !self->closed_) self->flush();
    });
  } else {
    flush();
  }
}

void Session::queue_data(DataMessage& message, Time now) {
  data_.push_back({.bytes = message.keep(), .since = now, .address = message.address(), .subtype = message.subtype()});
  data_bytes_ += message.bytes().size();
  // PULL: the client says when; what it may miss is bounded as in Player, in messages and bytes.
  constexpr std::size_t most_data_messages = 1024;
  const Duration max_age = mode_ == player::DataMode::pull ? Duration::max() : limits_.max_state_age + 2 * coalescing_;
  while (data_.size() > 1 && (data_bytes_ > limits_.max_state || data_.size() > most_data_messages ||
                              now - data_.front().since > max_age)) {
    drop_oldest_data();
  }
}

void Session::drop_oldest_data() {
  data_bytes_ -= data_.front().bytes->size();
  data_.pop_front();
  ++data_dropped;
  ++dropped_since_synch_;
}

std::size_t Session::write(std::span<const iovec> pieces) {
  msghdr message{};
  message.msg_iov = const_cast<iovec*>(pieces.data());
  message.msg_iovlen = pieces.size();
  const ssize_t sent = ::sendmsg(socket_.native_handle(), &message, MSG_DONTWAIT | MSG_NOSIGNAL);
  if (sent >= 0) return static_cast<std::size_t>(sent);
  if (errno != EAGAIN && errno != EINTR) finish(input_ended_ ? "" : "write: " + std::generic_category().message(errno));
  return 0;
}

void Session::flush() {
  while (!closed_) {
    const bool data_may_go = mode_ == player::DataMode::push && !coalescing_now_;
    std::array<iovec, pieces_at_once> pieces;
    std::size_t count = 0;
    std::size_t wanted = 0;
    const auto add = [&](const Queued& item, std::size_t from) {
      pieces[count++] = {const_cast<std::byte*>(item.bytes->data()) + from, item.bytes->size() - from};
      wanted += item.bytes->size() - from;
    };
    for (std::size_t i = 0; i < committed_.size() && count < pieces_at_once; ++i) {
      add(committed_[i], i == 0 ? sent_of_front_ : 0);
    }
    for (std::size_t i = 0; data_may_go && i < data_.size() && count < pieces_at_once; ++i) add(data_[i], 0);
    if (count == 0) break;

    const std::size_t sent = write({pieces.data(), count});
    std::size_t left = sent;
    while (!committed_.empty() && left >= committed_.front().bytes->size() - sent_of_front_) {
      left -= committed_.front().bytes->size() - sent_of_front_;
      committed_bytes_ -= committed_.front().bytes->size();
      committed_.pop_front();
      sent_of_front_ = 0;
      progress_ = {};
    }
    while (committed_.empty() && !data_.empty() && left >= data_.front().bytes->size()) {
      left -= data_.front().bytes->size();
      data_bytes_ -= data_.front().bytes->size();
      data_.pop_front();
    }
    if (left > 0 && committed_.empty()) {  // begun data must be finished before anything else
      data_bytes_ -= data_.front().bytes->size();
      commit(std::move(data_.front()));
      data_.pop_front();
    }
    sent_of_front_ += left;
    if (sent == wanted) continue;
    if (progress_ == Time{}) progress_ = Clock::now();
    if (!waiting_writable_ && !closed_) {
      waiting_writable_ = true;
      socket_.async_wait(asio::ip::tcp::socket::wait_write, [self = shared_from_this()](const asio::error_code& error) {
        self->waiting_writable_ = false;
        if (!error && !self->closed_) self->flush();
      });
    }
    return;
  }
  if (input_ended_ && requests_waiting == 0 && committed_.empty()) finish(close_reason_);
}

void Session::set_mode(player::DataMode mode) {
  mode_ = mode;
  flush();
}

void Session::set_coalescing(Duration interval) { coalescing_ = interval; }

void Session::check(Time now) {
  if (closed_) return;
  if (message_begun_ != Time{} && now - message_begun_ > limits_.message_timeout) {
    return finish("protocol error: message incomplete after " + one_decimal(now - message_begun_));
  }
  if (!committed_.empty() && progress_ != Time{} && now - progress_ > limits_.slow_after) {
    return finish(slow(now));
  }
  if (input_ended_ && requests_waiting == 0) finish(close_reason_);
}

}  // namespace regista
