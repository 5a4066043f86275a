// SPDX-License-Identifier: Apache-2.0
#include <regista/client/error.hpp>

namespace regista::client {

namespace {

/// A remedy where there is one that most often helps.
std::string remedy(const std::error_code& code) {
  if (code == std::errc::connection_refused) return "; is the server running, and on this port?";
  if (code == Errc::unknown_host) return "; check the name, or give the address";
  if (code == Errc::foreign) return "; another service answers at this port";
  if (code == Errc::congested) return "; the server hangs or the network is too slow: send less often";
  if (code == Errc::lost) return "; connect again: robot.reconnect()";
  return "";
}

std::string sentence(const Error::Context& context, const std::string& reason, const std::error_code& code) {
  const std::string device = context.device.empty() ? "" : context.device + " at ";
  const std::string verb = code.category() == refusal_category() ? " refused: " : ": ";
  return device + context.host + ":" + std::to_string(context.port) + ": " + context.asked + verb + reason +
         remedy(code);
}

std::string reason_of(const regista::Error& cause) {
  // The server's own words need no errno behind them.
  return cause.code.category() == refusal_category() && !cause.what.empty() ? cause.what : cause.message();
}

}  // namespace

const std::error_category& error_category() noexcept {
  static const class Category final : public std::error_category {
    [[nodiscard]] const char* name() const noexcept override { return "regista client"; }
    [[nodiscard]] std::string message(int code) const override {
      switch (static_cast<Errc>(code)) {
        case Errc::no_answer:
          return "no answer in time";
        case Errc::lost:
          return "not connected";
        case Errc::foreign:
          return "does not speak Player";
        case Errc::congested:
          return "the server takes no bytes";
        case Errc::stock:
          return "a stock Player server cannot do this";
        case Errc::busy:
          return "another request is under way";
        case Errc::unknown_host:
          return "unknown host";
      }
      return "unknown error";
    }
    [[nodiscard]] std::error_condition default_error_condition(int code) const noexcept override {
      switch (static_cast<Errc>(code)) {
        case Errc::no_answer:
          return std::errc::timed_out;
        case Errc::lost:
          return std::errc::not_connected;
        case Errc::foreign:
          return std::errc::protocol_error;
        case Errc::congested:
          return std::errc::no_buffer_space;
        case Errc::stock:
          return std::errc::not_supported;
        case Errc::busy:
          return std::errc::device_or_resource_busy;
        case Errc::unknown_host:
          return std::errc::host_unreachable;
      }
      return {code, *this};
    }
  } category;
  return category;
}

const std::error_category& refusal_category() noexcept {
  static const class Category final : public std::error_category {
    [[nodiscard]] const char* name() const noexcept override { return "refusal"; }
    [[nodiscard]] std::string message(int code) const override {
      return code == no_reason ? "no reason given" : std::generic_category().message(code);
    }
    [[nodiscard]] std::error_condition default_error_condition(int code) const noexcept override {
      if (code == no_reason) return {code, *this};
      return std::generic_category().default_error_condition(code);
    }
  } category;
  return category;
}

Error::Error(Context context, const regista::Error& cause)
    : std::runtime_error{sentence(context, reason_of(cause), cause.code)},
      context_{std::move(context)},
      code_{cause.code},
      reason_{reason_of(cause)} {}

void raise(Error::Context context, const regista::Error& cause) {
  if (cause.code.category() == refusal_category() || cause.code == Errc::stock) {
    throw RefusedError{std::move(context), cause};
  }
  if (cause.code == Errc::no_answer || cause.code == Errc::congested) throw TimeoutError{std::move(context), cause};
  if (cause.code == Errc::busy || cause.code == std::errc::invalid_argument || cause.code == std::errc::interrupted) {
    throw Error{std::move(context), cause};
  }
  throw ConnectionError{std::move(context), cause};
}

}  // namespace regista::client
