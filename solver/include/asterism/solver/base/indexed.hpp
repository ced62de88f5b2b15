#pragma once

#include <asterism/solver/base/config.hpp>
#include <concepts>
#include <cstddef>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// A std::vector indexed by int, like nodes and links.
template <typename T>
class Indexed : public std::vector<T> {
 public:
  using std::vector<T>::vector;

  template <std::integral Index>
  T& operator[](Index i) {
    return std::vector<T>::operator[](static_cast<std::size_t>(i));
  }
  template <std::integral Index>
  const T& operator[](Index i) const {
    return std::vector<T>::operator[](static_cast<std::size_t>(i));
  }
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
