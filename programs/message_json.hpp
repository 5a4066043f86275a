// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <regista/xdr/registry.hpp>
#include <stdexcept>

/// Messages as JSON, derived from their fields. Names are Player's; keys stand in wire order. A counted array `x` is
/// preceded by `x_count`. A Text is a string with one code point a byte (U+0000 to U+00FF), its NUL included; other
/// arrays are lists. What JSON cannot say of floats are the strings "inf", "-inf" and "nan".
namespace regista::message_json {

using Json = nlohmann::ordered_json;

/// The JSON is not what the message needs: which field, what is wrong, what would be right.
class Mismatch : public std::runtime_error {
 public:
  Mismatch(const std::string& field, const std::string& what) : std::runtime_error{"`" + field + "`: " + what} {}
};

namespace detail {

template <typename T>
inline constexpr bool is_counted = is_vector<T> || std::same_as<T, Text>;

/// The names of a struct's fields; those of counts come before their arrays.
template <typename T>
std::vector<std::string> names() {
  std::vector<std::string> names;
  const auto add = [&]<typename F>(const F& field) {
    const std::string name{field.wire_name};
    if (is_counted<typename F::Value>) names.push_back(name + "_count");
    names.push_back(name);
  };
  fields<T>.apply([&](const auto&... field) { (add(field), ...); });
  return names;
}

inline std::string latin1_to_utf8(std::string_view bytes) {
  std::string utf8;
  for (const char c : bytes) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x80) {
      utf8 += c;
    } else {
      utf8 += static_cast<char>(0xc0 | (byte >> 6));
      utf8 += static_cast<char>(0x80 | (byte & 0x3f));
    }
  }
  return utf8;
}

/// Of valid UTF-8, which the JSON parser has ensured. Empty when a character is above U+00FF.
inline std::optional<std::string> utf8_to_latin1(std::string_view utf8) {
  std::string bytes;
  for (std::size_t i = 0; i < utf8.size(); ++i) {
    const auto lead = static_cast<unsigned char>(utf8[i]);
    if (lead < 0x80) {
      bytes += utf8[i];
    } else if (lead <= 0xc3 && i + 1 < utf8.size()) {
      bytes += static_cast<char>((lead << 6) | (static_cast<unsigned char>(utf8[++i]) & 0x3f));
    } else {
      return {};
    }
  }
  return bytes;
}

template <std::floating_point T>
Json write_float(T value) {
  if (std::isnan(value)) return "nan";
  if (std::isinf(value)) return value > 0 ? "inf" : "-inf";
  return static_cast<double>(value);
}

template <std::floating_point T>
T read_float(const Json& json, const std::string& path) {
  constexpr T infinity = std::numeric_limits<T>::infinity();
  if (json == "inf") return infinity;
  if (json == "-inf") return -infinity;
  if (json == "nan") return std::numeric_limits<T>::quiet_NaN();
  if (!json.is_number()) throw Mismatch{path, json.dump() + R"( is not a number, "inf", "-inf" or "nan")"};
  const T value = static_cast<T>(json.get<double>());
  if (std::isinf(value)) {
    throw Mismatch{path, json.dump() + " is beyond the largest float of " + std::to_string(8 * sizeof(T)) + " bits, " +
                             Json(static_cast<double>(std::numeric_limits<T>::max())).dump()};
  }
  return value;
}

template <std::integral T>
T read_integer(const Json& json, const std::string& path) {
  // A number that has no sign is kept as unsigned by the parser, else as signed.
  if (json.is_number_unsigned() && std::in_range<T>(json.get<std::uint64_t>())) {
    return static_cast<T>(json.get<std::uint64_t>());
  }
  if (json.is_number_integer() && !json.is_number_unsigned() && std::in_range<T>(json.get<std::int64_t>())) {
    return static_cast<T>(json.get<std::int64_t>());
  }
  throw Mismatch{path, json.dump() + " is not a whole number from " + std::to_string(std::numeric_limits<T>::min()) +
                           " to " + std::to_string(std::numeric_limits<T>::max())};
}

inline void check_members(const Json& json, const std::string& path, const std::vector<std::string>& names) {
  if (!json.is_object()) throw Mismatch{path, json.dump() + " is not an object"};
  for (const auto& member : json.items()) {
    if (std::ranges::find(names, member.key()) != names.end()) continue;
    std::string known;
    for (const std::string& name : names) known.append(known.empty() ? "" : ", ").append(name);
    throw Mismatch{path + '.' + member.key(), "no such field; there are: " + known};
  }
}

inline void check_count(const Json& json, const std::string& path, std::size_t length) {
  if (json != length) {
    throw Mismatch{path,
                   json.dump() + ", but there are " + std::to_string(length) + " elements; correct it or leave it out"};
  }
}

inline std::size_t length(const Text& text) { return text.bytes().size(); }
template <typename T>
std::size_t length(const std::vector<T>& list) {
  return list.size();
}

}  // namespace detail

/// One value: a number, a string, a list, or the object of a struct.
template <typename T>
Json write(const T& value) {
  if constexpr (Described<T>) {
    Json object = Json::object();
    for_each_field(value, [&](const auto& field, const auto& member) {
      using Member = std::remove_cvref_t<decltype(member)>;
      const std::string name{field.wire_name};
      if constexpr (detail::is_counted<Member>) {
        object[name + "_count"] = detail::length(member);
      } else if constexpr (is_optional<Member>) {
        if (!member) return;
      }
      object[name] = write(member);
    });
    return object;
  } else if constexpr (std::same_as<T, Text>) {
    return detail::latin1_to_utf8(value.bytes());
  } else if constexpr (is_vector<T> || is_array<T>) {
    Json list = Json::array();
    for (const auto& element : value) list.push_back(write(element));
    return list;
  } else if constexpr (is_optional<T>) {
    return write(*value);
  } else if constexpr (std::is_enum_v<T>) {
    return static_cast<std::underlying_type_t<T>>(value);
  } else if constexpr (std::is_floating_point_v<T>) {
    return detail::write_float(value);
  } else {
    return value;
  }
}

/// The reverse of `write`. Counts may be left out. Throws Mismatch; `path` is what it calls the value.
template <typename T>
void read(const Json& json, T& value, const std::string& path, std::size_t max_count = unlimited) {
  if constexpr (Described<T>) {
    detail::check_members(json, path, detail::names<T>());
    for_each_field(value, [&](const auto& field, auto& member) {
      using Member = std::remove_cvref_t<decltype(member)>;
      const std::string inner = path + '.' + std::string{field.wire_name};
      const auto found = json.find(field.wire_name);
      if (found == json.end()) {
        if constexpr (is_optional<Member>) return member.reset();
        throw Mismatch{inner, "missing"};
      }
      read(*found, member, inner, field.max_count);
      if constexpr (detail::is_counted<Member>) {
        const auto count = json.find(std::string{field.wire_name} + "_count");
        if (count != json.end()) detail::check_count(*count, inner + "_count", detail::length(member));
      }
    });
  } else if constexpr (std::same_as<T, Text>) {
    if (!json.is_string()) throw Mismatch{path, json.dump() + " is not a string"};
    auto bytes = detail::utf8_to_latin1(json.get_ref<const std::string&>());
    if (!bytes) {
      throw Mismatch{path, json.dump(-1, ' ', true) + " has a character above U+00FF; write one character a byte"};
    }
    if (bytes->size() > max_count) {
      throw Mismatch{path, std::to_string(bytes->size()) + " bytes, at most " + std::to_string(max_count) + " fit"};
    }
    value = Text::from_bytes(*std::move(bytes));
  } else if constexpr (is_vector<T> || is_array<T>) {
    if (!json.is_array()) throw Mismatch{path, json.dump() + " is not a list"};
    if constexpr (is_vector<T>) {
      if (json.size() > max_count) {
        throw Mismatch{path, std::to_string(json.size()) + " elements, at most " + std::to_string(max_count) + " fit"};
      }
      value.resize(json.size());
    } else if (json.size() != value.size()) {
      throw Mismatch{path, std::to_string(json.size()) + " elements instead of " + std::to_string(value.size())};
    }
    for (std::size_t i = 0; i < json.size(); ++i) read(json[i], value[i], path + '[' + std::to_string(i) + ']');
  } else if constexpr (is_optional<T>) {
    read(json, value.emplace(), path);
  } else if constexpr (std::is_enum_v<T>) {
    value = static_cast<T>(detail::read_integer<std::underlying_type_t<T>>(json, path));
  } else if constexpr (std::is_floating_point_v<T>) {
    value = detail::read_float<T>(json, path);
  } else {
    value = detail::read_integer<T>(json, path);
  }
}

/// A whole message: {"header": …, "fields": …}; `fields` is null for an empty body. `used` tells how many bytes of the
/// body belong to fields.
inline Result<Json> decode(const xdr::Header& header, std::span<const std::byte> body, std::size_t& used) {
  Json message{{"header", write(header)}, {"fields", nullptr}};
  Result<> decoded;
  used = 0;
  const bool known = xdr::with_body_type(header, [&]<typename Body>() {
    if (body.empty() || field_count<Body> == 0) return;
    Body value;
    decoded = xdr::decode(body, value, &used);
    if (decoded) message["fields"] = write(value);
  });
  if (!known) return xdr::unknown_message(header);
  if (!decoded) return decoded.error();
  return message;
}

/// The bytes of a whole message. `header.size` may be left out. Throws Mismatch.
inline Result<std::vector<std::byte>> encode(const Json& message) {
  detail::check_members(message, "message", {"header", "fields"});
  for (const char* key : {"header", "fields"}) {
    if (!message.contains(key)) throw Mismatch{key, "missing"};
  }
  Json header_json = message["header"];
  const bool has_size = header_json.contains("size");
  if (header_json.is_object() && !has_size) header_json["size"] = 0;
  xdr::Header header;
  read(header_json, header, "header");

  std::vector<std::byte> bytes;
  const auto encode_body = [&](const auto& body) {
    bytes.resize(xdr::header_size + xdr::encoded_size(body));
    xdr::encode_message(header, body, bytes);
  };
  const Json& fields_json = message["fields"];
  const bool known = xdr::with_body_type(header, [&]<typename Body>() {
    if (fields_json.is_null()) return encode_body(Empty{});
    Body body;
    read(fields_json, body, "fields");
    encode_body(body);
  });
  if (!known) return xdr::unknown_message(header);
  const std::size_t size = bytes.size() - xdr::header_size;
  if (has_size && header.size != size) {
    throw Mismatch{"header.size", std::to_string(header.size) + ", but the body takes " + std::to_string(size) +
                                      " bytes; correct it or leave it out"};
  }
  return bytes;
}

}  // namespace regista::message_json
