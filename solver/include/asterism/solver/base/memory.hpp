#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <charconv>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>
#include <string_view>

// Detects lack of memory, in one place. Operating systems promise more memory than there is, and end a
// process that uses it. A large workspace is therefore refused before it is allocated, if less is available.
// The library's functions report memory that was refused or could not be allocated as a status.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// A std::bad_alloc with a message.
class LackOfMemory : public std::bad_alloc {
 public:
  /// The text, as far as it fits.
  explicit LackOfMemory(std::string_view text) { append(text); }
  /// The memory that is needed and that is available, in bytes.
  LackOfMemory(double needed, double available) {
    append("the workspace needs ");
    append_gigabytes(needed);
    append(" of memory, and ");
    append_gigabytes(available);
    append(" are available: use a method that needs less");
  }

  const char* what() const noexcept override { return text_; }

 private:
  void append(std::string_view text) {
    const std::size_t count = std::min(text.size(), sizeof text_ - 1 - size_);
    std::memcpy(text_ + size_, text.data(), count);
    size_ += count;
    text_[size_] = '\0';
  }
  void append_gigabytes(double bytes) {
    char digits[32];
    const auto end = std::to_chars(digits, digits + sizeof digits, std::min(bytes * 1e-9, 1e20),
                                   std::chars_format::fixed, 1)
                         .ptr;
    append({digits, static_cast<std::size_t>(end - digits)});
    append(" GB");
  }

  std::size_t size_ = 0;
  char text_[168] = {};
};

/// Calls work(), and otherwise(error) if it throws an `Exception`. Without exceptions (-fno-exceptions)
/// nothing is caught: lack of memory then ends the process, as it does in Eigen.
template <typename Exception, typename Work, typename Otherwise>
void attempt(Work&& work, [[maybe_unused]] Otherwise&& otherwise) {
#ifdef __cpp_exceptions
  try {
    work();
  } catch (const Exception& error) {
    otherwise(error);
  }
#else
  work();
#endif
}

/// Throws, or ends the process if exceptions are disabled.
template <typename Error>
[[noreturn]] void raise([[maybe_unused]] const Error& error) {
#ifdef __cpp_exceptions
  throw error;
#else
  std::abort();
#endif
}

/// The message for a std::bad_alloc.
inline std::string_view memory_message(const std::bad_alloc& error) {
  const std::string_view words = error.what();
  return words.starts_with("std::") ? "the workspace does not fit into memory" : words;
}

/// Bytes that the system could still give this process: physical memory and swap space that are free or hold
/// files' contents, and no more than its control group may have in all. Infinity where the system does not
/// say (other systems than Linux).
inline double available_memory() {
  constexpr double kUnknown = std::numeric_limits<double>::infinity();
  double available = 0;
  bool known = false;
  char line[128];
  if (std::FILE* const file = std::fopen("/proc/meminfo", "r")) {
    while (std::fgets(line, sizeof line, file) != nullptr) {
      const std::string_view text = line;
      const bool is_memory = text.starts_with("MemAvailable:");
      if (!is_memory && !text.starts_with("SwapFree:")) continue;
      known |= is_memory;
      available += 1024 * std::strtod(line + text.find(':') + 1, nullptr);
    }
    std::fclose(file);
  }
  if (!known) available = kUnknown;
  for (const char* const file :
       {"/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"}) {
    std::FILE* const limits = std::fopen(file, "r");
    if (limits == nullptr) continue;
    if (std::fgets(line, sizeof line, limits) != nullptr) {
      char* end = line;
      const double limit = std::strtod(line, &end);
      if (end != line) available = std::min(available, limit);  // else "max"
    }
    std::fclose(limits);
  }
  return available;
}

/// Refuses, by a LackOfMemory, to allocate `bytes` that are not available. Small workspaces are not
/// tested: the test takes some 20 us.
inline void require_memory(double bytes) {
  constexpr double kSmall = 1 << 28;
  if (bytes < kSmall) [[likely]]
    return;
  const double available = available_memory();
  if (bytes > available) raise(LackOfMemory(bytes, available));
}

/// The same for a sparse matrix of so many entries of `bytes` each, whose indices are ints, and for so many
/// copies of it.
inline void require_entries(double entries, double bytes, int copies = 1) {
  if (entries > std::numeric_limits<int>::max()) {
    raise(LackOfMemory("a sparse matrix has more entries than can be counted: use a method without one"));
  }
  require_memory(copies * entries * (bytes + sizeof(int)));
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
