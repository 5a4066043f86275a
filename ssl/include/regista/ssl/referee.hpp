// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <regista/core/result.hpp>
#include <span>
#include <string_view>
#include <vector>

namespace regista::ssl {

/// What the game controller says. The numbers are the league's; more than these exist.
enum class Command : std::uint8_t { halt = 0, stop = 1, normal_start = 2, force_start = 3 };

struct Referee {
  Command command = Command::halt;
  std::uint32_t command_counter = 0;  ///< another number: a new command
};

/// Reads Referee, of 2013 to today. Fails with `bad_message` for what is none.
Result<Referee> decode_referee(std::span<const std::byte> datagram);

std::vector<std::byte> encode(const Referee& referee);

}  // namespace regista::ssl
