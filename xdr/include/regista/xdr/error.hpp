// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <system_error>

namespace regista::xdr {

/// What is wrong with the bytes of a peer.
enum class Errc {
  short_body = 1,     ///< the body ends within a field
  bad_count,          ///< an array is longer than its count, its buffer or the body
  oversize,           ///< the header claims a body larger than the limit
  unknown_interface,  ///< no interface of this code
  unknown_message,    ///< no message of this kind and subtype in the interface
};

const std::error_category& error_category() noexcept;

inline std::error_code make_error_code(Errc code) { return {static_cast<int>(code), error_category()}; }

}  // namespace regista::xdr

template <>
struct std::is_error_code_enum<regista::xdr::Errc> : std::true_type {};
