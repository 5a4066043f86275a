// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace regista {

/// Each number and boolean of a JSON text as a line of Prometheus' text format 0.0.4, named by its path behind
/// `prefix`. Objects in lists are told apart by labels: their `id`, `device`, `name` and `group`.
/// Throws std::exception for what is no JSON.
std::string prometheus_text(const std::string& prefix, const std::string& json);

}  // namespace regista
