// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <asio/ip/address.hpp>
#include <map>
#include <regista/core/rate_limit.hpp>

namespace regista {

/// How often each address connects: at most `rate` a second. Loopback is not counted, and the addresses of one IPv6
/// subnet (/64) are one: a machine may have them all.
///
/// Bounded: an address that has paused for a second is forgotten; when as many as fit have not, new ones are refused.
class ConnectionLimiter {
 public:
  static constexpr std::size_t most = 4096;  ///< addresses

  explicit ConnectionLimiter(int rate) : rate_{rate} {}

  /// [1/s]
  [[nodiscard]] int rate() const { return rate_; }

  bool admit(const asio::ip::address& address, Time now) {
    if (address.is_loopback()) return true;
    const asio::ip::address who = subnet(address);
    auto found = known_.find(who);
    if (found == known_.end()) {
      if (known_.size() >= most) std::erase_if(known_, [&](const auto& known) { return known.second.idle(now); });
      if (known_.size() >= most) return false;
      found = known_.emplace(who, RateLimit{std::chrono::nanoseconds{std::chrono::seconds{1}} / rate_, rate_}).first;
    }
    return found->second.admit(now);
  }

 private:
  static asio::ip::address subnet(const asio::ip::address& address) {
    if (!address.is_v6()) return address;
    asio::ip::address_v6::bytes_type bytes = address.to_v6().to_bytes();
    std::fill(bytes.begin() + 8, bytes.end(), std::uint8_t{0});
    return asio::ip::address_v6{bytes};
  }

  int rate_;
  std::map<asio::ip::address, RateLimit> known_;
};

}  // namespace regista
