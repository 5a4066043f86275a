// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstring>
#include <regista/core/result.hpp>
#include <regista/xdr/error.hpp>
#include <regista/xdr/header.hpp>
#include <span>
#include <string>

/// Player's dialect of XDR (RFC 4506): big-endian, in units of 4 bytes, a double aligned to 4 only. A counted array
/// carries its count twice: as the member `x_count` of Player's struct, then as XDR's own array length.
///
/// Everything here works on one message at a time and keeps no state: safe from any thread.
namespace regista::xdr {

namespace detail {

template <typename T>
using Bits = std::conditional_t<sizeof(T) == 8, std::uint64_t, std::uint32_t>;

template <typename T>
concept Scalar = std::is_arithmetic_v<T> || std::is_enum_v<T>;

/// One byte each on the wire, in runs padded to 4; a number alone takes a unit of its own.
template <typename T>
concept Octet = std::same_as<T, std::uint8_t>;

constexpr std::size_t padded(std::size_t size) { return (size + 3) & ~std::size_t{3}; }

/// Bytes that every value of T takes at least, and whether all take just these.
struct Extent {
  std::size_t size;
  bool fixed;
};

template <typename T>
constexpr Extent extent_of() {
  if constexpr (Scalar<T>) {
    return {sizeof(Bits<T>), true};
  } else if constexpr (is_array<T>) {
    constexpr Extent element = extent_of<typename T::value_type>();
    static_assert(!Octet<typename T::value_type>, "no interface needs a run of octets without a count");
    return {element.size * std::tuple_size_v<T>, element.fixed};
  } else if constexpr (is_vector<T> || std::same_as<T, Text>) {
    return {8, false};
  } else if constexpr (is_optional<T>) {
    return {0, false};
  } else {
    return fields<T>.apply([](const auto&... field) {
      return Extent{(std::size_t{0} + ... + extent_of<typename std::remove_cvref_t<decltype(field)>::Value>().size),
                    (true && ... && extent_of<typename std::remove_cvref_t<decltype(field)>::Value>().fixed)};
    });
  }
}

/// C++ converts, we do not: the bits of a float or of a NaN travel as they are. RFC 4506, 4.1 to 4.7.
template <Scalar T>
constexpr Bits<T> to_bits(T value) {
  if constexpr (std::is_enum_v<T>) {
    return to_bits(static_cast<std::underlying_type_t<T>>(value));
  } else if constexpr (std::is_floating_point_v<T>) {
    return std::bit_cast<Bits<T>>(value);
  } else {
    return static_cast<Bits<T>>(value);  // sign-extends what is signed
  }
}

template <Scalar T>
constexpr T from_bits(Bits<T> bits) {
  if constexpr (std::is_floating_point_v<T>) {
    return std::bit_cast<T>(bits);
  } else {
    return static_cast<T>(bits);  // keeps the low bits, as the stock decoder does
  }
}

inline std::uint32_t big_endian(std::uint32_t bits) { return __builtin_bswap32(bits); }
inline std::uint64_t big_endian(std::uint64_t bits) { return __builtin_bswap64(bits); }
static_assert(std::endian::native == std::endian::little);

/// Writes to memory that the caller has measured.
class Writer {
 public:
  explicit Writer(std::byte* at) : at_{at} {}

  template <typename T>
  void put(const T& value) {
    if constexpr (Scalar<T>) {
      const auto bits = big_endian(to_bits(value));
      std::memcpy(at_, &bits, sizeof bits);
      at_ += sizeof bits;
    } else if constexpr (std::same_as<T, Text>) {
      put_octets(value.bytes().data(), value.bytes().size());
    } else if constexpr (is_vector<T>) {
      if constexpr (Octet<typename T::value_type>) {
        put_octets(value.data(), value.size());
      } else {
        put_count(value.size());
        for (const auto& element : value) put(element);
      }
    } else if constexpr (is_array<T>) {
      for (const auto& element : value) put(element);
    } else if constexpr (is_optional<T>) {
      if (value) put(*value);
    } else {
      for_each_field(value, [&](const auto&, const auto& member) { put(member); });
    }
  }

 private:
  void put_count(std::size_t count) {
    put(static_cast<std::uint32_t>(count));
    put(static_cast<std::uint32_t>(count));
  }

  void put_octets(const void* octets, std::size_t count) {
    put_count(count);
    if (count == 0) return;
    std::memset(at_ + padded(count) - 4, 0, 4);
    std::memcpy(at_, octets, count);
    at_ += padded(count);
  }

  std::byte* at_;
};

/// Reads what has a fixed extent and is known to be there; moves `at` behind it.
template <typename T>
void get_unchecked(const std::byte*& at, T& value) {
  if constexpr (Scalar<T>) {
    Bits<T> bits;
    std::memcpy(&bits, at, sizeof bits);
    at += sizeof bits;
    value = from_bits<T>(big_endian(bits));
  } else if constexpr (is_array<T>) {
    for (auto& element : value) get_unchecked(at, element);
  } else {
    for_each_field(value, [&](const auto&, auto& member) { get_unchecked(at, member); });
  }
}

/// Reads a body; remembers where and in which field it failed.
class Reader {
 public:
  explicit Reader(std::span<const std::byte> body) : at_{body.data()}, begin_{at_}, end_{at_ + body.size()} {}

  template <typename T>
  bool get(T& value, std::size_t max_count = unlimited) {
    constexpr Extent extent = extent_of<T>();
    if constexpr (extent.fixed) {
      if (left() >= extent.size) {
        get_unchecked(at_, value);
        return true;
      }
    }
    if constexpr (Scalar<T>) {
      return fail(Errc::short_body, extent.size);
    } else if constexpr (std::same_as<T, Text>) {
      return get_octets(value.bytes(), max_count);
    } else if constexpr (is_vector<T>) {
      return get_vector(value, max_count);
    } else if constexpr (is_array<T>) {
      for (auto& element : value) {
        if (!get(element)) return false;
      }
      return true;
    } else if constexpr (is_optional<T>) {
      value.reset();
      if (left() < extent_of<typename T::value_type>().size) return true;  // a stock peer, or bytes of no concern
      return get(value.emplace());
    } else {
      return fields<T>.apply([&](const auto&... field) { return (get_field(field, value.*(field.member)) && ...); });
    }
  }

  /// How many bytes were read.
  [[nodiscard]] std::size_t position() const { return static_cast<std::size_t>(at_ - begin_); }
  /// Only after a get that returned false. "body ends at byte 20, within `vel.pa` (bytes 16 to 24)"
  [[nodiscard]] Error error() const;

 private:
  template <typename F, typename T>
  bool get_field(const F& field, T& value) {
    if (get(value, field.max_count)) return true;
    path_ = path_.empty() ? std::string{field.wire_name} : std::string{field.wire_name} + '.' + path_;
    return false;
  }

  /// The two counts of an array whose elements take at least `element_size` bytes each.
  bool get_count(std::size_t& count, std::size_t element_size, std::size_t max_count);

  template <typename T>
  bool get_vector(std::vector<T>& value, std::size_t max_count) {
    if constexpr (Octet<T>) {
      return get_octets(value, max_count);
    } else {
      std::size_t count = 0;
      if (!get_count(count, extent_of<T>().size, max_count)) return false;
      value.resize(count);
      for (T& element : value) {
        if constexpr (extent_of<T>().fixed) {
          get_unchecked(at_, element);  // get_count has seen that all are there
        } else if (!get(element)) {
          return false;
        }
      }
      return true;
    }
  }

  template <typename Octets>
  bool get_octets(Octets& value, std::size_t max_count) {
    std::size_t count = 0;
    if (!get_count(count, 1, max_count)) return false;
    value.resize(count);
    if (count > 0) std::memcpy(value.data(), at_, count);
    at_ += padded(count);
    return true;
  }

  bool fail(Errc code, std::size_t needed);
  [[nodiscard]] std::size_t left() const { return static_cast<std::size_t>(end_ - at_); }

  const std::byte* at_;
  const std::byte* begin_;
  const std::byte* end_;
  Errc code_{};
  std::size_t needed_ = 0;
  std::string path_;
};

/// Apart from `decode`, so that its short way is worth inlining.
template <typename T>
[[gnu::noinline]] Result<> decode_checked(std::span<const std::byte> bytes, T& value, std::size_t* used) {
  Reader reader{bytes};
  if (!reader.get(value)) return reader.error();
  if (used != nullptr) *used = reader.position();
  return {};
}

}  // namespace detail

/// Bytes that `value` takes on the wire.
template <Described T>
std::size_t encoded_size(const T& value) {
  constexpr detail::Extent extent = detail::extent_of<T>();
  std::size_t size = extent.size;
  if constexpr (!extent.fixed) {
    for_each_field(value, [&](const auto&, const auto& member) {
      using Member = std::remove_cvref_t<decltype(member)>;
      if constexpr (std::same_as<Member, Text>) {
        size += detail::padded(member.bytes().size());
      } else if constexpr (is_vector<Member>) {
        using Element = typename Member::value_type;
        if constexpr (detail::Octet<Element>) {
          size += detail::padded(member.size());
        } else {
          static_assert(detail::extent_of<Element>().fixed, "no interface nests arrays of arrays");
          size += member.size() * detail::extent_of<Element>().size;
        }
      } else if constexpr (is_optional<Member>) {
        if (member) size += detail::extent_of<typename Member::value_type>().size;
      } else if constexpr (!detail::extent_of<Member>().fixed) {
        size += encoded_size(member) - detail::extent_of<Member>().size;
      }
    });
  }
  return size;
}

/// Encode a whole message into `out`. Returns its size; writes nothing when `out` is smaller.
/// `header.size` is disregarded: the body's own is sent. Counts must not exceed the `max_count` of their fields.
template <Described Body>
std::size_t encode_message(const Header& header, const Body& body, std::span<std::byte> out) {
  const std::size_t body_size = encoded_size(body);
  if (out.size() < header_size + body_size) return header_size + body_size;
  detail::Writer writer{out.data()};
  Header sized = header;
  sized.size = static_cast<std::uint32_t>(body_size);
  writer.put(sized);
  writer.put(body);
  return header_size + body_size;
}

/// Decode a body, or the 40 bytes of a header. Bytes after the last field are disregarded, as every Player decoder
/// does; `used` tells how many were not. On failure `value` holds what came before the error.
/// Memory is taken for elements that are there, never for a claimed count. NaN passes with its bits.
template <Described T>
Result<> decode(std::span<const std::byte> bytes, T& value, std::size_t* used = nullptr) {
  if constexpr (constexpr detail::Extent extent = detail::extent_of<T>(); extent.fixed) {
    if (bytes.size() >= extent.size) {  // most messages, most of the time
      const std::byte* at = bytes.data();
      detail::get_unchecked(at, value);
      if (used != nullptr) *used = extent.size;
      return {};
    }
  }
  return detail::decode_checked(bytes, value, used);
}

}  // namespace regista::xdr
