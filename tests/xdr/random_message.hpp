// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <random>
#include <regista/xdr/codec.hpp>

namespace regista {

/// Fills any described value from its fields: every bit pattern of every number, NaN with payloads among them.
class RandomMessage {
 public:
  enum class Optional { sometimes, never };
  explicit RandomMessage(std::uint64_t seed, Optional optional = Optional::sometimes)
      : random_{seed}, optional_{optional} {}

  template <typename T>
  void fill(T& value, std::size_t max_count = unlimited) {
    if constexpr (Described<T>) {
      for_each_field(value, [&](const auto& field, auto& member) { fill(member, field.max_count); });
    } else if constexpr (std::same_as<T, Text>) {
      value.bytes().resize(count(max_count));
      for (char& byte : value.bytes()) byte = static_cast<char>(random_());
    } else if constexpr (is_vector<T>) {
      value.resize(count(max_count));
      for (auto& element : value) fill(element);
    } else if constexpr (is_array<T>) {
      for (auto& element : value) fill(element);
    } else if constexpr (is_optional<T>) {
      value.reset();
      if (optional_ == Optional::sometimes && random_() % 2 == 0) fill(value.emplace());
    } else if constexpr (std::is_floating_point_v<T>) {
      auto bits = static_cast<xdr::detail::Bits<T>>(random_());
      constexpr xdr::detail::Bits<T> exponent = sizeof(T) == 8 ? 0x7ff0'0000'0000'0000 : 0x7f80'0000;
      if (random_() % 4 == 0) bits |= exponent;  // a NaN, nearly always
      value = std::bit_cast<T>(bits);
    } else {
      value = static_cast<T>(random_());
    }
  }

 private:
  std::size_t count(std::size_t max_count) { return std::min<std::size_t>(random_() % 9, max_count); }

  std::mt19937_64 random_;
  Optional optional_;
};

}  // namespace regista
