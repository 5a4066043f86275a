// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <regista/device/config_file.hpp>
#include <regista/device/plugin.hpp>
#include <string>
#include <vector>

namespace regista {

enum class LogLevel : std::uint8_t { info, warning, error };

struct ServerOptions {
  std::optional<std::uint16_t> port{};                  ///< instead of the .cfg's; 0: any free one
  std::vector<std::string> listen{};                    ///< addresses instead of the .cfg's
  std::vector<std::filesystem::path> plugin_folders{};  ///< where plugins that are named without a path are looked for
  std::vector<const Plugin*> plugins{};                 ///< linked in: found before any folder is searched
  /// Called on the network thread for everything that a person may want to read.
  std::function<void(LogLevel, const std::string&)> log{};
};

/// The TCP port is somebody else's, or not to be had.
class ListenError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Offers the devices of its drivers to clients over TCP. Construction reads the configuration, loads the plugins,
/// makes the drivers and listens, and throws ConfigError or ListenError; nothing moves before run().
class Server {
 public:
  Server(const ConfigFile& config, ServerOptions options);
  ~Server();

  /// Serve until stop(); on return every driver is at rest and closed. The calling thread is the network thread.
  /// False: a driver did not come to rest in time.
  bool run();
  /// Any thread, signal handlers excluded.
  void stop();

  /// Of the first listener.
  [[nodiscard]] std::uint16_t port() const;
  /// "127.0.0.1:6665", one for each listener.
  [[nodiscard]] std::vector<std::string> endpoints() const;
  /// Called on the network thread once the server serves.
  void on_ready(std::function<void()> ready);
  /// Called on the network thread when a driver has hung for longer than `hang_exit_s`.
  void on_hang(std::function<void()> hang);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace regista
