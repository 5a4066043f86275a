// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/player.hpp>

namespace regista::xdr {

/// What stands before each body: 40 bytes, then `size` bytes of body.
struct Header {
  player::DeviceAddress address{};
  Kind kind{};
  std::uint8_t subtype = 0;
  double timestamp_s = 0;
  std::uint32_t sequence = 0;
  std::uint32_t size = 0;

  static constexpr auto fields =
      Fields{Field<&Header::address>{"addr"},
             Field<&Header::kind>{"type", "", "1 DATA, 2 CMD, 3 REQ, 4 RESP_ACK, 5 SYNCH, 6 RESP_NACK"},
             Field<&Header::subtype>{"subtype"},
             Field<&Header::timestamp_s>{"timestamp", "s", "since the epoch"},
             Field<&Header::sequence>{"seq", "", "copied back in replies of the player interface, else 0"},
             Field<&Header::size>{"size", "bytes", "of the encoded body"}};
  friend bool operator==(const Header&, const Header&) = default;
};

inline constexpr std::size_t header_size = 40;

/// "Player v." and a version, padded with NUL: what a server says first.
inline constexpr std::size_t banner_size = 32;

}  // namespace regista::xdr
