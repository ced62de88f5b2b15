#pragma once

#include <cstddef>
#include <utility>
#include <vector>

namespace asterism::tools {

/// Evenly spaced members of a series whose length is not known in advance, 24 to 48 of a long one: every
/// n-th, where n doubles as the series grows.
template <class T>
class Thinned {
 public:
  /// Counts the next member of the series; true if it is to be kept, by `keep`.
  bool next() { return count_++ % stride_ == 0; }
  void keep(T member) {
    if (members_.size() == kMost) {
      // Drop every other member; as kMost is even, the new one is then the next in the series.
      for (std::size_t i = 1; 2 * i < kMost; ++i) std::swap(members_[i], members_[2 * i]);
      members_.erase(members_.begin() + kMost / 2, members_.end());
      stride_ *= 2;
    }
    members_.push_back(std::move(member));
  }
  const std::vector<T>& members() const { return members_; }

 private:
  static constexpr std::size_t kMost = 48;
  std::vector<T> members_;
  std::size_t count_ = 0, stride_ = 1;
};

}  // namespace asterism::tools
