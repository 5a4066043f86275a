// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cassert>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <variant>

namespace regista {

/// Why something failed while running: the code for programs, and for people what we were doing, to what.
struct Error {
  std::error_code code;
  std::string what;

  Error(std::error_code code, std::string what) : code{code}, what{std::move(what)} {}
  Error(std::errc code, std::string what) : code{std::make_error_code(code)}, what{std::move(what)} {}

  /// "open /dev/ttyACM0: No such file or directory"
  [[nodiscard]] std::string message() const { return what.empty() ? code.message() : what + ": " + code.message(); }
};

/// A value, or the reason why there is none. Becomes std::expected when the compilers have it.
template <typename T = void>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_{std::in_place_index<0>, std::move(value)} {}      // NOLINT(google-explicit-constructor)
  Result(Error error) : state_{std::in_place_index<1>, std::move(error)} {}  // NOLINT(google-explicit-constructor)

  explicit operator bool() const { return state_.index() == 0; }

  /// Only with a value in it.
  T& operator*() & { return (assert(*this), *std::get_if<0>(&state_)); }
  const T& operator*() const& { return (assert(*this), *std::get_if<0>(&state_)); }
  T&& operator*() && { return (assert(*this), std::move(*std::get_if<0>(&state_))); }
  T* operator->() { return &**this; }
  const T* operator->() const { return &**this; }

  /// Only without a value.
  [[nodiscard]] const Error& error() const { return (assert(!*this), *std::get_if<1>(&state_)); }

 private:
  std::variant<T, Error> state_;
};

template <>
class [[nodiscard]] Result<void> {
 public:
  Result() = default;
  Result(Error error) : error_{std::move(error)} {}  // NOLINT(google-explicit-constructor)

  explicit operator bool() const { return !error_; }
  [[nodiscard]] const Error& error() const { return (assert(error_), *error_); }

 private:
  std::optional<Error> error_;
};

}  // namespace regista
