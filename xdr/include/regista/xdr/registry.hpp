// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/messages.hpp>
#include <regista/xdr/codec.hpp>

namespace regista::xdr {

namespace detail {

/// From an interface's 16 bits and a subtype's 8; universal requests (subtype ≥ 247) belong to any interface.
constexpr std::uint32_t message_key(std::uint16_t interface, std::uint8_t subtype) {
  constexpr std::uint8_t first_universal = 247;
  return (std::uint32_t{subtype >= first_universal ? any_interface : interface} << 8) | subtype;
}

}  // namespace detail

/// "unknown interface 6", or "position2d has no command of subtype 9"
Error unknown_message(const Header& header);

/// "position2d VEL"
std::string message_title(std::uint16_t interface, const Message& message);

/// Decode a body of a kind into `out`. When `out` already holds
/// such a message its memory is used again. An error says which message, which field and which byte.
template <Kind kind>
Result<> decode_any(const Header& header, std::span<const std::byte> body, Any<kind>& out);

extern template Result<> decode_any(const Header& header, std::span<const std::byte> body, AnyData& out);
extern template Result<> decode_any(const Header& header, std::span<const std::byte> body, AnyCommand& out);
extern template Result<> decode_any(const Header& header, std::span<const std::byte> body, AnyRequest& out);

/// Call `visit.template operator()<Body>()` with the struct that lays out the body of such a message. False: unknown.
///
/// Player has one layout for a request and its replies; a request whose own struct is empty (all GET_*) is laid out
/// as its answer. Any of these bodies may also be absent: size 0.
template <typename Visit>
bool with_body_type(const Header& header, Visit&& visit) {
  return any_message(AllMessages{}, [&]<typename M>() {
    constexpr Message m = M::message;
    if (detail::message_key(header.address.interface, header.subtype) != detail::message_key(m.interface, m.subtype)) {
      return false;
    }
    if constexpr (RequestType<M>) {
      const bool reply = header.kind == Kind::ack || header.kind == Kind::nack;
      if (header.kind != Kind::request && !reply) return false;
      using Reply = typename M::Reply;
      if constexpr (field_count<M> == 0) {
        visit.template operator()<Reply>();
      } else if constexpr (field_count<Reply> == 0) {
        visit.template operator()<M>();
      } else if (reply) {
        visit.template operator()<Reply>();
      } else {
        visit.template operator()<M>();
      }
    } else {
      if (header.kind != m.kind) return false;
      visit.template operator()<M>();
    }
    return true;
  });
}

}  // namespace regista::xdr
