// SPDX-License-Identifier: Apache-2.0
#include "plugins.hpp"

#include <dlfcn.h>
#include <sys/stat.h>
#include <unistd.h>

namespace regista {

namespace {

constexpr std::size_t longest_name = 62;  // libplayerc writes a NUL behind 63 bytes of a 64-byte buffer

std::string quoted(const std::filesystem::path& path) { return '"' + path.string() + '"'; }

/// A plugin is code that runs as we do: nobody else may be able to change it.
void check_safe(const std::filesystem::path& file, const Place& place) {
  struct stat status{};
  if (::stat(file.c_str(), &status) != 0) return;  // dlopen says it better
  // A group of one's own, as many desktops give to everybody, is no other.
  const bool own_group = status.st_gid == 0 || status.st_gid == ::getegid();
  const bool others_may_write = (status.st_mode & S_IWOTH) != 0 || ((status.st_mode & S_IWGRP) != 0 && !own_group);
  const bool trusted_owner = status.st_uid == 0 || status.st_uid == ::geteuid();
  if (others_may_write || !trusted_owner) {
    throw ConfigError{
        place, "plugin " + quoted(file) +
                   ": others may change this file; it must belong to root or to you, and only they may write it"};
  }
}

/// "undefined symbol foo", without the path, which is ours to say.
std::string load_error(const std::filesystem::path& file) {
  std::string why = ::dlerror();  // NOLINT(concurrency-mt-unsafe): before there are other threads
  if (why.starts_with(file.string() + ": ")) why.erase(0, file.string().size() + 2);
  if (const auto at = why.find("symbol: "); at != std::string::npos) why.erase(at + 6, 1);
  return why;
}

}  // namespace

Plugins::Plugins(const std::vector<const Plugin*>& linked, std::vector<std::filesystem::path> folders)
    : folders_{std::move(folders)} {
  for (const Plugin* plugin : linked) known_.emplace(plugin->name, plugin);
}

std::filesystem::path Plugins::locate(const std::string& name, const Place& place) const {
  std::filesystem::path file = name;
  if (file.extension() != ".so") file += ".so";
  if (name.find('/') != std::string::npos) {
    return std::filesystem::absolute(std::filesystem::path{place.file}.parent_path() / file).lexically_normal();
  }
  std::string looked;
  for (const std::filesystem::path& folder : folders_) {
    if (std::filesystem::exists(folder / file)) return std::filesystem::absolute(folder / file);
    looked += (looked.empty() ? "" : ", ") + (folder / file).string();
  }
  throw ConfigError{place, "no plugin '" + name + "': looked for " + (looked.empty() ? "it nowhere" : looked) +
                               "; name its file with `plugin \"path/to/" + file.string() + "\"`"};
}

const Plugin& Plugins::find(const Section& driver) {
  const std::string name = driver.text("name");
  const Place place = driver.place_of("name");
  if (driver.has("plugin")) {
    const Place at = driver.place_of("plugin");
    const Plugin& plugin = load(locate(driver.text("plugin"), at), at);
    if (plugin.name != name) {
      throw ConfigError{place, "plugin \"" + driver.text("plugin") + "\" has a driver '" + std::string{plugin.name} +
                                   "', not '" + name + "'"};
    }
    return plugin;
  }
  if (const auto known = known_.find(name); known != known_.end()) return *known->second;
  return load(locate(name, place), place);
}

void Plugins::load(const Value& statement) { load(locate(statement.text, statement.place), statement.place); }

const Plugin& Plugins::load(const std::filesystem::path& file, const Place& place) {
  check_safe(file, place);
  const auto refuse = [&](const std::string& why) { return ConfigError{place, "plugin " + quoted(file) + ": " + why}; };
  const auto open = [&](int mode) { return ::dlopen(file.c_str(), mode | RTLD_LOCAL); };
  const auto entry = [](void* library) { return static_cast<const Plugin*>(::dlsym(library, "regista_plugin")); };
  // Lazily first: a plugin for another server may lack symbols, and its number says more than they do.
  void* lazy = open(RTLD_LAZY);
  if (lazy == nullptr) throw refuse(load_error(file));
  const Plugin* plugin = entry(lazy);
  if (plugin == nullptr) {
    throw refuse("undefined symbol regista_plugin (it is no regista driver; see docs/writing-a-driver.md)");
  }
  const std::string versions =
      "built for ABI " + std::to_string(plugin->api) + ", server has " + std::to_string(plugin_api);
  ::dlclose(lazy);  // what is still open is not bound again
  void* library = open(RTLD_NOW);
  if (library == nullptr) throw refuse(load_error(file) + " (" + versions + ")");
  plugin = entry(library);
  if (plugin->api != plugin_api) throw refuse(versions + "; build it again");
  if (plugin->layout != plugin_layout) {
    throw refuse("built with another compiler or another regista of ABI " + std::to_string(plugin_api) +
                 "; build it again");
  }
  if (std::string_view{plugin->name}.size() > longest_name) throw refuse("its name is longer than 62 bytes");
  known_.emplace(plugin->name, plugin);
  return *plugin;  // stays loaded: its code may run until the process ends
}

}  // namespace regista
