// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <regista/xdr/registry.hpp>

namespace regista::xdr {

namespace {

/// Where the messages of a list stand in it, sorted by key.
template <typename Messages>
struct Index;
template <typename... Ms>
struct Index<TypeList<Ms...>> {
  struct Entry {
    std::uint32_t key;
    std::size_t alternative;
  };
  static constexpr auto entries = [] {
    std::array<Entry, sizeof...(Ms)> table{};
    std::size_t i = 0;
    ((table[i] = {detail::message_key(Ms::message.interface, Ms::message.subtype), i}, ++i), ...);
    std::ranges::sort(table, {}, &Entry::key);
    return table;
  }();
  static_assert(std::ranges::adjacent_find(entries, {}, &Entry::key) == entries.end(), "two messages of one subtype");

  static constexpr std::size_t find(std::uint16_t interface, std::uint8_t subtype) {
    const std::uint32_t key = detail::message_key(interface, subtype);
    const auto* entry = std::ranges::lower_bound(entries, key, {}, &Entry::key);
    return entry != entries.end() && entry->key == key ? entry->alternative : std::variant_npos;
  }
};

}  // namespace

Error unknown_message(const Header& header) {
  const std::string_view name = interface_name(header.address.interface);
  if (name.empty()) return {Errc::unknown_interface, "interface " + std::to_string(header.address.interface)};
  constexpr std::array<std::string_view, 7> kinds{
      "message of type 0", "data", "command", "request", "reply", "synch", "refusal"};
  const auto kind = static_cast<std::size_t>(header.kind);
  return {Errc::unknown_message,
          std::string{name} + " has no " +
              (kind < kinds.size() ? std::string{kinds[kind]} : "message of type " + std::to_string(kind)) +
              " of subtype " + std::to_string(header.subtype)};
}

std::string message_title(std::uint16_t interface, const Message& message) {
  return std::string{interface_name(interface)} + ' ' + std::string{message.name};
}

template <Kind kind>
Result<> decode_any(const Header& header, std::span<const std::byte> body, Any<kind>& out) {
  const std::size_t wanted = Index<typename Any<kind>::Messages>::find(header.address.interface, header.subtype);
  const auto decode_as = [&]<typename M>() -> Result<> {
    M* message = std::get_if<M>(&out);
    if (message == nullptr) message = std::get_if<M>(&(out = Any<kind>{std::in_place_type<M>}));
    Result<> decoded = decode(body, *message);
    if (decoded) return {};
    return Error{decoded.error().code,
                 message_title(header.address.interface, M::message) + ": " + decoded.error().what};
  };
  using Decode = Result<> (*)(const decltype(decode_as)&);
  constexpr auto decoders = []<typename... Ms>(TypeList<Ms...>) {
    return std::array<Decode, sizeof...(Ms)>{
        [](const decltype(decode_as)& decoder) { return decoder.template operator()<Ms>(); }...};
  }(typename Any<kind>::Messages{});
  if (wanted == std::variant_npos) return unknown_message(header);
  return decoders[wanted](decode_as);
}

template Result<> decode_any(const Header& header, std::span<const std::byte> body, AnyData& out);
template Result<> decode_any(const Header& header, std::span<const std::byte> body, AnyCommand& out);
template Result<> decode_any(const Header& header, std::span<const std::byte> body, AnyRequest& out);

}  // namespace regista::xdr
