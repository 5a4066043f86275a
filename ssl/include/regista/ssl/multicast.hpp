// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <regista/core/result.hpp>
#include <span>
#include <string>
#include <vector>

namespace regista::ssl {

/// Where the league's programs send, until told otherwise.
struct Group {
  std::string address;
  std::uint16_t port = 0;
};
inline const Group vision_group{"224.5.23.2", 10006};
inline const Group simulated_vision_group{"224.5.23.2", 10020};
inline const Group tracker_group{"224.5.23.2", 10010};
inline const Group referee_group{"224.5.23.1", 10003};

/// Owns a socket.
class Descriptor {
 public:
  explicit Descriptor(int number = -1) : number_{number} {}
  Descriptor(Descriptor&& other) noexcept;
  Descriptor& operator=(Descriptor&& other) noexcept;
  ~Descriptor();
  [[nodiscard]] int get() const { return number_; }

 private:
  int number_;
};

/// Hears one multicast group on many network interfaces, or one address of this computer, such as 127.0.0.1, which some
/// simulators send to. Never blocks.
class MulticastReceiver {
 public:
  /// `interfaces`: by name, such as "eth0"; none: all that are up and can multicast, and not lo. Throws
  /// std::system_error, with group and reason, when the port cannot be had or a named interface not be joined.
  MulticastReceiver(Group group, std::vector<std::string> interfaces);

  /// Join interfaces that have come up since. Those that went away are forgotten by the kernel. Cheap enough for every
  /// few seconds.
  void join_new();

  struct Datagram {
    std::span<const std::byte> bytes;  ///< valid until the next receive
    std::uint32_t source_address = 0;  ///< IPv4, host order
    std::uint16_t source_port = 0;
    int interface = 0;  ///< index; 0: not known
  };
  /// Empty: none waits. Foreign bytes may be anything.
  std::optional<Datagram> receive();

  [[nodiscard]] int fileno() const { return socket_.get(); }
  [[nodiscard]] const Group& group() const { return group_; }
  /// Names of those joined.
  [[nodiscard]] std::vector<std::string> joined() const;

 private:
  struct Membership {
    int index;
    std::string name;
  };

  Group group_;
  std::vector<std::string> wanted_;
  Descriptor socket_;
  std::vector<Membership> joined_;
  std::vector<std::byte> buffer_;
};

/// Sends to one group, out of one interface. Never blocks.
class MulticastSender {
 public:
  /// Throws std::system_error when there is no such interface.
  MulticastSender(const Group& group, const std::string& interface);
  Result<> send(std::span<const std::byte> datagram);

 private:
  Descriptor socket_;
};

/// Interfaces with an IPv4 address that are up and can multicast, without lo.
std::vector<std::string> multicast_interfaces();

/// "eth0"; "?" when there is none of this index any more.
std::string interface_name_of(int index);

}  // namespace regista::ssl
