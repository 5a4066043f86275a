// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <regista/canopen/open_bus.hpp>
#include <regista/canopen/socket_can.hpp>
#include <regista/canopen/socketcand.hpp>

namespace regista::canopen {

Result<std::unique_ptr<CanBus>> open_bus(const std::string& name) {
  constexpr std::string_view scheme = "socketcand://";
  if (!name.starts_with(scheme)) {
    auto can = SocketCan::open(name);
    if (!can) return can.error();
    return std::unique_ptr<CanBus>{*std::move(can)};
  }
  const std::string rest = name.substr(scheme.size());
  const std::size_t slash = rest.find('/');
  const std::size_t colon = rest.rfind(':', slash);
  if (slash == std::string::npos) return Error{std::errc::invalid_argument, name + ": no /BUS at the end"};
  const std::string host = rest.substr(0, std::min(colon, slash));
  int port = 29536;
  if (colon != std::string::npos) {
    const auto [end, error] = std::from_chars(&rest[colon + 1], &rest[slash], port);
    if (error != std::errc{} || end != &rest[slash]) port = 0;
  }
  if (port < 1 || port > 65535) return Error{std::errc::invalid_argument, name + ": no port"};
  auto can = SocketCand::open(host, static_cast<std::uint16_t>(port), rest.substr(slash + 1), std::chrono::seconds{3});
  if (!can) return can.error();
  return std::unique_ptr<CanBus>{*std::move(can)};
}

}  // namespace regista::canopen
