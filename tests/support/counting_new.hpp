// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace regista {

/// Calls of operator new on this thread since it began. Link `counting_new` to count.
struct Allocations {
  std::size_t count = 0;
  std::size_t largest = 0;  ///< [bytes]; may be set back
};
Allocations& allocations();

}  // namespace regista
