// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <regista/ssl/multicast.hpp>
#include <system_error>
#include <utility>

namespace regista::ssl {

namespace {

constexpr std::size_t longest_datagram = 65536;

std::system_error failure(int error, const std::string& what) { return {error, std::generic_category(), what}; }

std::string to_string(const Group& group) { return group.address + ':' + std::to_string(group.port); }

in_addr address_of(const Group& group) {
  in_addr address{};
  if (::inet_pton(AF_INET, group.address.c_str(), &address) != 1)
    throw failure(EINVAL, "'" + group.address + "' is no address, such as 224.5.23.2");
  return address;
}

bool is_multicast(const in_addr& address) { return IN_MULTICAST(ntohl(address.s_addr)); }

template <typename T>
int set_option(int socket, int level, int option, const T& value) {
  return ::setsockopt(socket, level, option, &value, sizeof value);
}

}  // namespace

Descriptor::Descriptor(Descriptor&& other) noexcept : number_{std::exchange(other.number_, -1)} {}
Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  std::swap(number_, other.number_);
  return *this;
}
Descriptor::~Descriptor() {
  if (number_ >= 0) ::close(number_);
}

MulticastReceiver::MulticastReceiver(Group group, std::vector<std::string> interfaces)
    : group_{std::move(group)},
      wanted_{std::move(interfaces)},
      socket_{::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)},
      buffer_(longest_datagram) {
  const in_addr address = address_of(group_);
  const int socket = socket_.get();
  if (socket < 0) throw failure(errno, "socket");
  (void)set_option(socket, SOL_SOCKET, SO_REUSEADDR, 1);  // others on this machine listen, too
  // Otherwise groups that any other program has joined come in on this port.
  (void)set_option(socket, IPPROTO_IP, IP_MULTICAST_ALL, 0);
  (void)set_option(socket, IPPROTO_IP, IP_PKTINFO, 1);
  (void)set_option(socket, SOL_SOCKET, SO_RCVBUF, 1 << 20);
  const sockaddr_in local{.sin_family = AF_INET, .sin_port = htons(group_.port), .sin_addr = address, .sin_zero = {}};
  if (::bind(socket, reinterpret_cast<const sockaddr*>(&local), sizeof local) != 0)
    throw failure(errno, "cannot listen on " + to_string(group_));
  for (const std::string& name : wanted_) {
    if (::if_nametoindex(name.c_str()) == 0) throw failure(errno, "network interface '" + name + "'");
  }
  join_new();
  if (!wanted_.empty() && joined_.empty() && is_multicast(address))
    throw failure(errno, "cannot join " + to_string(group_) + " on '" + wanted_.front() + "'");
}

void MulticastReceiver::join_new() {
  const in_addr address = address_of(group_);
  if (!is_multicast(address)) return;
  for (const std::string& name : wanted_.empty() ? multicast_interfaces() : wanted_) {
    const int index = static_cast<int>(::if_nametoindex(name.c_str()));
    if (index == 0 || std::ranges::find(joined_, index, &Membership::index) != joined_.end()) continue;
    const ip_mreqn membership{.imr_multiaddr = address, .imr_address = {.s_addr = INADDR_ANY}, .imr_ifindex = index};
    if (set_option(socket_.get(), IPPROTO_IP, IP_ADD_MEMBERSHIP, membership) == 0) joined_.push_back({index, name});
  }
}

std::optional<MulticastReceiver::Datagram> MulticastReceiver::receive() {
  sockaddr_in source{};
  iovec space{.iov_base = buffer_.data(), .iov_len = buffer_.size()};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(in_pktinfo))> control{};
  msghdr message{.msg_name = &source,
                 .msg_namelen = sizeof source,
                 .msg_iov = &space,
                 .msg_iovlen = 1,
                 .msg_control = control.data(),
                 .msg_controllen = control.size(),
                 .msg_flags = 0};
  const ssize_t size = ::recvmsg(socket_.get(), &message, 0);
  if (size < 0) return {};
  Datagram datagram{.bytes = std::span{buffer_}.first(static_cast<std::size_t>(size)),
                    .source_address = ntohl(source.sin_addr.s_addr),
                    .source_port = ntohs(source.sin_port)};
  for (cmsghdr* header = CMSG_FIRSTHDR(&message); header != nullptr; header = CMSG_NXTHDR(&message, header)) {
    if (header->cmsg_level != IPPROTO_IP || header->cmsg_type != IP_PKTINFO) continue;
    in_pktinfo info{};
    std::memcpy(&info, CMSG_DATA(header), sizeof info);
    datagram.interface = info.ipi_ifindex;
  }
  return datagram;
}

std::vector<std::string> MulticastReceiver::joined() const {
  std::vector<std::string> names;
  for (const Membership& membership : joined_) names.push_back(membership.name);
  return names;
}

MulticastSender::MulticastSender(const Group& group, const std::string& interface)
    : socket_{::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)} {
  const int socket = socket_.get();
  if (socket < 0) throw failure(errno, "socket");
  const int index = static_cast<int>(::if_nametoindex(interface.c_str()));
  if (index == 0) throw failure(errno, "network interface '" + interface + "'");
  const ip_mreqn out{.imr_multiaddr = {}, .imr_address = {}, .imr_ifindex = index};
  const sockaddr_in to{
      .sin_family = AF_INET, .sin_port = htons(group.port), .sin_addr = address_of(group), .sin_zero = {}};
  // One hop: a team's traffic stays in the field's network.
  if (set_option(socket, IPPROTO_IP, IP_MULTICAST_IF, out) != 0 ||
      set_option(socket, IPPROTO_IP, IP_MULTICAST_TTL, 1) != 0 ||
      ::connect(socket, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0) {
    throw failure(errno, "cannot send to " + to_string(group) + " out of '" + interface + "'");
  }
}

Result<> MulticastSender::send(std::span<const std::byte> datagram) {
  if (::send(socket_.get(), datagram.data(), datagram.size(), 0) >= 0) return {};
  return Error{std::error_code{errno, std::generic_category()}, "send"};
}

std::vector<std::string> multicast_interfaces() {
  std::vector<std::string> names;
  ifaddrs* list = nullptr;
  if (::getifaddrs(&list) != 0) return names;
  for (const ifaddrs* i = list; i != nullptr; i = i->ifa_next) {
    if (i->ifa_addr == nullptr || i->ifa_addr->sa_family != AF_INET) continue;
    constexpr unsigned needed = IFF_UP | IFF_MULTICAST;
    if ((i->ifa_flags & needed) != needed || (i->ifa_flags & IFF_LOOPBACK) != 0) continue;
    if (std::ranges::find(names, i->ifa_name) == names.end()) names.emplace_back(i->ifa_name);
  }
  ::freeifaddrs(list);
  return names;
}

std::string interface_name_of(int index) {
  std::array<char, IF_NAMESIZE> name{};
  return ::if_indextoname(static_cast<unsigned>(index), name.data()) != nullptr ? name.data() : "?";
}

}  // namespace regista::ssl
