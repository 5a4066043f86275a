// SPDX-License-Identifier: Apache-2.0
#include "counting_new.hpp"

#include <algorithm>
#include <cstdlib>
#include <new>

namespace regista {

Allocations& allocations() {
  thread_local Allocations of_this_thread;
  return of_this_thread;
}

}  // namespace regista

// NOLINTBEGIN(cppcoreguidelines-no-malloc)
namespace {

void count(std::size_t size) {
  regista::Allocations& seen = regista::allocations();
  ++seen.count;
  seen.largest = std::max(seen.largest, size);
}

}  // namespace

// Not inlined: gcc 12 would take free() for a mismatch.
[[gnu::noinline]] void* operator new(std::size_t size) {
  count(size);
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc{};
}
[[gnu::noinline]] void* operator new(std::size_t size, std::align_val_t alignment) {
  count(size);
  const auto a = static_cast<std::size_t>(alignment);
  if (void* memory = std::aligned_alloc(a, (size + a - 1) / a * a)) return memory;
  throw std::bad_alloc{};
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }
// NOLINTEND(cppcoreguidelines-no-malloc)
