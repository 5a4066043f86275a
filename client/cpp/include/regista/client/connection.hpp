// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <regista/client/error.hpp>
#include <regista/core/time.hpp>
#include <regista/xdr/framer.hpp>
#include <regista/xdr/registry.hpp>

namespace regista::client {

class Socket;

/// Which device of a server.
struct Address {
  std::uint16_t interface = 0;
  std::uint16_t index = 0;
  friend auto operator<=>(const Address&, const Address&) = default;
};

/// {4, 0} → "position2d:0"
std::string to_string(Address address);

/// The server itself: always open.
inline constexpr Address server_address{player::code, 0};

struct Options {
  Duration timeout =
      std::chrono::seconds{2};  ///< to connect, for each answer, and for the server's silence before it counts as lost
  player::DataMode mode = player::DataMode::push;  ///< pull: the server sends only when read() asks
  std::string name{};                              ///< shown to the others; empty: program@host
  std::int32_t priority = 10;                      ///< of my wish to drive: 10 programs, 20 people
  bool reconnect = false;                          ///< read() connects again, with back-off, instead of failing
  /// Asked when a signal (EINTR) ends a wait. True: whatever waits gives up with std::errc::interrupted; the connection
  /// stays. For what takes signals itself, such as Python.
  bool (*interrupted)() = nullptr;
};

/// One TCP connection to a server, ours or a stock Player: what Robot and remote devices stand on. Most programs want
/// Robot. One thread at a time; no thread of its own, but for looking up a host's name. Nothing is ever sent twice.
///
/// Handlers are called from within read(), one after the other, and must not call the connection, other than post()
/// and send().
class Connection {
 public:
  /// `header.timestamp_s` is the server's stamp; `arrival` is when the bytes were read here.
  using OnData = std::function<void(const xdr::Header& header, const AnyData& data, Time arrival)>;
  /// The body of the ACK, or why there is none. Called exactly once.
  using OnReply = std::function<void(Result<std::span<const std::byte>> body)>;
  /// The driver's name, or why the device could not be opened. Called exactly once.
  using OnOpen = std::function<void(const Result<std::string>& driver)>;

  Connection(std::string host, std::uint16_t port, Options options = {});
  ~Connection();  ///< close()
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// Connect, shake hands, and open all that is subscribed. Blocks for the timeout at most. Fails as a whole when a
  /// device refuses.
  Result<> connect();
  /// The same without blocking: read() goes on with it. Then `connected()`, or read() fails.
  void start();
  /// Let go of the socket without a word: in a child process, where it is the parent's.
  void abandon();
  /// Close what this connection opened, and wait until the server has read the last command. Subscriptions are kept
  /// for the next connect(). Blocks for the timeout at most; immediate when the connection is broken.
  void close();

  [[nodiscard]] bool connected() const { return state_ == State::ready; }
  /// How often it was connected: another number means that commands, ownership and destinations are void.
  [[nodiscard]] std::uint64_t generation() const { return generation_; }
  /// Our extension is spoken: reasons, events, ownership. A stock Player server has none of it.
  [[nodiscard]] bool extended() const { return extension_.has_value(); }
  /// "Player v.3.1.1-dev", or the name that an extended server gives itself.
  [[nodiscard]] std::string server() const;
  [[nodiscard]] const std::string& host() const { return host_; }
  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] const Options& options() const { return options_; }

  /// Hand on the data that came, waiting up to `timeout` for the first. Returns how many messages; 0: none in time.
  /// Never blocks longer, and with 0 not at all; takes at most 1 MiB a call.
  Result<std::size_t> read(Duration timeout);

  // For an event loop: call read(0) when `fileno()` is ready for `poll_events()`, or at `wake_time()`.
  [[nodiscard]] int fileno() const;         ///< -1 while there is no socket
  [[nodiscard]] short poll_events() const;  ///< POLLIN, POLLOUT
  [[nodiscard]] Time wake_time() const;     ///< a time-out, a probe or the next attempt to connect is due

  /// Open a device; returns its driver's name. Without a connection it is noted and opened by connect(). Interface
  /// `player`: the server's events and motions. An address can be subscribed once.
  Result<std::string> subscribe(Address from, OnData on_data);
  /// The same without waiting: a later read() brings the driver's name. Fails when a request is under way already, or
  /// without a connection.
  Result<> subscribe(Address from, OnData on_data, OnOpen on_open);
  /// Close a device. Does nothing if it is not subscribed.
  Result<> unsubscribe(Address from);

  /// Ask and wait for the answer, up to the timeout. Data that come meanwhile are kept for the next read(): the newest
  /// of each device and type. A refusal has the `refusal_category()`.
  template <RequestType M>
  Result<typename M::Reply> request(Address to, const M& message) {
    const Result<std::vector<std::byte>> body = exchange(to, message);
    if (!body) return body.error();
    typename M::Reply reply;
    if (const Result<> decoded = xdr::decode(std::span{*body}, reply); !decoded) return decoded.error();
    return reply;
  }

  /// The same for a request whose type is known only at run time.
  Result<AnyReply> request(Address to, const AnyRequest& request);

  /// Ask without waiting; a later read() brings the answer. Fails when a request is under way already; but a STOP of
  /// everything waits only for another one.
  Result<> post(Address to, const AnyRequest& request, OnReply on_reply);
  [[nodiscard]] bool request_pending() const { return in_flight_.has_value(); }  ///< other than such a STOP

  /// Send a command. Never blocks: fails with `congested` when the server has stopped reading.
  Result<> send(Address to, const AnyCommand& command);

  /// What was dropped, and why.
  struct Counters {
    std::uint64_t superseded = 0;         ///< kept during a request, and a newer one came
    std::uint64_t undecodable = 0;        ///< data that we do not know or that were cut short
    std::uint64_t unwanted = 0;           ///< data of a device that is not subscribed
    std::uint64_t stray = 0;              ///< answers that nobody waits for (any more), and other nonsense
    std::uint64_t notices = 0;            ///< events and motions, too many during one request
    std::uint64_t dropped_by_server = 0;  ///< as it says in PULL mode; a stock server counts no further than 1
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }

 private:
  enum class State { closed, connecting, greeting, handshake, ready };

  struct Subscription {
    Address address;
    OnData on_data;
    bool open = false;
    std::string driver{};
  };
  struct InFlight {
    Address address;
    std::uint8_t subtype = 0;
    std::uint32_t sequence = 0;
    Time deadline;
    std::string_view name;
    OnReply on_reply;
  };
  using Slot = std::optional<InFlight>;
  struct Kept {
    xdr::Header header;
    AnyData data;
    Time arrival;
  };

  Result<std::vector<std::byte>> exchange(Address to, const AnyRequest& request);
  template <typename Any>
  Result<> transmit(Address to, const Any& message, std::uint32_t sequence);
  Result<> begin(Address to, const AnyRequest& request, OnReply on_reply);
  Result<> flush();
  Result<> take_in(Time until);
  [[nodiscard]] bool interrupted() const { return options_.interrupted != nullptr && options_.interrupted(); }
  Result<bool> receive(Time now);
  void take_frames(Time now);
  void take_data(const xdr::Frame& frame, Time now);
  void take_reply(const xdr::Frame& frame);
  void deliver_kept();
  void on_time(Time now);
  void next_step();
  void subscribe_step(Address address);
  void note_open(Address from, const Result<std::string>& driver);
  regista::Error fail(regista::Error error);
  void drop(const regista::Error& error);
  Slot& slot_for(const AnyRequest& request);
  void finish(Slot& slot, Result<std::span<const std::byte>> body);
  Subscription* find(Address address);

  std::string host_;
  std::uint16_t port_;
  Options options_;
  std::unique_ptr<Socket> socket_;
  State state_ = State::closed;
  bool wanted_ = false;  ///< start() was called and close() was not
  int step_ = 0;         ///< of the handshake
  std::string banner_;
  std::optional<player::Extension> extension_;
  std::uint64_t generation_ = 0;
  regista::Error error_;  ///< why the last connection ended
  xdr::Framer framer_;
  std::vector<std::byte> out_;      ///< the message that is being encoded
  std::vector<std::byte> backlog_;  ///< the rest of one message that the socket did not take
  Slot in_flight_;
  Slot stop_;  ///< of everything
  std::uint32_t sequence_ = 0;
  std::vector<Subscription> subscriptions_;
  std::map<std::pair<Address, std::uint8_t>, Kept> kept_;
  std::deque<Kept> notices_;
  AnyData data_;
  bool delivering_ = false;
  std::size_t delivered_ = 0;
  bool armed_ = false;    ///< PULL: asked, and the SYNCH is still to come
  bool synched_ = false;  ///< PULL: the SYNCH came
  Time attempt_until_;
  Time retry_at_;
  Duration back_off_{};
  Time heard_;                     ///< when bytes came last
  std::optional<Time> probed_at_;  ///< asked for a sign of life
  Counters counters_;
};

}  // namespace regista::client
