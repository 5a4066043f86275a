// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/core/result.hpp>
#include <regista/core/time.hpp>
#include <regista/device/ring.hpp>
#include <regista/device/spares.hpp>
#include <regista/interfaces/messages.hpp>
#include <vector>

namespace regista {

/// Whoever sends commands: a client of the server, or a driver that requires a device. 0 is nobody.
using SessionId = std::uint32_t;

/// Drivers that use devices of other drivers have sessions from here on; clients have the numbers below.
inline constexpr SessionId first_driver_session = 0x80000000;

/// Where an answer goes. It names its session by number, so that it survives the session.
struct ReplyTo {
  SessionId session = 0;            ///< 0: nobody wants an answer
  std::size_t link = 0;             ///< which of the host's links asked
  player::DeviceAddress address{};  ///< as the request named it
  std::uint8_t subtype = 0;
  std::uint32_t sequence = 0;
};

/// Who a session is, for others to read, and how its wish to drive weighs. Goes down before its first command.
struct Identity {
  std::string name;
  std::int32_t priority = 10;
  bool extended = false;  ///< sends keep-alives for its destinations
};

/// A session is no more: what it drove comes to rest, what it had open is closed.
struct Gone {};

/// What goes down to a driver's host.
struct Inbound {
  SessionId session = 0;
  std::size_t port = 0;  ///< which of the driver's ports
  Time arrived;
  ReplyTo reply_to{};  ///< of a request
  std::variant<AnyCommand, AnyRequest, Identity, Gone> message;
};

struct Sample {
  std::size_t port = 0;
  Time measured;
  AnyData data;
};

/// What the last data of a device say of its motion: where a stop ramps from.
struct Measured {
  BodyVelocity velocity{};      ///< of a position2d; of a position1d in x [m/s or rad/s]
  std::vector<float> speeds{};  ///< of an actarray's joints [m/s or rad/s]; empty: not known
};

struct Reply {
  ReplyTo to{};
  std::size_t port = 0;
  Result<AnyReply> answer{AnyReply{}};
};

/// An Event or a Motion of one of the driver's ports; also kept as the port's present state.
struct Notice {
  std::size_t port = 0;
  std::variant<player::Event, player::Motion> message;
};

/// What comes up from a driver's host.
using Outbound = std::variant<Sample, Reply, Notice>;

/// Wakes a thread that waits in poll(2). Any thread may call it; it does not block.
class Wakeup {
 public:
  Wakeup();
  ~Wakeup();
  Wakeup(const Wakeup&) = delete;
  Wakeup& operator=(const Wakeup&) = delete;

  void notify() const;
  /// Forget what was notified; before looking for the reason.
  void clear() const;
  [[nodiscard]] int descriptor() const { return descriptor_; }

 private:
  int descriptor_;  ///< of an eventfd
};

/// What joins a driver's host to one user of its devices: the network thread, or a driver that requires it.
struct Link {
  Mailbox<Inbound, 256> down;
  Mailbox<Outbound, 256> up;
  Spares<AnyData> spare_data;    ///< of `up`
  const Wakeup* user = nullptr;  ///< to be notified after something was put up
};

}  // namespace regista
