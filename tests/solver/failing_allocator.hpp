#pragma once

// Makes one allocation of this thread fail. It replaces malloc, or operator new under a sanitizer, which has
// its own malloc: include it in one source file of an executable.

#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <new>

#include "sanitizer.hpp"

namespace asterism::testing {

inline thread_local long allocations_left = -1;  // before the one that fails; negative: none fails

inline bool fails() { return allocations_left >= 0 && allocations_left-- == 0; }

/// Calls f() with its first allocation failing, then the second, and so on (every one at first, later fewer),
/// and after(k) after each, until none fails. Returns the last k, at least the number of allocations in f.
template <typename F, typename After>
long fail_each_allocation(F&& f, After&& after) {
  for (long k = 0;; k += 1 + k / 25) {
    allocations_left = k;
    f();
    const bool failed = allocations_left < 0;
    allocations_left = -1;
    if (!failed) return k;
    after(k);
  }
}

}  // namespace asterism::testing

#ifdef ASTERISM_TEST_SANITIZED
void* operator new(std::size_t size) {
  void* const memory = asterism::testing::fails() ? nullptr : std::malloc(size > 0 ? size : 1);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}
void* operator new[](std::size_t size) { return operator new(size); }
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t) noexcept { std::free(memory); }
#else
// glibc lets a program replace malloc; operator new, Eigen and OpenCV come through it.
#pragma GCC visibility push(default)  // so that shared libraries find them
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

void* malloc(std::size_t size) { return asterism::testing::fails() ? nullptr : __libc_malloc(size); }
void* calloc(std::size_t count, std::size_t size) {
  return asterism::testing::fails() ? nullptr : __libc_calloc(count, size);
}
void* realloc(void* memory, std::size_t size) {
  return asterism::testing::fails() ? nullptr : __libc_realloc(memory, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  return asterism::testing::fails() ? nullptr : __libc_memalign(alignment, size);
}
int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  *memory = aligned_alloc(alignment, size);
  return *memory == nullptr ? ENOMEM : 0;
}
}
#pragma GCC visibility pop
#endif
