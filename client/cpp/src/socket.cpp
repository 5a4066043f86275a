// SPDX-License-Identifier: Apache-2.0
#include "socket.hpp"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <regista/client/error.hpp>
#include <thread>

namespace regista::client {

namespace {

using namespace std::chrono_literals;

std::string to_text(const sockaddr_storage& address, socklen_t size) {
  char host[NI_MAXHOST] = "?";
  char port[NI_MAXSERV] = "?";
  // Numeric: looks nothing up.
  (void)::getnameinfo(reinterpret_cast<const sockaddr*>(&address), size, host, sizeof host, port, sizeof port,
                      NI_NUMERICHOST | NI_NUMERICSERV);
  return std::string{host} + " port " + port;
}

template <typename T>
void set_option(int descriptor, int level, int option, T value) {
  (void)::setsockopt(descriptor, level, option, &value, sizeof value);
}

void configure(int descriptor) {
  set_option(descriptor, IPPROTO_TCP, TCP_NODELAY, 1);
  // What the server does not read piles up here and is stale when it does: a few hundred commands are plenty.
  set_option(descriptor, SOL_SOCKET, SO_SNDBUF, 32 * 1024);
  // A pulled cable: 5 s without an acknowledgement, of data or of three probes.
  set_option(descriptor, IPPROTO_TCP, TCP_USER_TIMEOUT, 5000u);
  set_option(descriptor, SOL_SOCKET, SO_KEEPALIVE, 1);
  set_option(descriptor, IPPROTO_TCP, TCP_KEEPIDLE, 2);
  set_option(descriptor, IPPROTO_TCP, TCP_KEEPINTVL, 1);
  set_option(descriptor, IPPROTO_TCP, TCP_KEEPCNT, 3);
}

}  // namespace

Socket::Lookup Socket::look_up(const std::string& host, std::uint16_t port, int flags) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_NUMERICSERV | flags;
  addrinfo* list = nullptr;
  const int status = ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &list);
  Lookup lookup;
  if (status != 0) {
    lookup.error = ::gai_strerror(status);
    return lookup;
  }
  for (const addrinfo* info = list; info != nullptr; info = info->ai_next) {
    Endpoint endpoint{.address = {}, .size = info->ai_addrlen};
    std::copy_n(reinterpret_cast<const char*>(info->ai_addr), info->ai_addrlen,
                reinterpret_cast<char*>(&endpoint.address));
    lookup.endpoints.push_back(endpoint);
  }
  ::freeaddrinfo(list);
  return lookup;
}

Socket::Socket(const std::string& host, std::uint16_t port) : host_{host}, error_{Errc::lost, "not yet tried"} {
  if (Lookup numeric = look_up(host, port, AI_NUMERICHOST); numeric.error.empty()) {
    endpoints_ = std::move(numeric.endpoints);
    return;
  }
  // getaddrinfo knows no time-out, and a resolver may take half a minute: it takes it in a thread that nobody waits
  // for.
  lookup_ = std::make_shared<PendingLookup>();
  result_ = lookup_->promise.get_future();
  std::thread{[host, port, lookup = lookup_] {
    lookup->promise.set_value(look_up(host, port, 0));
    (void)::eventfd_write(lookup->done, 1);
  }}.detach();
}

Socket::PendingLookup::PendingLookup() : done{::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)} {}
Socket::PendingLookup::~PendingLookup() { ::close(done); }

Socket::~Socket() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void Socket::give_up(int error) {
  error_ = regista::Error{std::error_code{error, std::generic_category()},
                          "connect to " + to_text(endpoints_[next_ - 1].address, endpoints_[next_ - 1].size)};
  if (descriptor_ >= 0) ::close(descriptor_);
  descriptor_ = -1;
}

void Socket::open_next(Time now, Time deadline) {
  const Endpoint& endpoint = endpoints_[next_++];
  // Each address gets an equal part of the time that is left.
  try_until_ = now + std::max(deadline - now, Duration{}) / static_cast<int>(endpoints_.size() - next_ + 1);
  descriptor_ = ::socket(endpoint.address.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (descriptor_ < 0) return give_up(errno);
  configure(descriptor_);
  if (::connect(descriptor_, reinterpret_cast<const sockaddr*>(&endpoint.address), endpoint.size) != 0 &&
      errno != EINPROGRESS) {
    give_up(errno);
  }
}

Result<bool> Socket::connect(Time now, Time deadline) {
  if (lookup_) {
    if (result_.wait_for(0s) != std::future_status::ready) return false;
    Lookup lookup = result_.get();
    lookup_.reset();
    if (!lookup.error.empty()) return regista::Error{Errc::unknown_host, host_ + " (" + lookup.error + ")"};
    endpoints_ = std::move(lookup.endpoints);
  }
  while (!connected_) {
    if (descriptor_ < 0) {
      if (next_ == endpoints_.size()) return error_;
      open_next(now, deadline);
      continue;
    }
    pollfd poll{.fd = descriptor_, .events = POLLOUT, .revents = 0};
    if (::poll(&poll, 1, 0) == 1) {
      int error = 0;
      socklen_t size = sizeof error;
      (void)::getsockopt(descriptor_, SOL_SOCKET, SO_ERROR, &error, &size);
      if (error == 0) {
        connected_ = true;
        try_until_ = Time::max();
      } else {
        give_up(error);
      }
    } else if (now >= try_until_) {
      give_up(ETIMEDOUT);
    } else {
      return false;
    }
  }
  return true;
}

short Socket::events(bool writes) const {
  if (lookup_) return POLLIN;
  if (!connected_) return POLLOUT;
  return static_cast<short>(writes ? POLLIN | POLLOUT : POLLIN);
}

bool Socket::wait(Time until, bool writes) const {
  const auto left = std::max(until - Clock::now(), Duration{});
  const auto whole = std::chrono::duration_cast<std::chrono::seconds>(left);
  const timespec timeout{.tv_sec = whole.count(), .tv_nsec = (left - whole).count()};
  pollfd poll{.fd = descriptor(), .events = events(writes), .revents = 0};
  return ::ppoll(&poll, 1, &timeout, nullptr) >= 0 || errno != EINTR;
}

Result<std::size_t> Socket::receive(std::span<std::byte> space) {
  const ssize_t size = ::recv(descriptor_, space.data(), space.size(), 0);
  if (size > 0) {
    // The kernel forgets it with each segment. Without it a stock server's Nagle waits 40 ms for our acknowledgement.
    set_option(descriptor_, IPPROTO_TCP, TCP_QUICKACK, 1);
    return static_cast<std::size_t>(size);
  }
  if (size == 0) return regista::Error{Errc::lost, "closed by the server"};
  if (errno == EAGAIN || errno == EINTR) return std::size_t{0};
  return regista::Error{std::error_code{errno, std::generic_category()}, "connection lost"};
}

Result<std::size_t> Socket::send(std::span<const std::byte> bytes) {
  const ssize_t size = ::send(descriptor_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  if (size >= 0) return static_cast<std::size_t>(size);
  if (errno == EAGAIN || errno == EINTR) return std::size_t{0};
  return regista::Error{std::error_code{errno, std::generic_category()}, "connection lost"};
}

}  // namespace regista::client
