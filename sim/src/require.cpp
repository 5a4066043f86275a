// SPDX-License-Identifier: Apache-2.0
#include "require.hpp"

#include <sstream>
#include <stdexcept>

namespace regista::sim {

void require(bool ok, std::string_view field, double value, std::string_view remedy) {
  if (ok && std::isfinite(value)) return;
  std::ostringstream text;
  text << field << " is " << value << ": " << remedy;
  throw std::invalid_argument{text.str()};
}

}  // namespace regista::sim
