#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <iterator>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The median of at least one value, the upper one of two; changes their order.
inline double median(std::vector<double>& values) {
  const auto middle = values.begin() + std::ssize(values) / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
