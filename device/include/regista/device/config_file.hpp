// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <regista/core/result.hpp>
#include <regista/device/config.hpp>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace regista {

/// A `.cfg` with its includes and templates resolved: docs/configuration.md. Whoever reads a section calls its
/// `check_unused`.
struct ConfigFile {
  Section server;                ///< `server( ... )`; empty when the file has none
  std::vector<Section> drivers;  ///< `driver( ... )`, in the order of the file
  std::vector<Value> plugins;    ///< `plugin "name"` outside of sections
};

/// Gives the text of an included file, or why it cannot be read.
using Loader = std::function<Result<std::string>(const std::filesystem::path& file)>;

/// Reads up to 1 MiB; longer files are refused (`file_too_large`).
Result<std::string> load_file(const std::filesystem::path& file);

/// Includes of included files and the like end at limits that no robot needs: 1 MiB a file, 16 files deep, 8 MiB in all
/// with templates written out, 256 keys a section.
/// Throws ConfigError for anything that the language does not allow.
ConfigFile read_config(const std::filesystem::path& file);

/// The same for a text in memory. `name` stands for the file: in errors, and as that which includes are relative to.
ConfigFile parse_config(std::string_view text, const std::string& name, const Loader& load = load_file);

/// The same language for another program, whose sections have these types: all of them, in the order of the file.
std::vector<Section> read_sections(const std::filesystem::path& file, std::span<const std::string_view> types);
std::vector<Section> parse_sections(std::string_view text, const std::string& name,
                                    std::span<const std::string_view> types, const Loader& load = load_file);

}  // namespace regista
