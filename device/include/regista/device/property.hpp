// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <regista/core/result.hpp>
#include <string>
#include <variant>

namespace regista {

/// Bounds of a number, and whether clients may only read it.
struct PropertyOptions {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool read_only = false;
};

/// A named value of a driver that clients may read and, unless it is read-only, change. Types: int, double, bool, text.
struct PropertyCore {
  using Value = std::variant<std::int32_t, double, bool, std::string>;

  std::string name;
  Value value;
  PropertyOptions options{};
  std::function<void()> changed;

  /// Fails, in words, when the type is another, the value out of range, or the property read-only.
  Result<> set(Value next) {
    if (options.read_only) return Error{std::errc::operation_not_permitted, "property '" + name + "' is read-only"};
    if (next.index() != value.index())
      return Error{std::errc::invalid_argument, "property '" + name + "' is of another type"};
    const double* real = std::get_if<double>(&next);
    const std::int32_t* integer = std::get_if<std::int32_t>(&next);
    const double number = real != nullptr ? *real : integer != nullptr ? *integer : 0.0;
    if ((real != nullptr || integer != nullptr) && !(number >= options.min && number <= options.max)) {
      return Error{std::errc::result_out_of_range, "property '" + name + "' = " + std::to_string(number) +
                                                       " is not within [" + std::to_string(options.min) + ", " +
                                                       std::to_string(options.max) + "]"};
    }
    value = std::move(next);
    if (changed) changed();
    return {};
  }
};

/// A driver's view of its property. The driver's own thread only; a client's change arrives between two of its calls.
template <typename T>
class Property {
 public:
  explicit Property(PropertyCore& core) : core_{&core} {}

  const T& operator*() const { return *std::get_if<T>(&core_->value); }
  void set(T value) { core_->value = std::move(value); }
  /// Call `handle()` after a client changed the value.
  void on_change(std::function<void()> handle) { core_->changed = std::move(handle); }

 private:
  PropertyCore* core_;
};

}  // namespace regista
