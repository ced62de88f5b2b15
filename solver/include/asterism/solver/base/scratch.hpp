#pragma once

#include <asterism/solver/base/config.hpp>
#include <optional>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// A workspace that is made when it is first needed. A copy of its owner, or an owner that was moved to,
/// makes its own.
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
  /// and frees it again in its destructor if that failed.
  T& recreate() { return value_.emplace(); }

 private:
  std::optional<T> value_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
