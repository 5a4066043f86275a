// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <regista/core/result.hpp>
#include <stdexcept>
#include <string>

namespace regista::client {

/// Why a Connection could not do what it was asked. Compares equal to the std::errc in brackets.
enum class Errc {
  no_answer = 1,  ///< nothing came in time [timed_out]
  lost,           ///< the server closed the connection, or there is none [not_connected]
  foreign,        ///< whoever answers does not speak Player [protocol_error]
  congested,      ///< the server takes no bytes: this message was not sent [no_buffer_space]
  stock,          ///< a stock Player server cannot do this: it was not sent [not_supported]
  busy,           ///< one request at a time [device_or_resource_busy]
  unknown_host,   ///< the name has no address [host_unreachable]
};

const std::error_category& error_category() noexcept;
inline std::error_code make_error_code(Errc code) { return {static_cast<int>(code), error_category()}; }

/// Codes of a refusal (NACK): the errno that the server gave, or `no_reason`; the words stand in Error::what. They
/// compare equal to std::errc.
const std::error_category& refusal_category() noexcept;
inline constexpr int no_reason = -1;

/// What the client library throws. `what()` says all: "position2d:0 at robot7:6665: SET_ODOM refused: busy (…);
/// remedy".
class Error : public std::runtime_error {
 public:
  struct Context {
    std::string host;
    std::uint16_t port = 0;
    std::string device;  ///< "position2d:0", or empty: the server itself
    std::string asked;   ///< what was asked: "SET_ODOM", "connect"
  };

  Error(Context context, const regista::Error& cause);

  [[nodiscard]] const Context& context() const { return context_; }
  [[nodiscard]] std::error_code code() const { return code_; }
  [[nodiscard]] const std::string& reason() const { return reason_; }  ///< the server's words where it gave any

 private:
  Context context_;
  std::error_code code_;
  std::string reason_;
};

/// There is no connection, or it broke: `robot.reconnect()`.
class ConnectionError final : public Error {
  using Error::Error;
};

/// The server did not answer or fell silent.
class TimeoutError final : public Error {
  using Error::Error;
};

/// The server or the device said no.
class RefusedError final : public Error {
  using Error::Error;
};

/// Throw the class that fits the cause.
[[noreturn]] void raise(Error::Context context, const regista::Error& cause);

}  // namespace regista::client

template <>
struct std::is_error_code_enum<regista::client::Errc> : std::true_type {};
