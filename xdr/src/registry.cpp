// SPDX-License-Identifier: Apache-2.0
#include <regista/xdr/registry.hpp>

namespace regista::xdr {

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

}  // namespace regista::xdr
