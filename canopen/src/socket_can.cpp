// SPDX-License-Identifier: Apache-2.0
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <linux/net_tstamp.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <cstring>
#include <regista/canopen/socket_can.hpp>

namespace regista::canopen {
namespace {

Error last_error(const std::string& what) { return {std::error_code{errno, std::generic_category()}, what}; }

::can_frame to_kernel(const CanFrame& frame) {
  ::can_frame raw{};
  raw.can_id = frame.id;
  if (frame.extended) raw.can_id |= CAN_EFF_FLAG;
  if (frame.remote) raw.can_id |= CAN_RTR_FLAG;
  raw.can_dlc = frame.size;
  std::ranges::copy(frame.data, raw.data);
  return raw;
}

CanFrame from_kernel(const ::can_frame& raw) {
  CanFrame frame;
  frame.error = (raw.can_id & CAN_ERR_FLAG) != 0;
  frame.extended = (raw.can_id & CAN_EFF_FLAG) != 0;
  frame.remote = !frame.error && (raw.can_id & CAN_RTR_FLAG) != 0;
  frame.id = raw.can_id & (frame.error ? CAN_ERR_MASK : frame.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
  frame.size = std::min<std::uint8_t>(raw.can_dlc, CAN_MAX_DLEN);
  if (!frame.remote) std::copy_n(raw.data, frame.size, frame.data.begin());
  return frame;
}

/// The kernel stamps with the wall clock: how long ago it was, taken from now.
Time steady_time(const timespec& stamp) {
  timespec wall{};
  ::clock_gettime(CLOCK_REALTIME, &wall);
  const auto nanoseconds = [](const timespec& time) {
    return std::chrono::seconds{time.tv_sec} + std::chrono::nanoseconds{time.tv_nsec};
  };
  const auto age = nanoseconds(wall) - nanoseconds(stamp);
  // The wall clock may have been set between the two.
  return Clock::now() - std::clamp<Duration>(age, Duration::zero(), std::chrono::seconds{1});
}

}  // namespace

Result<std::unique_ptr<SocketCan>> SocketCan::open(const std::string& interface, std::span<const Filter> filters) {
  const int socket = ::socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
  if (socket < 0) return last_error("open CAN interface " + interface);
  std::unique_ptr<SocketCan> can{new SocketCan{socket, interface}};
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(::if_nametoindex(interface.c_str()));
  if (address.can_ifindex == 0) return last_error("open CAN interface " + interface);

  const auto option = [&](int level, int name, const auto& value) {
    return ::setsockopt(socket, level, name, &value, sizeof value) == 0;
  };
  if (!filters.empty()) {
    std::vector<can_filter> raw;
    for (const Filter& filter : filters) {
      const canid_t flags = filter.extended ? CAN_EFF_FLAG : 0U;
      raw.push_back({filter.id | flags, filter.mask | CAN_EFF_FLAG});
    }
    const auto bytes = static_cast<socklen_t>(raw.size() * sizeof raw[0]);
    if (::setsockopt(socket, SOL_CAN_RAW, CAN_RAW_FILTER, raw.data(), bytes) != 0) {
      return last_error("filter on CAN interface " + interface);
    }
  }
  const can_err_mask_t errors = CAN_ERR_MASK;
  if (!option(SOL_CAN_RAW, CAN_RAW_ERR_FILTER, errors)) return last_error("error frames of CAN interface " + interface);
  // A frame in the kernel counts with its whole buffer, so this holds about as many as an interface queues (txqueuelen
  // 10): the socket says that it is full before the queue does, and little that is old waits there. Best effort.
  (void)option(SOL_SOCKET, SO_SNDBUF, 4096);
  (void)option(SOL_SOCKET, SO_RCVBUF, 1 << 20);
  (void)option(SOL_SOCKET, SO_TIMESTAMPING, SOF_TIMESTAMPING_RX_SOFTWARE | SOF_TIMESTAMPING_SOFTWARE);
  (void)option(SOL_SOCKET, SO_RXQ_OVFL, 1);
  if (::bind(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    return last_error("open CAN interface " + interface);
  }
  return can;
}

SocketCan::~SocketCan() { ::close(socket_); }

Result<> SocketCan::send(const CanFrame& frame) {
  const ::can_frame raw = to_kernel(frame);
  if (::write(socket_, &raw, sizeof raw) == static_cast<ssize_t>(sizeof raw)) return {};
  // ENOBUFS: the interface's queue is full. EAGAIN: our share of it is. Both pass.
  if (errno == ENOBUFS || errno == EAGAIN || errno == EINTR) return Error{std::errc::no_buffer_space, interface_};
  if (errno == ENXIO || errno == ENODEV) return Error{std::errc::no_such_device, interface_};
  return last_error(interface_);
}

Result<std::optional<ReceivedFrame>> SocketCan::receive() {
  ::can_frame raw{};
  iovec where{.iov_base = &raw, .iov_len = sizeof raw};
  alignas(cmsghdr) std::array<char, 256> control{};
  msghdr message{};
  message.msg_iov = &where;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  const ssize_t size = ::recvmsg(socket_, &message, 0);
  if (size < 0) {
    if (errno == EAGAIN || errno == EINTR) return std::optional<ReceivedFrame>{};
    return last_error(interface_);
  }
  if (static_cast<std::size_t>(size) != sizeof raw) return Error{std::errc::bad_message, interface_};
  ReceivedFrame received{from_kernel(raw), Clock::now()};
  for (cmsghdr* part = CMSG_FIRSTHDR(&message); part != nullptr; part = CMSG_NXTHDR(&message, part)) {
    if (part->cmsg_level != SOL_SOCKET) continue;
    if (part->cmsg_type == SO_TIMESTAMPING) {
      std::array<timespec, 3> stamps{};  // scm_timestamping: software, unused, hardware
      std::memcpy(&stamps, CMSG_DATA(part), sizeof stamps);
      if (stamps[0].tv_sec != 0) received.time = steady_time(stamps[0]);
    } else if (part->cmsg_type == SO_RXQ_OVFL) {
      std::uint32_t dropped = 0;
      std::memcpy(&dropped, CMSG_DATA(part), sizeof dropped);
      lost_ = dropped;
    }
  }
  return std::optional{received};
}

}  // namespace regista::canopen
