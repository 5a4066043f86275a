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
      std::tuple{Field<&DeviceAddress::host>{"host", "", "IPv4 address of the server, bytes reversed; clients send 0"},
                 Field<&DeviceAddress::robot>{"robot", "", "TCP port of the device; clients may send 0"},
                 Field<&DeviceAddress::interface>{"interf"}, Field<&DeviceAddress::index>{"index"}};
  friend bool operator==(const DeviceAddress&, const DeviceAddress&) = default;
};

struct DeviceList {
  std::vector<DeviceAddress> devices;

  static constexpr auto fields = std::tuple{Field<&DeviceList::devices>{"devices", "", "of the port asked", 4096}};
  friend bool operator==(const DeviceList&, const DeviceList&) = default;
};

struct GetDeviceList {
  using Reply = DeviceList;
  static constexpr Message message{code, Kind::request, 1, "DEVLIST"};
  static constexpr auto fields = std::tuple{};
  friend bool operator==(const GetDeviceList&, const GetDeviceList&) = default;
};

struct GetDriverInfo {
  DeviceAddress address;
  Text driver;

  using Reply = GetDriverInfo;
  static constexpr Message message{code, Kind::request, 2, "DRIVERINFO"};
  static constexpr auto fields = std::tuple{Field<&GetDriverInfo::address>{"addr"},
                                            Field<&GetDriverInfo::driver>{"driver_name", "", "of the answer", 64}};
  friend bool operator==(const GetDriverInfo&, const GetDriverInfo&) = default;
};

enum class Access : std::uint8_t { open = 1, close = 2, error = 3 };

/// Open or close a device: subscribe to its data.
struct Subscribe {
  DeviceAddress address;
  Access access = Access::open;
  Text driver;

  using Reply = Subscribe;
  static constexpr Message message{code, Kind::request, 3, "DEV"};
  static constexpr auto fields =
      std::tuple{Field<&Subscribe::address>{"addr"},
                 Field<&Subscribe::access>{"access", "", "1 open, 2 close, 3 error (of the answer)"},
                 Field<&Subscribe::driver>{"driver_name", "", "of the answer", 64}};
  friend bool operator==(const Subscribe&, const Subscribe&) = default;
};

/// In PULL mode: send what is queued.
struct GetData {
  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 4, "DATA"};
  static constexpr auto fields = std::tuple{};
  friend bool operator==(const GetData&, const GetData&) = default;
};

enum class DataMode : std::uint8_t { push = 1, pull = 2 };

struct SetDataMode {
  DataMode mode = DataMode::push;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 5, "DATAMODE"};
  static constexpr auto fields = std::tuple{Field<&SetDataMode::mode>{"mode", "", "1 push, 2 pull"}};
  friend bool operator==(const SetDataMode&, const SetDataMode&) = default;
};

/// Answered with a NACK, as the stock server does.
struct Authenticate {
  std::vector<std::uint8_t> key;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 7, "AUTH"};
  static constexpr auto fields = std::tuple{Field<&Authenticate::key>{"auth_key", "", "", 32}};
  friend bool operator==(const Authenticate&, const Authenticate&) = default;
};

/// Answered with a NACK, as the stock server does.
struct FindName {
  std::vector<std::uint8_t> robot_name;
  std::uint16_t port = 0;

  using Reply = FindName;
  static constexpr Message message{code, Kind::request, 8, "NAMESERVICE"};
  static constexpr auto fields =
      std::tuple{Field<&FindName::robot_name>{"name", "", "", 64}, Field<&FindName::port>{"port"}};
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
  static constexpr auto fields = std::tuple{
      Field<&AddReplaceRule::interface>{"interf", "", "-1: any"}, Field<&AddReplaceRule::index>{"index", "", "-1: any"},
      Field<&AddReplaceRule::kind>{"type", "", "-1: any"}, Field<&AddReplaceRule::subtype>{"subtype", "", "-1: any"},
      Field<&AddReplaceRule::replace>{"replace", "", "0 queue all, 1 the newest replaces, 2 drop"}};
  friend bool operator==(const AddReplaceRule&, const AddReplaceRule&) = default;
};

/// In PULL mode: that was all that was queued.
struct SynchOk {
  static constexpr Message message{code, Kind::synch, 1, "OK"};
  static constexpr auto fields = std::tuple{};
  friend bool operator==(const SynchOk&, const SynchOk&) = default;
};

/// In PULL mode: that was all that was queued, and some had been dropped.
struct SynchOverflow {
  std::uint32_t dropped = 0;

  static constexpr Message message{code, Kind::synch, 2, "OVERFLOW"};
  static constexpr auto fields =
      std::tuple{Field<&SynchOverflow::dropped>{"value", "", "messages since the last SYNCH"}};
  friend bool operator==(const SynchOverflow&, const SynchOverflow&) = default;
};

}  // namespace regista::player

namespace regista {

struct Player {
  static constexpr std::uint16_t code = player::code;
  static constexpr std::string_view name = "player";
  using Messages =
      TypeList<player::GetDeviceList, player::GetDriverInfo, player::Subscribe, player::GetData, player::SetDataMode,
               player::Authenticate, player::FindName, player::AddReplaceRule, player::SynchOk, player::SynchOverflow>;
};

}  // namespace regista
