// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sysexits.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>

namespace regista {

/// Of chance. CLI11 alone takes -1 for 2^64 - 1, and what is too much for the most that there is.
inline const CLI::Range seeds{std::int64_t{0}, std::int64_t{1} << 53};

/// The exit code, when there is nothing more to do: help was asked for (0), or the usage was wrong (64, EX_USAGE).
inline std::optional<int> parse(CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? EX_OK : EX_USAGE;
  }
  return std::nullopt;
}

}  // namespace regista
