// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// The server itself: devices, subscriptions, delivery, and our extension (docs/protocol.md).
namespace regista::player {

inline constexpr std::uint16_t code = 1;

/// A device as it is named on the wire.
struct DeviceAddress {
  std::uint32_t host = 0;
  std::uint32_t robot = 0;
  std::uint16_t interface = 0;
  std::uint16_t index = 0;

  static constexpr auto fields =
      Fields{Field<&DeviceAddress::host>{"host", "", "IPv4 address of the server, bytes reversed; clients send 0"},
             Field<&DeviceAddress::robot>{"robot", "", "TCP port of the device; clients may send 0"},
             Field<&DeviceAddress::interface>{"interf"}, Field<&DeviceAddress::index>{"index"}};
  friend bool operator==(const DeviceAddress&, const DeviceAddress&) = default;
};

struct DeviceList {
  std::vector<DeviceAddress> devices{};

  static constexpr auto fields = Fields{Field<&DeviceList::devices>{"devices", "", "of the port asked", 4096}};
  friend bool operator==(const DeviceList&, const DeviceList&) = default;
};

struct GetDeviceList {
  using Reply = DeviceList;
  static constexpr Message message{code, Kind::request, 1, "DEVLIST"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const GetDeviceList&, const GetDeviceList&) = default;
};

struct GetDriverInfo {
  DeviceAddress address{};
  Text driver{};

  using Reply = GetDriverInfo;
  static constexpr Message message{code, Kind::request, 2, "DRIVERINFO"};
  static constexpr auto fields = Fields{Field<&GetDriverInfo::address>{"addr"},
                                        Field<&GetDriverInfo::driver>{"driver_name", "", "of the answer", 64}};
  friend bool operator==(const GetDriverInfo&, const GetDriverInfo&) = default;
};

enum class Access : std::uint8_t { open = 1, close = 2, error = 3 };

/// Open or close a device: subscribe to its data.
struct Subscribe {
  DeviceAddress address{};
  Access access = Access::open;
  Text driver{};

  using Reply = Subscribe;
  static constexpr Message message{code, Kind::request, 3, "DEV"};
  static constexpr auto fields =
      Fields{Field<&Subscribe::address>{"addr"},
             Field<&Subscribe::access>{"access", "", "1 open, 2 close, 3 error (of the answer)"},
             Field<&Subscribe::driver>{"driver_name", "", "of the answer", 64}};
  friend bool operator==(const Subscribe&, const Subscribe&) = default;
};

/// In PULL mode: send what is queued.
struct GetData {
  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 4, "DATA"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const GetData&, const GetData&) = default;
};

enum class DataMode : std::uint8_t { push = 1, pull = 2 };

struct SetDataMode {
  DataMode mode = DataMode::push;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 5, "DATAMODE"};
  static constexpr auto fields = Fields{Field<&SetDataMode::mode>{"mode", "", "1 push, 2 pull"}};
  friend bool operator==(const SetDataMode&, const SetDataMode&) = default;
};

/// Answered with a NACK, as the stock server does.
struct Authenticate {
  std::vector<std::uint8_t> key{};

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 7, "AUTH"};
  static constexpr auto fields = Fields{Field<&Authenticate::key>{"auth_key", "", "", 32}};
  friend bool operator==(const Authenticate&, const Authenticate&) = default;
};

/// Answered with a NACK, as the stock server does.
struct FindName {
  std::vector<std::uint8_t> robot_name{};
  std::uint16_t port = 0;

  using Reply = FindName;
  static constexpr Message message{code, Kind::request, 8, "NAMESERVICE"};
  static constexpr auto fields =
      Fields{Field<&FindName::robot_name>{"name", "", "", 64}, Field<&FindName::port>{"port"}};
  friend bool operator==(const FindName&, const FindName&) = default;
};

/// What happens in this client's queue to a message that matches the pattern; the first rule that matches wins.
struct AddReplaceRule {
  std::int32_t interface = -1;
  std::int32_t index = -1;
  std::int32_t kind = -1;
  std::int32_t subtype = -1;
  std::int32_t replace = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 10, "ADD_REPLACE_RULE"};
  static constexpr auto fields = Fields{
      Field<&AddReplaceRule::interface>{"interf", "", "-1: any"}, Field<&AddReplaceRule::index>{"index", "", "-1: any"},
      Field<&AddReplaceRule::kind>{"type", "", "-1: any"}, Field<&AddReplaceRule::subtype>{"subtype", "", "-1: any"},
      Field<&AddReplaceRule::replace>{"replace", "", "0 queue all, 1 the newest replaces, 2 drop"}};
  friend bool operator==(const AddReplaceRule&, const AddReplaceRule&) = default;
};

/// In PULL mode: that was all that was queued.
struct SynchOk {
  static constexpr Message message{code, Kind::synch, 1, "OK"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const SynchOk&, const SynchOk&) = default;
};

/// In PULL mode: that was all that was queued, and some had been dropped.
struct SynchOverflow {
  std::uint32_t dropped = 0;

  static constexpr Message message{code, Kind::synch, 2, "OVERFLOW"};
  static constexpr auto fields = Fields{Field<&SynchOverflow::dropped>{"value", "", "messages since the last SYNCH"}};
  friend bool operator==(const SynchOverflow&, const SynchOverflow&) = default;
};

// The extension. A client that sends Extend is told reasons, events and who drives; to a stock peer none of this
// exists.

/// The answer to Extend; a stock server refuses.
struct Extension {
  std::uint32_t version = 1;
  Text server{};

  static constexpr auto fields = Fields{Field<&Extension::version>{"version", "", "of the extension"},
                                        Field<&Extension::server>{"server", "", "name and version"}};
  friend bool operator==(const Extension&, const Extension&) = default;
};

struct Extend {
  using Reply = Extension;
  static constexpr Message message{code, Kind::request, 100, "EXTEND"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const Extend&, const Extend&) = default;
};

/// Who I am, for the others to read, and how my wish to drive weighs.
struct Identify {
  Text name{};
  std::int32_t priority = 10;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 101, "IDENTIFY"};
  static constexpr auto fields =
      Fields{Field<&Identify::name>{"name", "", "such as teleop@host", 64},
             Field<&Identify::priority>{"priority", "", "10: programs, 20: people; stock clients have 10"}};
  friend bool operator==(const Identify&, const Identify&) = default;
};

/// I drive from now on: takes a command group over from an owner of at most my priority.
struct Take {
  DeviceAddress address{};
  Text group{};
  std::uint8_t blend = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 102, "TAKE"};
  static constexpr auto fields = Fields{Field<&Take::address>{"addr"}, Field<&Take::group>{"group", "", "", 32},
                                        Field<&Take::blend>{"blend", "", "1: need not come to rest first"}};
  friend bool operator==(const Take&, const Take&) = default;
};

/// I no longer drive; the group comes to rest.
struct Release {
  DeviceAddress address{};
  Text group{};

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 103, "RELEASE"};
  static constexpr auto fields = Fields{Field<&Release::address>{"addr"}, Field<&Release::group>{"group", "", "", 32}};
  friend bool operator==(const Release&, const Release&) = default;
};

/// Bring a device to rest, whoever drives it. Everybody may.
struct Stop {
  DeviceAddress address{};

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 104, "STOP"};
  static constexpr auto fields = Fields{Field<&Stop::address>{"addr", "", "interface 0: every device"}};
  friend bool operator==(const Stop&, const Stop&) = default;
};

enum class MotionState : std::uint8_t { stopped = 0, driving = 1, stopping = 2, fault = 3 };

/// Who drives a command group, and why it stands. Published to extended clients when it changes.
struct Motion {
  DeviceAddress address{};
  Text group{};
  MotionState state{};
  Text owner{};
  std::int32_t priority = 0;
  double lease_s = 0;
  Text reason{};

  static constexpr Message message{code, Kind::data, 101, "MOTION"};
  static constexpr auto fields = Fields{Field<&Motion::address>{"addr"},
                                        Field<&Motion::group>{"group", "", "", 32},
                                        Field<&Motion::state>{"state", "", "0 stopped, 1 driving, 2 stopping, 3 fault"},
                                        Field<&Motion::owner>{"owner", "", "empty: nobody", 64},
                                        Field<&Motion::priority>{"priority", "", "of the owner"},
                                        Field<&Motion::lease_s>{"lease", "s", "silence for so long stops the group"},
                                        Field<&Motion::reason>{"reason", "", "why it stands", 1024}};
  friend bool operator==(const Motion&, const Motion&) = default;
};

struct GetMotion {
  DeviceAddress address{};
  Text group{};

  using Reply = Motion;
  static constexpr Message message{code, Kind::request, 105, "GET_MOTION"};
  static constexpr auto fields =
      Fields{Field<&GetMotion::address>{"addr"}, Field<&GetMotion::group>{"group", "", "", 32}};
  friend bool operator==(const GetMotion&, const GetMotion&) = default;
};

/// Clients, queues, drops, ages, beats and owners, for people and tools.
struct Status {
  Text json{};

  static constexpr auto fields = Fields{Field<&Status::json>{"json"}};
  friend bool operator==(const Status&, const Status&) = default;
};

struct GetStatus {
  using Reply = Status;
  static constexpr Message message{code, Kind::request, 106, "GET_STATUS"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const GetStatus&, const GetStatus&) = default;
};

/// I am alive: the destination that I gave to this device stays valid. Sent from the client's own read().
struct KeepAlive {
  DeviceAddress address{};

  static constexpr Message message{code, Kind::command, 100, "KEEP_ALIVE", Flow::set_point, "keep-alive"};
  static constexpr auto fields = Fields{Field<&KeepAlive::address>{"addr"}};
  friend bool operator==(const KeepAlive&, const KeepAlive&) = default;
};

/// Something that happened once: a refused command, a stop, a fault. Never dropped.
struct Event {
  DeviceAddress address{};
  std::uint8_t severity = 0;
  Text text{};

  static constexpr Message message{code, Kind::data, 100, "EVENT"};
  static constexpr auto fields = Fields{Field<&Event::address>{"addr", "", "interface 0: the server"},
                                        Field<&Event::severity>{"severity", "", "0 info, 1 warning, 2 error"},
                                        Field<&Event::text>{"text", "", "", 1024}};
  friend bool operator==(const Event&, const Event&) = default;
};

/// The body of a NACK to an extended client.
struct Reason {
  static constexpr std::uint32_t mark = 0x72656173;  ///< "reas": tells a Reason from the other bodies a NACK may have

  std::uint32_t tag = mark;
  std::int32_t error = 0;
  Text text{};

  static constexpr auto fields = Fields{Field<&Reason::tag>{"tag", "", "0x72656173"},
                                        Field<&Reason::error>{"errno", "", "POSIX error number, Linux values"},
                                        Field<&Reason::text>{"text", "", "", 1024}};
  friend bool operator==(const Reason&, const Reason&) = default;
};

}  // namespace regista::player

namespace regista {

struct Player {
  static constexpr std::uint16_t code = player::code;
  static constexpr std::string_view name = "player";
  using Messages =
      TypeList<player::GetDeviceList, player::GetDriverInfo, player::Subscribe, player::GetData, player::SetDataMode,
               player::Authenticate, player::FindName, player::AddReplaceRule, player::SynchOk, player::SynchOverflow,
               player::Extend, player::Identify, player::Take, player::Release, player::Stop, player::Motion,
               player::GetMotion, player::GetStatus, player::KeepAlive, player::Event>;
};

}  // namespace regista
