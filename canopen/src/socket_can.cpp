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

std::chrono::nanoseconds nanoseconds(const timespec& time) {
  return std::chrono::seconds{time.tv_sec} + std::chrono::nanoseconds{time.tv_nsec};
}

}  // namespace

struct SocketCan::Batch {
  struct Slot {
    ::can_frame frame{};
    iovec where{};
    alignas(cmsghdr) std::array<char, 128> control{};
  };
  std::array<Slot, frames_at_once> slots;
  std::array<mmsghdr, frames_at_once> messages;
  std::size_t count = 0;
  std::size_t next = 0;
  Time taken;                       ///< when
  std::chrono::nanoseconds wall{};  ///< the same moment by the clock that the kernel stamps with

  void prepare() {
    for (std::size_t i = 0; i < slots.size(); ++i) {
      Slot& slot = slots[i];
      slot.where = {.iov_base = &slot.frame, .iov_len = sizeof slot.frame};
      messages[i] = {};
      messages[i].msg_hdr.msg_iov = &slot.where;
      messages[i].msg_hdr.msg_iovlen = 1;
      messages[i].msg_hdr.msg_control = slot.control.data();
      messages[i].msg_hdr.msg_controllen = slot.control.size();
    }
  }
};

SocketCan::SocketCan(int socket, std::string interface)
    : socket_{socket}, interface_{std::move(interface)}, batch_{std::make_unique<Batch>()} {}

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
  Batch& batch = *batch_;
  if (batch.next == batch.count) {
    const bool was_all = 0 < batch.count && batch.count < frames_at_once;
    batch.count = batch.next = 0;
    if (was_all) return std::optional<ReceivedFrame>{};
    batch.prepare();
    const int count = ::recvmmsg(socket_, batch.messages.data(), frames_at_once, 0, nullptr);
    if (count < 0) {
      if (errno == EAGAIN || errno == EINTR) return std::optional<ReceivedFrame>{};
      return last_error(interface_);
    }
    batch.count = static_cast<std::size_t>(count);
    timespec wall{};
    ::clock_gettime(CLOCK_REALTIME, &wall);
    batch.wall = nanoseconds(wall);
    batch.taken = Clock::now();
  }
  mmsghdr& message = batch.messages[batch.next];
  const ::can_frame& raw = batch.slots[batch.next].frame;
  ++batch.next;
  if (message.msg_len != sizeof raw) return Error{std::errc::bad_message, interface_};
  ReceivedFrame received{from_kernel(raw), batch.taken};
  for (cmsghdr* part = CMSG_FIRSTHDR(&message.msg_hdr); part != nullptr; part = CMSG_NXTHDR(&message.msg_hdr, part)) {
    if (part->cmsg_level != SOL_SOCKET) continue;
    if (part->cmsg_type == SO_TIMESTAMPING) {
      std::array<timespec, 3> stamps{};  // scm_timestamping: software, unused, hardware
      std::memcpy(&stamps, CMSG_DATA(part), sizeof stamps);
      // The wall clock may have been set between the two.
      const auto age =
          std::clamp<Duration>(batch.wall - nanoseconds(stamps[0]), Duration::zero(), std::chrono::seconds{1});
      if (stamps[0].tv_sec != 0) received.time -= age;
    } else if (part->cmsg_type == SO_RXQ_OVFL) {
      std::uint32_t dropped = 0;
      std::memcpy(&dropped, CMSG_DATA(part), sizeof dropped);
      lost_ = dropped;
    }
  }
  return std::optional{received};
}

}  // namespace regista::canopen
