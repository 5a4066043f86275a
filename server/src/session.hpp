// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/uio.h>
#include <array>
#include <asio/io_context.hpp>
#include <asio/ip/tcp.hpp>
#include <asio/steady_timer.hpp>
#include <deque>
#include <memory>
#include <regista/device/link.hpp>
#include <regista/xdr/framer.hpp>
#include <regista/xdr/registry.hpp>
#include <set>

namespace regista {

/// What the sessions of a server share.
struct SessionLimits {
  std::size_t max_message = std::size_t{1} << 20;  ///< [bytes], of a body that a client sends
  std::size_t max_control = std::size_t{1} << 20;  ///< [bytes], replies and events that wait
  std::size_t max_control_messages = 1024;
  std::size_t max_state = std::size_t{256} << 10;          ///< [bytes], data that wait
  Duration max_state_age = std::chrono::milliseconds{50};  ///< of data that wait in PUSH mode: the newest win
  Duration slow_after = std::chrono::seconds{5};           ///< replies may wait for so long
  Duration message_timeout = std::chrono::seconds{10};     ///< from the first byte of a message to its last
};

/// An encoded message, shared by all who are to have it.
using SharedBytes = std::shared_ptr<const std::vector<std::byte>>;

/// Encoded data on their way to the subscribers: copied once, when the first of them has to keep it.
class DataMessage {
 public:
  DataMessage(std::span<const std::byte> bytes, player::DeviceAddress address, std::uint8_t subtype)
      : bytes_{bytes}, address_{address}, subtype_{subtype} {}
  [[nodiscard]] std::span<const std::byte> bytes() const { return bytes_; }
  [[nodiscard]] const player::DeviceAddress& address() const { return address_; }
  [[nodiscard]] std::uint8_t subtype() const { return subtype_; }
  const SharedBytes& keep() {
    if (!kept_) kept_ = std::make_shared<const std::vector<std::byte>>(bytes_.begin(), bytes_.end());
    return kept_;
  }

 private:
  std::span<const std::byte> bytes_;
  player::DeviceAddress address_;
  std::uint8_t subtype_;
  SharedBytes kept_;
};

class Session;

/// Whom a session asks: the server's router.
class SessionOwner {
 public:
  virtual ~SessionOwner() = default;
  /// A message of the client; `frame` is valid during the call.
  virtual void on_message(Session& session, const xdr::Frame& frame) = 0;
  /// The client has said its last word: what it drove comes to rest. Once, before on_closed.
  virtual void on_end_of_input(Session& session) = 0;
  /// The session may be destroyed after this call returned to the event loop. `reason`: empty when the client left.
  virtual void on_closed(Session& session, const std::string& reason) = 0;
};

/// One client's connection: bytes in, messages to the owner; messages out, bounded, the newest data first to stay.
/// Network thread only.
///
/// Held by shared_ptr, because operations that the event loop has not finished yet must find it alive.
class Session : public std::enable_shared_from_this<Session> {
 public:
  Session(SessionOwner& owner, SessionId id, asio::ip::tcp::socket socket, const SessionLimits& limits);
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  /// Say the banner and begin to read.
  void start(std::string_view banner);
  /// Send what is still to be sent, then close. `reason` for the log.
  void close(const std::string& reason);

  /// A reply or an event: never dropped; a client that does not take them is closed.
  void send(std::span<const std::byte> message);
  /// PULL: what waits may go now, or, when nothing does, what comes next; then a SYNCH.
  void send_data();
  /// Data: in PUSH mode sent at once, in PULL mode when asked for. May be dropped for newer data; that is counted.
  void deliver(DataMessage& message, Time now);

  void set_mode(player::DataMode mode);
  void add_rule(const player::AddReplaceRule& rule);
  /// Gather data for so long and send them at once; 0: send each at once.
  void set_coalescing(Duration interval);

  /// The housekeeping of now: time-outs.
  void check(Time now);

  [[nodiscard]] SessionId id() const { return id_; }
  [[nodiscard]] const std::string& peer() const { return peer_; }
  [[nodiscard]] std::uint16_t local_port() const { return local_port_; }
  [[nodiscard]] bool closed() const { return closed_; }
  /// The client has said its last word; it may still be sent answers.
  [[nodiscard]] bool input_ended() const { return input_ended_; }

  // The router's notes on this client.
  std::string name;  ///< for others to read; "player@127.0.0.1:53422" unless it said another
  std::int32_t priority = 10;
  bool extended = false;
  std::set<std::pair<std::size_t, std::size_t>> opened;  ///< driver and port
  std::size_t requests_waiting = 0;                      ///< answers that drivers owe
  bool known_to_all = false;                             ///< drivers: it stopped them, by name

  // Counted for the status.
  std::uint64_t messages_in = 0;
  std::uint64_t messages_refused = 0;  ///< not understood, or to a device that it had not opened
  std::uint64_t messages_out = 0;
  std::uint64_t data_dropped = 0;
  [[nodiscard]] std::size_t pending_bytes() const { return committed_bytes_ + data_bytes_; }
  [[nodiscard]] bool pull() const { return mode_ == player::DataMode::pull; }

 private:
  struct Queued {
    SharedBytes bytes;
    Time since{};
    player::DeviceAddress address{};  ///< of data
    std::uint8_t subtype = 0;
  };

  void read();
  void on_bytes(std::size_t size);
  void end_input();
  /// Send what may be sent, until the socket takes no more.
  void flush();
  /// How many of the bytes the socket took; closes on error.
  std::size_t write(std::span<const iovec> pieces);
  void commit(Queued item);
  void commit_data_and_synch();
  void queue_data(DataMessage& message, Time now);
  void drop_oldest_data();
  /// The reason to be closed for, of a client that reads too slowly.
  [[nodiscard]] std::string slow(Time now) const;
  void finish(const std::string& reason);
  [[nodiscard]] std::int32_t rule_for(const DataMessage& message) const;

  SessionOwner& owner_;
  SessionId id_;
  asio::ip::tcp::socket socket_;
  asio::steady_timer coalesce_timer_;
  const SessionLimits& limits_;
  std::string peer_;
  std::uint16_t local_port_ = 0;

  xdr::Framer framer_;
  Time message_begun_{};  ///< first byte of the message that is still incomplete; Time{}: none is

  // What will be sent, in this order; and the data behind it that may still be dropped. PULL moves data over when
  // asked.
  std::deque<Queued> committed_;
  std::deque<Queued> data_;
  std::size_t sent_of_front_ = 0;  ///< bytes of committed_.front() that are gone
  std::size_t committed_bytes_ = 0;
  std::size_t data_bytes_ = 0;
  Time progress_{};  ///< when committed_ was empty or its front was sent last

  std::vector<player::AddReplaceRule> rules_;
  player::DataMode mode_ = player::DataMode::push;
  bool data_requested_ = false;  ///< PULL: asked for data, and there were none
  std::uint32_t dropped_since_synch_ = 0;
  Duration coalescing_{};
  bool coalescing_now_ = false;  ///< the timer runs; data wait for it
  bool waiting_writable_ = false;
  bool input_ended_ = false;
  bool closed_ = false;
  std::string close_reason_;
};

}  // namespace regista
