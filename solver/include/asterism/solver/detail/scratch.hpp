#pragma once

#include <asterism/solver/detail/config.hpp>
#include <optional>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// A workspace that is made where it is first needed. A copy of its owner, or what the owner is moved to,
/// makes one of its own.
template <typename T>
class Scratch {
 public:
  Scratch() = default;
  Scratch(const Scratch&) {}
  Scratch& operator=(const Scratch&) {
    value_.reset();
    return *this;
  }

  T& get() { return value_ ? *value_ : value_.emplace(); }
  /// A new one, for systems of another size: Eigen 3.4 frees a matrix before it allocates it in another size,
  /// and once more at its end if that failed.
  T& anew() { return value_.emplace(); }

 private:
  std::optional<T> value_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
