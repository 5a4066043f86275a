// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/canopen/object_dictionary.hpp>
#include <stdexcept>

namespace regista::canopen {

/// "drive.eds:12: DataType 'foo' is no number"
class EdsError : public std::runtime_error {
 public:
  EdsError(const std::string& file, int line, const std::string& text)
      : std::runtime_error{file + (line > 0 ? ":" + std::to_string(line) : "") + ": " + text} {}
};

/// Reads an EDS or DCF (CiA 306-1). $NODEID in values becomes `node`, or the NodeID that a DCF names; without either,
/// 0. Objects that the lists name and that are not there, numbers that are none, types that do not exist: EdsError.
ObjectDictionary load_eds(const std::string& file, std::optional<NodeId> node = {});
/// From text; `file` is for the errors.
ObjectDictionary parse_eds(std::string_view text, const std::string& file, std::optional<NodeId> node = {});

}  // namespace regista::canopen
