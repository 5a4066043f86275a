// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <regista/canopen/object_dictionary.hpp>

namespace regista::canopen {
namespace {

Error invalid(std::string what) { return {std::errc::invalid_argument, std::move(what)}; }

std::string lower(std::string_view text) {
  std::string result{text};
  for (char& c : result) {
    if ('A' <= c && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return result;
}

/// Decimal, hex after 0x, octal after 0; a sign before. Nothing else around it.
std::optional<std::pair<std::uint64_t, bool>> magnitude(std::string_view text) {
  const bool negative = text.starts_with('-');
  if (negative || text.starts_with('+')) text.remove_prefix(1);
  int base = 10;
  if (text.starts_with("0x") || text.starts_with("0X")) {
    base = 16;
    text.remove_prefix(2);
  } else if (text.size() > 1 && text.starts_with('0')) {
    base = 8;
    text.remove_prefix(1);
  }
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  if (error != std::errc{} || end != text.data() + text.size() || text.empty()) return {};
  return std::pair{value, negative};
}

Result<Bytes> encode_integer(DataType type, std::string_view text) {
  const std::size_t size = size_of(type);
  const int bits = static_cast<int>(8 * size);
  const std::uint64_t most = bits == 64 ? ~0ULL : (1ULL << bits) - 1;
  if (type == DataType::boolean && (lower(text) == "true" || lower(text) == "false"))
    return Bytes{lower(text) == "true"};
  const auto parsed = magnitude(text);
  if (!parsed) return invalid("'" + std::string{text} + "' is no whole number");
  const auto [value, negative] = *parsed;
  const std::uint64_t half = 1ULL << (bits - 1);
  // In hex a signed number may be given as its bits: 0xFFFF is -1 in 16 bits.
  const bool as_bits = text.starts_with("0x") || text.starts_with("0X");
  bool fits = negative ? value == 0 : value <= (type == DataType::boolean ? 1 : most);
  if (is_signed(type)) fits = negative ? value <= half : value < half || (as_bits && value <= most);
  if (!fits) {
    return Error{std::errc::result_out_of_range, "'" + std::string{text} + "' does not fit into " +
                                                     std::to_string(bits) +
                                                     (is_signed(type) ? " bits, signed" : " bits")};
  }
  return le_bytes(negative ? ~value + 1 : value, size);
}

Result<Bytes> encode_real(DataType type, std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) {
    // As bits, as some tools write it.
    if (const auto bits = magnitude(text); bits && text.starts_with("0x")) return le_bytes(bits->first, size_of(type));
    return invalid("'" + std::string{text} + "' is no number");
  }
  if (type == DataType::real64) return le_bytes(std::bit_cast<std::uint64_t>(value), 8);
  return le_bytes(std::bit_cast<std::uint32_t>(static_cast<float>(value)), 4);
}

/// "01 02 FF" or "0102FF"; empty if it is none.
std::optional<Bytes> from_hex(std::string_view text) {
  std::string digits;
  for (const char c : text) {
    if (c != ' ') digits += c;
  }
  if (digits.size() % 2 != 0) return {};
  Bytes bytes(digits.size() / 2);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const char* at = digits.data() + 2 * i;
    const auto [end, error] = std::from_chars(at, at + 2, bytes[i], 16);
    if (error != std::errc{} || end != at + 2) return {};
  }
  return bytes;
}

std::string to_hex(ByteView bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) text += (text.empty() ? "" : " ") + hex(byte, 2);
  return text;
}

bool is_integer(DataType type) {
  return size_of(type) != 0 && type != DataType::real32 && type != DataType::real64 && type != DataType::time_of_day &&
         type != DataType::time_difference;
}

/// Communication parameters of PDOs, and their mappings.
bool is_pdo(std::uint16_t index) { return 0x1400 <= index && index < 0x1C00; }
std::uint16_t parameters_of(std::uint16_t index) {
  return static_cast<std::uint16_t>((index & 0x0200U) != 0 ? index - 0x0200 : index);
}

}  // namespace

std::size_t size_of(DataType type) {
  switch (type) {
    case DataType::boolean:
    case DataType::integer8:
    case DataType::unsigned8:
      return 1;
    case DataType::integer16:
    case DataType::unsigned16:
      return 2;
    case DataType::integer24:
    case DataType::unsigned24:
      return 3;
    case DataType::integer32:
    case DataType::unsigned32:
    case DataType::real32:
      return 4;
    case DataType::integer40:
    case DataType::unsigned40:
      return 5;
    case DataType::integer48:
    case DataType::unsigned48:
    case DataType::time_of_day:
    case DataType::time_difference:
      return 6;
    case DataType::integer56:
    case DataType::unsigned56:
      return 7;
    case DataType::integer64:
    case DataType::unsigned64:
    case DataType::real64:
      return 8;
    case DataType::visible_string:
    case DataType::octet_string:
    case DataType::unicode_string:
    case DataType::domain:
      return 0;
  }
  return 0;
}

bool is_signed(DataType type) {
  const auto number = static_cast<int>(type);
  return (0x02 <= number && number <= 0x04) || number == 0x10 || (0x12 <= number && number <= 0x15);
}

Result<Bytes> encode(DataType type, std::string_view text) {
  if (is_integer(type)) return encode_integer(type, text);
  if (type == DataType::real32 || type == DataType::real64) return encode_real(type, text);
  if (type == DataType::visible_string) return Bytes(text.begin(), text.end());
  auto bytes = from_hex(text);
  if (!bytes) return invalid("'" + std::string{text} + "' is not made of pairs of hex digits");
  if (size_of(type) != 0 && bytes->size() != size_of(type)) {
    return invalid("'" + std::string{text} + "' has not " + std::to_string(size_of(type)) + " bytes");
  }
  return *std::move(bytes);
}

std::string format(DataType type, ByteView bytes) {
  if (type == DataType::visible_string) return {bytes.begin(), std::ranges::find(bytes, std::uint8_t{0})};
  if (size_of(type) == 0 || bytes.size() != size_of(type)) return to_hex(bytes);
  if (type == DataType::real32) {
    return std::to_string(std::bit_cast<float>(static_cast<std::uint32_t>(get_le(bytes))));
  }
  if (type == DataType::real64) return std::to_string(std::bit_cast<double>(get_le(bytes)));
  if (!is_integer(type)) return to_hex(bytes);
  const std::uint64_t value = get_le(bytes);
  if (!is_signed(type)) return std::to_string(value);
  const std::uint64_t sign = 1ULL << (8 * bytes.size() - 1);
  return std::to_string(static_cast<std::int64_t>((value ^ sign) - sign));
}

const ObjectEntry* ObjectDictionary::find(ObjectIndex object) const {
  const auto found = objects.find(object);
  return found == objects.end() ? nullptr : &found->second;
}

Result<ObjectIndex> ObjectDictionary::parse(std::string_view text) const {
  std::string_view digits = text;
  if (digits.starts_with("0x") || digits.starts_with("0X")) digits.remove_prefix(2);
  const std::size_t colon = std::min(digits.find(':'), digits.size());
  ObjectIndex object;
  const std::string_view index = digits.substr(0, colon);
  const auto [end, error] = std::from_chars(index.data(), index.data() + index.size(), object.index, 16);
  if (error == std::errc{} && end == index.data() + index.size() && index.size() == 4) {
    if (colon == digits.size()) return object;
    std::string_view sub = digits.substr(colon + 1);
    if (sub.starts_with("0x")) sub.remove_prefix(2);
    const auto [sub_end, sub_error] = std::from_chars(sub.data(), sub.data() + sub.size(), object.sub, 16);
    if (sub_error == std::errc{} && sub_end == sub.data() + sub.size()) return object;
  }
  const std::string wanted = lower(text);
  std::vector<ObjectIndex> whole;
  std::vector<ObjectIndex> similar;
  for (const auto& [place, entry] : objects) {
    const std::string name = lower(entry.name);
    const std::size_t slash = name.rfind(" / ");
    if (name == wanted) return place;
    if (slash != std::string::npos && name.substr(slash + 3) == wanted) whole.push_back(place);
    if (!wanted.empty() && name.find(wanted) != std::string::npos) similar.push_back(place);
  }
  if (whole.size() == 1) return whole.front();
  std::string what = "no object '" + std::string{text} + "'";
  if (!whole.empty()) what = "several objects are called '" + std::string{text} + "'";
  const std::vector<ObjectIndex>& candidates = whole.empty() ? similar : whole;
  for (std::size_t i = 0; i < std::min<std::size_t>(candidates.size(), 5); ++i) {
    what += (i == 0 ? "; did you mean " : ", ") + to_string(candidates[i]) + " '" + find(candidates[i])->name + "'";
  }
  return invalid(what);
}

std::vector<SdoWrite> ObjectDictionary::configuration() const {
  std::vector<SdoWrite> writes;
  std::vector<std::uint16_t> pdos;
  for (const auto& [place, entry] : objects) {
    if (!entry.configured || !entry.writable()) continue;
    if (place.index == 0x1010 || place.index == 0x1011) continue;  // commands: store, restore
    if (!is_pdo(place.index)) {
      writes.push_back({place, *entry.configured, true, entry.readable()});
    } else if (const auto pdo = parameters_of(place.index); std::ranges::find(pdos, pdo) == pdos.end()) {
      pdos.push_back(pdo);
    }
  }
  for (const std::uint16_t parameters : pdos) {
    const auto mapping = static_cast<std::uint16_t>(parameters + 0x0200);
    const ObjectEntry* cob_id = find({parameters, 1});
    const Bytes* on = cob_id == nullptr ? nullptr : cob_id->configured ? &*cob_id->configured : &cob_id->value;
    if (on != nullptr && on->size() == 4) {
      writes.push_back(
          sdo_write<std::uint32_t>({parameters, 1}, static_cast<std::uint32_t>(get_le(*on)) | 0x80000000U));
    }
    const auto put = [&](std::uint16_t index, int from) {
      for (auto at = objects.lower_bound({index, static_cast<std::uint8_t>(from)});
           at != objects.end() && at->first.index == index; ++at) {
        if (at->second.configured && at->second.writable()) writes.push_back({at->first, *at->second.configured});
      }
    };
    put(parameters, 2);
    const ObjectEntry* count = find({mapping, 0});
    if (count != nullptr && count->writable()) {
      writes.push_back(sdo_write<std::uint8_t>({mapping, 0}, 0));
      put(mapping, 1);
      writes.push_back({{mapping, 0}, count->configured ? *count->configured : count->value});
    }
    if (on != nullptr && on->size() == 4) writes.push_back({{parameters, 1}, *on});
  }
  return writes;
}

Bytes concise_dcf(std::span<const SdoWrite> writes) {
  Bytes bytes = le_bytes(writes.size(), 4);
  const auto put = [&](std::uint64_t value, std::size_t size) {
    const Bytes more = le_bytes(value, size);
    bytes.insert(bytes.end(), more.begin(), more.end());
  };
  for (const SdoWrite& write : writes) {
    put(write.object.index, 2);
    put(write.object.sub, 1);
    put(write.value.size(), 4);
    bytes.insert(bytes.end(), write.value.begin(), write.value.end());
  }
  return bytes;
}

Result<std::vector<SdoWrite>> parse_concise_dcf(ByteView bytes) {
  std::vector<SdoWrite> writes;
  std::size_t at = 0;
  bool short_of_bytes = false;
  const auto take = [&](std::size_t size) {
    short_of_bytes = short_of_bytes || bytes.size() - at < size;
    if (short_of_bytes) return ByteView{};
    at += size;
    return bytes.subspan(at - size, size);
  };
  const auto count = static_cast<std::uint32_t>(get_le(take(4)));
  for (std::uint32_t i = 0; i < count && !short_of_bytes; ++i) {
    SdoWrite write;
    write.object.index = static_cast<std::uint16_t>(get_le(take(2)));
    write.object.sub = static_cast<std::uint8_t>(get_le(take(1)));
    const ByteView value = take(get_le(take(4)));
    write.value.assign(value.begin(), value.end());
    if (!short_of_bytes) writes.push_back(std::move(write));
  }
  if (short_of_bytes || at != bytes.size()) {
    return invalid("concise DCF: " + std::to_string(count) + " entries announced, " + std::to_string(writes.size()) +
                   " found in " + std::to_string(bytes.size()) + " bytes");
  }
  return writes;
}

}  // namespace regista::canopen
