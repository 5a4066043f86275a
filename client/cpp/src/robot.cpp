// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/client/robot.hpp>

namespace regista::client {

namespace {

using namespace std::chrono_literals;
constexpr std::size_t most_events = 256;
}  // namespace

Robot::Robot(std::string host, std::uint16_t port, Options options)
    : connection_{std::move(host), port, std::move(options)} {
  (void)connection_.subscribe(server_address,
                              [this](const xdr::Header&, const AnyData& data, Time) { take_notice(data); });
  reconnect();
}

void Robot::reconnect() {
  if (const Result<> connected = connection_.connect(); !connected) {
    const Error::Context context{connection_.host(), connection_.port(), "", "connect"};
    if (connected.error().code.category() == refusal_category()) throw RefusedError{context, connected.error()};
    throw ConnectionError{context, connected.error()};
  }
  note_generation();
}

/// On a new connection nothing that moves is under way any more.
void Robot::note_generation() {
  if (generation_ == connection_.generation()) return;
  generation_ = connection_.generation();
  for (const auto& proxy : proxies_) proxy->forget_motions();
}

bool Robot::read(Duration timeout) {
  const Time until = Clock::now() + std::min<Duration>(timeout, 24h);
  for (;;) {
    Time wake = until;
    const Time now = Clock::now();
    for (const auto& proxy : proxies_) wake = std::min(wake, proxy->keep_alive_at(now));
    const Result<std::size_t> count = connection_.read(wake - now);
    note_generation();
    if (!count) raise("", "read", count.error());
    if (*count > 0) return true;
    if (wake == until) return false;
  }
}

Time Robot::wake_time() const {
  Time wake = connection_.wake_time();
  for (const auto& proxy : proxies_) wake = std::min(wake, proxy->keep_alive_at_.value_or(Time::max()));
  return wake;
}

ProxyBase* Robot::find(Address address) {
  const auto it = std::ranges::find(proxies_, address, [](const auto& proxy) { return proxy->address(); });
  return it == proxies_.end() ? nullptr : it->get();
}

ProxyBase& Robot::open(std::unique_ptr<ProxyBase> proxy) {
  const Address address = proxy->address();
  Result<std::string> driver = connection_.subscribe(address, handler(*proxy));
  if (!driver) raise(to_string(address), "subscribe", driver.error());
  proxy->driver_ = *std::move(driver);
  return *proxies_.emplace_back(std::move(proxy));
}

Connection::OnData Robot::handler(ProxyBase& proxy) {
  return [this, &proxy](const xdr::Header& header, const AnyData& data, Time arrival) {
    proxy.on_data(header, data, arrival);
    if (on_data_) on_data_(header, data, arrival);
  };
}

std::unique_ptr<ProxyBase> Robot::make_proxy(Address address) {
  std::unique_ptr<ProxyBase> proxy;
  any_message(Interfaces{}, [&]<InterfaceType I>() {
    if constexpr (!std::same_as<I, Player>) {
      if (I::code == address.interface) proxy = std::make_unique<typename ProxyFor<I>::Type>(*this, address.index);
    }
    return proxy != nullptr;
  });
  if (!proxy) throw std::invalid_argument{to_string(address) + " is no device that this library speaks"};
  return proxy;
}

ProxyBase& Robot::device(Address address) {
  if (ProxyBase* known = find(address)) return *known;
  return open(make_proxy(address));
}

void Robot::open(Address address, Connection::OnOpen on_open) {
  // A handler is to be copyable, so the proxy is shared until it is open.
  const std::shared_ptr<ProxyBase> proxy = make_proxy(address);
  const Result<> asked = connection_.subscribe(
      address, handler(*proxy), [this, proxy, on_open = std::move(on_open)](const Result<std::string>& driver) {
        if (driver) {
          proxy->driver_ = *driver;
          proxies_.push_back(proxy);
        }
        on_open(driver);
      });
  if (!asked) raise(to_string(address), "subscribe", asked.error());
}

std::vector<Robot::Device> Robot::devices() {
  const auto list = connection_.request(server_address, player::GetDeviceList{});
  if (!list) raise("", "DEVLIST", list.error());
  std::vector<Device> devices;
  for (const player::DeviceAddress& address : list->devices) {
    const auto info = connection_.request(server_address, player::GetDriverInfo{.address = address});
    if (!info) raise("", "DRIVERINFO", info.error());
    devices.push_back({{address.interface, address.index}, std::string{info->driver.view()}});
  }
  return devices;
}

void Robot::stop() {
  for (const auto& proxy : proxies_) proxy->keep_alive(false);
  if (connection_.extended()) {
    const auto stopped = connection_.request(server_address, player::Stop{});
    if (!stopped) raise("", "STOP", stopped.error());
    return;
  }
  for (const auto& proxy : proxies_) {
    if (auto* base = dynamic_cast<Position2dProxy*>(proxy.get())) base->stop();
  }
}

std::vector<player::Event> Robot::events() {
  std::vector<player::Event> events{std::make_move_iterator(events_.begin()), std::make_move_iterator(events_.end())};
  events_.clear();
  return events;
}

std::string Robot::status() {
  const auto status = connection_.request(server_address, player::GetStatus{});
  if (!status) raise("", "GET_STATUS", status.error());
  return std::string{status->json.view()};
}

void Robot::take_notice(const AnyData& data) {
  if (const auto* event = std::get_if<player::Event>(&data)) {
    events_.push_back(*event);
    if (events_.size() > most_events) events_.pop_front();
  } else if (const auto* motion = std::get_if<player::Motion>(&data)) {
    if (ProxyBase* proxy = find({motion->address.interface, motion->address.index})) proxy->take_motion(*motion);
  }
}

void Robot::raise(std::string_view device, std::string_view asked, const regista::Error& cause) const {
  client::raise({connection_.host(), connection_.port(), std::string{device}, std::string{asked}}, cause);
}

}  // namespace regista::client
