// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <numbers>
#include <optional>
#include <regista/core/time.hpp>
#include <regista/device/address.hpp>
#include <regista/device/suggestion.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace regista {

/// Where something stands in a `.cfg`.
struct Place {
  std::string file;
  int line = 0;    ///< from 1; 0: the file as a whole
  int column = 0;  ///< from 1, in characters; a tab is one

  friend bool operator==(const Place&, const Place&) = default;
};

/// "robot.cfg:12:3"
inline std::string to_string(const Place& place) {
  if (place.line == 0) return place.file;
  return place.file + ":" + std::to_string(place.line) + ":" + std::to_string(place.column);
}

/// The configuration is wrong. `what()` is where, what, and the remedy:
/// "robot.cfg:12:3: unknown key 'rtae'; did you mean 'rate'?"
class ConfigError : public std::runtime_error {
 public:
  ConfigError(const Place& place, const std::string& text) : std::runtime_error{to_string(place) + ": " + text} {}
};

/// Bounds of a number, both included.
struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
};

/// What `length` and `angle` are written in, for the whole file.
struct Units {
  double metres = 1;
  std::string_view length_name = "m";
  double radians = std::numbers::pi / 180;
  std::string_view angle_name = "degrees";
};

/// One value as it is written, a string without its quotes.
struct Value {
  enum class Type : std::uint8_t { number, text, boolean };

  Type type = Type::text;
  std::string text;
  Place place;
};

/// The device names of a key, each with its place.
struct PlacedName {
  DeviceName name;
  Place place;
};

/// A finite decimal number with an optional sign, fraction and exponent; empty when `text` is anything else.
inline std::optional<double> parse_number(std::string_view text) {
  const bool is_signed = text.starts_with('+') || text.starts_with('-');
  const std::string_view digits = text.substr(is_signed ? 1 : 0);
  if (digits.empty() || !(digits.front() == '.' || (digits.front() >= '0' && digits.front() <= '9'))) return {};
  if (text.starts_with('+')) text = digits;  // which from_chars does not know
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(value)) return {};
  return value;
}

/// true, yes, on, 1 or false, no, off, 0; empty when `text` is anything else.
inline std::optional<bool> parse_boolean(std::string_view text) {
  if (text == "true" || text == "yes" || text == "on" || text == "1") return true;
  if (text == "false" || text == "no" || text == "off" || text == "0") return false;
  return {};
}

/// One section of a `.cfg`, such as `driver( ... )`: keys with their values, each knowing its place.
///
/// A driver's constructor reads it. A reader without fallback demands the key; every reader throws ConfigError when the
/// value has the wrong type or is out of range. One value may be read as a list of one, and the other way round. The
/// section remembers which keys were asked for, so that `check_unused` finds those that nobody knows.
class Section {
 public:
  struct Field {
    std::string key;
    Place place;
    std::vector<Value> values;
    bool inherited = false;  ///< from a template, and so may be set again
  };

  Section() = default;
  Section(std::string type, Place place) : type_{std::move(type)}, place_{std::move(place)} {}

  [[nodiscard]] const std::string& type() const { return type_; }
  [[nodiscard]] const Place& place() const { return place_; }

  [[nodiscard]] bool has(std::string_view key) const { return find(key) != nullptr; }

  /// As written; units are the driver's own.
  [[nodiscard]] double number(std::string_view key, Range range = {}) const {
    return scaled(require(key), 1, "", range);
  }
  [[nodiscard]] double number(std::string_view key, double fallback, Range range = {}) const {
    return has(key) ? number(key, range) : fallback;
  }
  [[nodiscard]] std::vector<double> numbers(std::string_view key, Range range = {}) const {
    return all_scaled(require(key), 1, "", range);
  }
  [[nodiscard]] std::vector<double> numbers(std::string_view key, std::initializer_list<double> fallback,
                                            Range range = {}) const {
    return has(key) ? numbers(key, range) : std::vector<double>{fallback};
  }

  [[nodiscard]] std::int64_t integer(std::string_view key, Range range = {}) const {
    const Field& field = require(key);
    (void)scaled(field, 1, "", range);
    return whole(field);
  }
  [[nodiscard]] std::int64_t integer(std::string_view key, std::int64_t fallback, Range range = {}) const {
    return has(key) ? integer(key, range) : fallback;
  }

  /// true, yes, on, 1; false, no, off, 0.
  [[nodiscard]] bool boolean(std::string_view key) const {
    const Field& field = require(key);
    const auto value = parse_boolean(one(field).text);
    if (one(field).type == Value::Type::text || !value) throw mismatch(field, one(field), "be true or false");
    return *value;
  }
  [[nodiscard]] bool boolean(std::string_view key, bool fallback) const { return has(key) ? boolean(key) : fallback; }

  [[nodiscard]] std::string text(std::string_view key) const { return string(require(key)); }
  [[nodiscard]] std::string text(std::string_view key, std::string fallback) const {
    return has(key) ? text(key) : std::move(fallback);
  }
  [[nodiscard]] std::vector<std::string> texts(std::string_view key) const {
    std::vector<std::string> result;
    const Field& field = require(key);
    result.reserve(field.values.size());
    for (const Value& value : field.values) result.push_back(string(field, value));
    return result;
  }
  [[nodiscard]] std::vector<std::string> texts(std::string_view key, std::vector<std::string> fallback) const {
    return has(key) ? texts(key) : std::move(fallback);
  }

  /// [m], written in the file's `unit_length`. The range and the fallback are in metres.
  [[nodiscard]] double length(std::string_view key, Range range = {}) const {
    return scaled(require(key), units_.metres, units_.length_name, range);
  }
  [[nodiscard]] double length(std::string_view key, double fallback, Range range = {}) const {
    return has(key) ? length(key, range) : fallback;
  }
  [[nodiscard]] std::vector<double> lengths(std::string_view key, Range range = {}) const {
    return all_scaled(require(key), units_.metres, units_.length_name, range);
  }

  /// [rad], written in the file's `unit_angle`, which is degrees unless it says otherwise. The range and the fallback
  /// are in radians.
  [[nodiscard]] double angle(std::string_view key, Range range = {}) const {
    return scaled(require(key), units_.radians, units_.angle_name, range);
  }
  [[nodiscard]] double angle(std::string_view key, double fallback, Range range = {}) const {
    return has(key) ? angle(key, range) : fallback;
  }
  [[nodiscard]] std::vector<double> angles(std::string_view key, Range range = {}) const {
    return all_scaled(require(key), units_.radians, units_.angle_name, range);
  }

  /// Written in seconds, as is the range; at least 0 and, so that it fits, at most 1e9 (31 years).
  [[nodiscard]] Duration duration(std::string_view key, Range range = {}) const {
    const Range fitting{.min = std::max(range.min, 0.0), .max = std::min(range.max, 1e9)};
    return from_seconds(scaled(require(key), 1, "s", fitting));
  }
  [[nodiscard]] Duration duration(std::string_view key, Duration fallback, Range range = {}) const {
    return has(key) ? duration(key, range) : fallback;
  }

  /// A path; a relative one starts from the directory of the file that the value is written in.
  [[nodiscard]] std::filesystem::path file(std::string_view key) const {
    const Field& field = require(key);
    return std::filesystem::path{one(field).place.file}.parent_path() / string(field);
  }

  /// `provides`, `requires`: without the key, none.
  [[nodiscard]] std::vector<PlacedName> device_names(std::string_view key) const {
    std::vector<PlacedName> names;
    if (!has(key)) return names;
    const Field& field = require(key);
    for (const Value& value : field.values) {
      const auto name = parse_device_name(string(field, value));
      if (!name) throw ConfigError{value.place, name.error().what};
      names.push_back({*name, value.place});
    }
    return names;
  }

  /// Where the key's value is written; of a key that is not there, where the section begins.
  [[nodiscard]] Place place_of(std::string_view key) const {
    const Field* field = find(key);
    return field != nullptr && !field->values.empty() ? field->values.front().place : place_;
  }

  /// A driver's own complaint about a key: "robot.cfg:4:10: 'wheels' must be three or four angles".
  [[nodiscard]] ConfigError error(std::string_view key, const std::string& text) const {
    return {place_of(key), quoted(key) + " " + text};
  }

  /// Throws for the first key that nobody asked for. Call it when all readers had their turn.
  void check_unused() const {
    for (const Field& field : fields_) {
      if (!is_asked(field.key))
        throw ConfigError{field.place, "unknown key " + quoted(field.key) + did_you_mean(field.key, asked_)};
    }
  }

  // For the parser.

  [[nodiscard]] const std::vector<Field>& fields() const { return fields_; }
  /// Replaces what a template has set. Throws when the section itself has set the key already.
  void add(Field field) {
    const auto same = std::ranges::find(fields_, field.key, &Field::key);
    if (same == fields_.end()) {
      fields_.push_back(std::move(field));
    } else if (same->inherited) {
      *same = std::move(field);
    } else {
      throw ConfigError{field.place, quoted(field.key) + " is already set at " + to_string(same->place)};
    }
  }
  void set_units(const Units& units) { units_ = units; }

 private:
  static std::string quoted(std::string_view word) { return "'" + std::string{word} + "'"; }

  static ConfigError mismatch(const Field& field, const Value& value, const std::string& must) {
    const bool is_text = value.type == Value::Type::text;
    return {value.place,
            quoted(field.key) + " must " + must + ", not " + (is_text ? '"' + value.text + '"' : value.text)};
  }

  [[nodiscard]] bool is_asked(std::string_view key) const { return std::ranges::find(asked_, key) != asked_.end(); }

  [[nodiscard]] const Field* find(std::string_view key) const {
    if (!is_asked(key)) asked_.emplace_back(key);
    const auto field = std::ranges::find(fields_, key, &Field::key);
    return field == fields_.end() ? nullptr : &*field;
  }

  [[nodiscard]] const Field& require(std::string_view key) const {
    if (const Field* field = find(key)) return *field;
    std::vector<std::string> strangers;
    for (const Field& field : fields_)
      if (!is_asked(field.key)) strangers.push_back(field.key);
    std::string text = "section '" + type_ + "' lacks the key " + quoted(key);
    if (const auto field = std::ranges::find(fields_, closest(key, strangers), &Field::key); field != fields_.end())
      text += "; is " + quoted(field->key) + " at " + to_string(field->place) + " meant?";
    throw ConfigError{place_, text};
  }

  [[nodiscard]] static const Value& one(const Field& field) {
    if (field.values.size() == 1) return field.values.front();
    throw ConfigError{field.values.empty() ? field.place : field.values[1].place,
                      quoted(field.key) + " must be one value, not " + std::to_string(field.values.size())};
  }

  [[nodiscard]] static std::string string(const Field& field) { return string(field, one(field)); }
  [[nodiscard]] static std::string string(const Field& field, const Value& value) {
    if (value.type == Value::Type::text) return value.text;
    throw ConfigError{value.place, quoted(field.key) + " must be text: write \"" + value.text + "\""};
  }

  [[nodiscard]] static double scaled(const Field& field, double scale, std::string_view unit, Range range) {
    return scaled(field, one(field), scale, unit, range);
  }
  [[nodiscard]] static double scaled(const Field& field, const Value& value, double scale, std::string_view unit,
                                     Range range) {
    const auto written = parse_number(value.text);
    if (value.type == Value::Type::text && written)
      throw ConfigError{value.place, quoted(field.key) + " must be a number: write " + value.text + " without quotes"};
    if (!written) throw mismatch(field, value, "be a number");
    const double result = *written * scale;
    if (result >= range.min && result <= range.max) return result;
    const auto bound = [&](double limit) {
      char text[32];
      (void)std::snprintf(text, sizeof text, "%.10g", limit / scale);
      return std::string{text};
    };
    const std::string must = std::isinf(range.max)   ? "at least " + bound(range.min)
                             : std::isinf(range.min) ? "at most " + bound(range.max)
                                                     : "within [" + bound(range.min) + ", " + bound(range.max) + "]";
    throw ConfigError{value.place, quoted(field.key) + " is " + value.text + ", must be " + must +
                                       (unit.empty() ? "" : " " + std::string{unit})};
  }
  [[nodiscard]] static std::vector<double> all_scaled(const Field& field, double scale, std::string_view unit,
                                                      Range range) {
    std::vector<double> result;
    result.reserve(field.values.size());
    for (const Value& value : field.values) result.push_back(scaled(field, value, scale, unit, range));
    return result;
  }

  /// Exact also where a double is not; 1e3 and 5.0 are whole, too.
  [[nodiscard]] static std::int64_t whole(const Field& field) {
    const Value& value = one(field);
    std::string_view text = value.text;
    if (text.starts_with('+')) text.remove_prefix(1);
    std::int64_t result = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), result);
    if (error == std::errc{} && end == text.data() + text.size()) return result;
    const double number = parse_number(text).value_or(0.5);
    if (std::trunc(number) != number || std::abs(number) >= 0x1p63) throw mismatch(field, value, "be a whole number");
    return static_cast<std::int64_t>(number);
  }

  std::string type_;
  Place place_;
  std::vector<Field> fields_;
  Units units_;
  mutable std::vector<std::string> asked_;
};

}  // namespace regista
