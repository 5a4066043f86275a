// SPDX-License-Identifier: Apache-2.0
// How a server is put together from its .cfg.
#include <algorithm>
#include <set>

#include "impl.hpp"
#include "remote.hpp"

namespace regista {

namespace {

std::string address_text(std::uint16_t interface, std::uint16_t index) {
  return std::string{interface_name(interface)} + ':' + std::to_string(index);
}

}  // namespace

Server::Impl::Impl(const ConfigFile& config, ServerOptions options)
    : options_{std::move(options)},
      plugins_{options_.plugins, options_.plugin_folders},
      epoch_offset_s_{std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count() -
                      seconds(Clock::now().time_since_epoch())} {
  read_server_section(config.server, options_);
  for (const Value& statement : config.plugins) plugins_.load(statement);
  for (const Section& section : config.drivers) make_driver(section);
  if (devices_.empty()) {
    throw ConfigError{config.server.place(),
                      "no device is offered: a driver needs `provides`, such as [\"position2d:0\"]"};
  }
  join_required();
  listen(config.server, options_);
  config.server.check_unused();
}

Server::Impl::~Impl() {
  for (Hosted& hosted : drivers_) hosted.thread.reset();
}

void Server::Impl::read_server_section(const Section& section, const ServerOptions& options) {
  default_port_ =
      options.port.value_or(static_cast<std::uint16_t>(section.integer("port", 6665, {.min = 0, .max = 65535})));
  max_clients_ = static_cast<std::size_t>(section.integer("max_clients", 2048, {.min = 1, .max = 100'000}));
  const std::int64_t connection_rate =
      section.integer("connection_rate", connection_limiter_.rate(), {.min = 1, .max = 100'000});
  connection_limiter_ = ConnectionLimiter{static_cast<int>(connection_rate)};
  limits_.max_message =
      static_cast<std::size_t>(section.integer("max_message", 1 << 20, {.min = 1024, .max = 8 << 20}));
  max_pending_ = static_cast<std::size_t>(section.integer("max_pending", 256 << 20, {.min = 1 << 20, .max = 1 << 30}));
  hang_exit_ = section.duration("hang_exit", std::chrono::seconds{10}, {.min = 0.1, .max = 3600});
  realtime_ = static_cast<int>(section.integer("realtime", 0, {.min = 0, .max = 99}));
}

void Server::Impl::make_driver(const Section& section) {
  auto setup = std::make_unique<Setup>(section);
  const Section& config = setup->config;
  const Plugin& plugin = plugins_.find(config);
  HostOptions host_options{.rate_hz = config.number("rate", plugin.rate_hz, {.min = 0, .max = 10'000}),
                           .always_on = config.boolean("alwayson", false)};
  host_options.priority = static_cast<std::int32_t>(config.integer("priority", 10, {.min = 0, .max = 100}));
  const MotionPolicy policy = MotionPolicy::read(config);
  const std::vector<PlacedName> sensors = config.device_names("sensors");
  (void)config.has("provides");
  (void)config.has("requires");

  std::unique_ptr<Driver> driver;
  try {
    driver = plugin.create(*setup);
  } catch (const ConfigError&) {
    throw;
  } catch (const std::exception& exception) {
    throw ConfigError{config.place(), "driver '" + std::string{plugin.name} + "': " + exception.what()};
  }
  config.check_unused();

  Hosted& hosted = drivers_.emplace_back();
  hosted.number = drivers_.size() - 1;
  hosted.name = plugin.name;
  hosted.stops_by_itself = plugin.stops_by_itself;
  const auto provides = config.device_names("provides");
  std::vector<bool> used(provides.size(), false);
  for (PortCore& port : setup->ports) {
    // As in Player: a port with a key takes only that entry; one without takes any of its interface.
    const auto fits = [&](const PlacedName& p) {
      const auto i = static_cast<std::size_t>(&p - provides.data());
      return !used[i] && p.name.interface == port.interface && (port.key.empty() || p.name.key == port.key);
    };
    const auto found = std::ranges::find_if(provides, fits);
    if (found == provides.end()) continue;
    used[static_cast<std::size_t>(found - provides.begin())] = true;
    if (!found->name.host.empty())
      throw ConfigError{found->place, "a provided device has no host: it is on this server"};
    port.offered = true;
    port.index = found->name.index;
    port.tcp_port = listener_of(found->name.port);
    const Device device{port.tcp_port, port.interface, port.index};
    if (!devices_.try_emplace(device, Target{drivers_.size() - 1, port.number}).second) {
      throw ConfigError{found->place, "device '" + address_text(port.interface, port.index) + "' is provided twice"};
    }
  }
  if (const auto unused = std::ranges::find(used, false); unused != used.end()) {
    const PlacedName& name = provides[static_cast<std::size_t>(unused - used.begin())];
    throw ConfigError{name.place, "driver '" + hosted.name + "' does not provide '" + to_string(name.name) + "'"};
  }
  host_options.motion.assign(setup->ports.size(), policy);
  for (const PlacedName& sensor : sensors) {
    const auto port = std::ranges::find_if(setup->ports, [&](const PortCore& p) {
      return p.offered && p.interface == sensor.name.interface && p.index == sensor.name.index;
    });
    if (port == setup->ports.end()) {
      throw ConfigError{sensor.place, "'" + to_string(sensor.name) + "' is not among what this driver provides"};
    }
    host_options.motion[port->number].sensor = true;
  }
  hosted.ports.resize(setup->ports.size());
  hosted.host = std::make_unique<DriverHost>(hosted.name, std::move(setup), std::move(driver), std::move(host_options));
  hosted.link = &hosted.host->add_link(&wakeup_);
}

void Server::Impl::join_required() {
  SessionId next = first_driver_session;
  std::vector<std::set<std::size_t>> stands_on(drivers_.size());
  for (std::size_t i = 0; i < stands_on.size(); ++i) {  // more are made for devices of other servers
    DriverHost& consumer = *drivers_[i].host;
    const std::vector<PlacedName> names = consumer.config().device_names("requires");
    std::vector<bool> used(names.size(), false);
    std::map<std::pair<std::string, std::uint16_t>, std::vector<RequiredCore*>> elsewhere;
    for (RequiredCore& required : consumer.required()) {
      const auto found = std::ranges::find_if(names, [&](const PlacedName& p) {
        const auto n = static_cast<std::size_t>(&p - names.data());
        return !used[n] && p.name.interface == required.interface &&
               (required.key.empty() || p.name.key == required.key);
      });
      if (found == names.end()) {
        throw ConfigError{consumer.config().place_of("requires"), "driver '" + drivers_[i].name + "' needs a " +
                                                                      std::string{interface_name(required.interface)} +
                                                                      "; add it to `requires`, such as [\"" +
                                                                      address_text(required.interface, 0) + "\"]"};
      }
      used[static_cast<std::size_t>(found - names.begin())] = true;
      required.index = found->name.index;
      if (!found->name.host.empty()) {
        constexpr std::uint16_t usual_port = 6665;
        const std::uint16_t port = found->name.port == 0 ? usual_port : found->name.port;
        elsewhere[{found->name.host, port}].push_back(&required);
        continue;
      }
      const auto device = devices_.find({listener_of(found->name.port), found->name.interface, found->name.index});
      if (device == devices_.end()) {
        throw ConfigError{found->place, "no driver provides '" + to_string(found->name) + "'"};
      }
      const auto [provider, port] = device->second;
      stands_on[i].insert(provider);
      join(consumer, required, *drivers_[provider].host, port, next++);
    }
    if (const auto unused = std::ranges::find(used, false); unused != used.end()) {
      const PlacedName& name = names[static_cast<std::size_t>(unused - used.begin())];
      throw ConfigError{name.place, "driver '" + drivers_[i].name + "' has no use for '" + to_string(name.name) + "'"};
    }
    for (const auto& [server, required] : elsewhere) join_remote(i, server.first, server.second, required, next);
  }
  // Whoever can reach himself over what he stands on would wait for himself.
  for (std::size_t start = 0; start < stands_on.size(); ++start) {
    std::set<std::size_t> reached = stands_on[start];
    for (std::size_t size = 0; size != reached.size();) {
      size = reached.size();
      for (const std::size_t below : std::set{reached})
        reached.insert(stands_on[below].begin(), stands_on[below].end());
    }
    if (reached.contains(start)) {
      throw ConfigError{drivers_[start].host->config().place_of("requires"),
                        "driver '" + drivers_[start].name + "' requires itself, over the drivers that it requires"};
    }
  }
}

void Server::Impl::join_remote(std::size_t consumer, const std::string& host, std::uint16_t port,
                               std::span<RequiredCore* const> required, SessionId& next_session) {
  DriverHost& user = *drivers_[consumer].host;
  std::vector<client::Address> devices;
  const auto number_of = [&](const RequiredCore& r) {
    const auto known = std::ranges::find(devices, client::Address{r.interface, r.index});
    return static_cast<std::size_t>(known - devices.begin());
  };
  for (const RequiredCore* r : required) {
    if (number_of(*r) == devices.size()) devices.push_back({r->interface, r->index});
  }
  constexpr double keep_alive_rate_hz = 20;
  auto setup = std::make_unique<Setup>(Section{"driver", user.config().place()});
  auto remote = std::make_unique<Remote>(*setup, host, port, devices, user.name(), user.priority());
  Hosted& hosted = drivers_.emplace_back();
  hosted.number = drivers_.size() - 1;
  hosted.name = host + ':' + std::to_string(port);
  hosted.stops_by_itself = true;  // the other server sees that the connection is gone
  hosted.ports.resize(devices.size());
  hosted.host = std::make_unique<DriverHost>(hosted.name, std::move(setup), std::move(remote),
                                             HostOptions{.rate_hz = keep_alive_rate_hz});
  hosted.link = &hosted.host->add_link(&wakeup_);
  for (RequiredCore* r : required) join(user, *r, *hosted.host, number_of(*r), next_session++);
}

void Server::Impl::listen(const Section& section, const ServerOptions& options) {
  const std::vector<std::string> configured = section.texts("listen", {});
  const std::vector<std::string>& wanted_addresses = options.listen.empty() ? configured : options.listen;
  const bool by_default = wanted_addresses.empty();
  const std::vector<std::string> addresses = by_default ? std::vector<std::string>{"127.0.0.1"} : wanted_addresses;
  // The default port may be "any": it is known once the first listener has it.
  std::map<std::uint16_t, std::uint16_t> actual;
  std::set<std::uint16_t> ports{0};
  for (const auto& [device, target] : devices_) ports.insert(device.tcp_port);
  for (const std::uint16_t port : ports) {
    for (const std::string& address : addresses) {
      const std::uint16_t wanted = actual.contains(port) ? actual[port] : port == 0 ? default_port_ : port;
      listeners_.push_back(std::make_unique<Listener>(
          io_, address, wanted, [this](asio::ip::tcp::socket socket) { accept(std::move(socket)); }));
      actual[port] = listeners_.back()->port();
    }
    if (by_default) {
      try {  // a machine without IPv6 is fine with IPv4 alone
        listeners_.push_back(std::make_unique<Listener>(
            io_, "::1", actual[port], [this](asio::ip::tcp::socket socket) { accept(std::move(socket)); }));
      } catch (const ListenError&) {
        continue;
      }
    }
  }
  std::map<Device, Target> devices;
  for (const auto& [device, target] : devices_) {
    const Device known{actual[device.tcp_port], device.interface, device.index};
    devices.emplace(known, target);
    drivers_[target.driver].ports[target.port].device = known;
  }
  devices_ = std::move(devices);
  if (section.has("metrics_port")) {
    const auto port = static_cast<std::uint16_t>(section.integer("metrics_port", {.min = 0, .max = 65535}));
    metrics_listener_ = std::make_unique<Listener>(
        io_, "127.0.0.1", port, [this](asio::ip::tcp::socket socket) { serve_metrics(std::move(socket)); });
  }
}

std::uint16_t Server::Impl::port() const { return listeners_.front()->port(); }

std::vector<std::string> Server::Impl::endpoints() const {
  std::vector<std::string> texts;
  for (const auto& listener : listeners_) texts.push_back(listener->endpoint());
  return texts;
}

}  // namespace regista
