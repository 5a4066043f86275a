// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/socket.h>

#include <cstddef>
#include <future>
#include <memory>
#include <regista/core/result.hpp>
#include <regista/core/time.hpp>
#include <span>
#include <vector>

namespace regista::client {

/// A TCP socket that never blocks, from the look-up of a name to the last byte.
class Socket {
 public:
  Socket(const std::string& host, std::uint16_t port);  ///< begins to look up
  ~Socket();
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;

  /// Go on with connecting, one address after the other until `deadline`. True: connected.
  Result<bool> connect(Time now, Time deadline);
  /// Wait until something may have happened, at most until `until`. False: a signal came.
  bool wait(Time until, bool writes) const;

  /// Bytes that came; 0: none now. Fails when the peer has closed.
  Result<std::size_t> receive(std::span<std::byte> space);
  /// Bytes that were taken; 0: none now.
  Result<std::size_t> send(std::span<const std::byte> bytes);

  /// What to poll, and for what: while a name is looked up, an eventfd.
  [[nodiscard]] int descriptor() const { return lookup_ ? lookup_->done : descriptor_; }
  [[nodiscard]] short events(bool writes) const;
  /// When connect() gives up the present address.
  [[nodiscard]] Time next_try() const { return try_until_; }

 private:
  struct Endpoint {
    sockaddr_storage address;
    socklen_t size;
  };
  struct Lookup {
    std::vector<Endpoint> endpoints;
    std::string error;
  };
  /// Shared with the thread that looks up, which may outlive the socket.
  struct PendingLookup {
    PendingLookup();
    ~PendingLookup();
    PendingLookup(const PendingLookup&) = delete;
    PendingLookup& operator=(const PendingLookup&) = delete;

    std::promise<Lookup> promise;
    int done;  ///< readable when the promise is kept
  };
  static Lookup look_up(const std::string& host, std::uint16_t port, int flags);

  void open_next(Time now, Time deadline);
  void give_up(int error);

  std::string host_;
  std::shared_ptr<PendingLookup> lookup_;  ///< until it is done
  std::future<Lookup> result_;
  std::vector<Endpoint> endpoints_;
  std::size_t next_ = 0;
  int descriptor_ = -1;
  bool connected_ = false;
  Time try_until_ = Time::max();
  regista::Error error_;
};

}  // namespace regista::client
