// SPDX-License-Identifier: Apache-2.0
#include <regista/device/config_file.hpp>

#include <cstdint>
#include <cstdlib>

namespace {

/// The input is cut at its NUL bytes: the first piece is the file, the others are what "0", "1", … include.
struct Files {
  std::string_view bytes;

  [[nodiscard]] std::string_view piece(std::size_t number) const {
    std::string_view rest = bytes;
    for (; number > 0; --number) rest = rest.substr(std::min(rest.find('\0'), rest.size() - 1) + 1);
    return rest.substr(0, rest.find('\0'));
  }
};

/// A driver that asks for a key of each type; what it is told does not matter here.
void read_as_driver(const regista::Section& section) {
  (void)section.number("rate", 50, {.min = 1, .max = 2000});
  (void)section.integer("index", 0);
  (void)section.boolean("alwayson", false);
  (void)section.text("name");
  (void)section.numbers("gains", {1, 2});
  (void)section.length("radius", 0.08);
  (void)section.angle("turn", 0.1);
  (void)section.duration("lease", std::chrono::milliseconds{500});
  for (const auto& [name, place] : section.device_names("provides")) {
    const auto again = regista::parse_device_name(to_string(name));
    if (!again || *again != name) std::abort();
  }
  section.check_unused();
}

}  // namespace

/// Any text either parses or throws ConfigError, and neither takes long.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Files files{{reinterpret_cast<const char*>(data), size}};
  const auto load = [&](const std::filesystem::path& file) -> regista::Result<std::string> {
    const auto number = regista::parse_number(file.string());
    if (!number || *number < 0 || *number > 8)
      return regista::Error{std::errc::no_such_file_or_directory, file.string()};
    return std::string{files.piece(static_cast<std::size_t>(*number) + 1)};
  };
  try {
    const regista::ConfigFile config = regista::parse_config(files.piece(0), "fuzz.cfg", load);
    for (const regista::Section& driver : config.drivers) {
      try {
        read_as_driver(driver);
      } catch (const regista::ConfigError&) {  // NOLINT(bugprone-empty-catch): a refusal is a good answer
      }
    }
  } catch (const regista::ConfigError&) {  // NOLINT(bugprone-empty-catch): likewise
  }
  return 0;
}
