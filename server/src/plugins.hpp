// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <regista/server/server.hpp>

namespace regista {

/// Finds the plugin of a driver: linked in, or a shared library that stays loaded.
class Plugins {
 public:
  Plugins(const std::vector<const Plugin*>& linked, std::vector<std::filesystem::path> folders);

  /// The plugin for a `driver( ... )` section: by its key `plugin`, a path relative to the .cfg or a name, else by the
  /// name of the driver. Throws ConfigError, in words, for what is missing, not ours or built for another server.
  const Plugin& find(const Section& driver);
  /// `plugin "x"` outside of sections: load it now.
  void load(const Value& statement);

 private:
  const Plugin& load(const std::filesystem::path& file, const Place& place);
  [[nodiscard]] std::filesystem::path locate(const std::string& name, const Place& place) const;

  std::map<std::string, const Plugin*, std::less<>> known_;
  std::vector<std::filesystem::path> folders_;
};

}  // namespace regista
