#pragma once

// Counts every malloc of the program. It replaces malloc: include it in one source file of an executable.
#include <atomic>
#include <cerrno>
#include <cstddef>

#include "sanitizer.hpp"

namespace {
std::atomic<long> allocations{0};
std::atomic<std::size_t> allocated_bytes{0};

[[maybe_unused]] void count_allocation(std::size_t size) {
  ++allocations;
  allocated_bytes += size;
}
}

#ifdef ASTERISM_TEST_SANITIZED
extern "C" int __sanitizer_install_malloc_and_free_hooks(void (*on_malloc)(const volatile void*, std::size_t),
                                                         void (*on_free)(const volatile void*));
namespace {
[[maybe_unused]] const int kHook = __sanitizer_install_malloc_and_free_hooks(
    [](const volatile void*, std::size_t size) { count_allocation(size); }, [](const volatile void*) {});
}
#else
// glibc lets a program replace malloc; operator new and Eigen come through it.
#pragma GCC visibility push(default)  // so that shared libraries find them
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

void* malloc(std::size_t size) {
  count_allocation(size);
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  count_allocation(count * size);
  return __libc_calloc(count, size);
}
void* realloc(void* memory, std::size_t size) {
  count_allocation(size);
  return __libc_realloc(memory, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  count_allocation(size);
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  *memory = aligned_alloc(alignment, size);
  return *memory == nullptr ? ENOMEM : 0;
}
}
#pragma GCC visibility pop
#endif

namespace asterism::testing {

/// The number of allocations in solve().
template <typename Solve>
long allocations_in(Solve&& solve) {
  const long before = allocations;
  solve();
  return allocations - before;
}

/// The number of bytes that solve() allocates, whether or not it frees them.
template <typename Solve>
std::size_t bytes_in(Solve&& solve) {
  const std::size_t before = allocated_bytes;
  solve();
  return allocated_bytes - before;
}

}  // namespace asterism::testing
