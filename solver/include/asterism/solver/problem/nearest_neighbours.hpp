#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// A balanced tree of boxes over the columns of `points`, for k-nearest queries of its own points. Ties go to
/// the smaller index, so a subtree is left out by its box and its smallest index together: of points that
/// coincide, the first few are found as fast as others. Boxes are cut across their longest side, for points
/// on a line, clusters at many scales and outliers to be as good as any.
template <typename Points>
class NearestNeighbours {
 public:
  NearestNeighbours(const Points& points, int k)
      : points_(points), k_(static_cast<std::size_t>(std::min<Eigen::Index>(k, points.cols() - 1))) {
    order_.resize(static_cast<std::size_t>(points.cols()));
    std::iota(order_.begin(), order_.end(), 0);
    if (k_ > 0) build(0, order_.size());
  }

  /// The k nearest other points of point `query`, nearest first.
  const auto& of(int query) {
    query_ = query;
    found_.clear();
    if (k_ > 0) search(0, bound(0));
    std::sort_heap(found_.begin(), found_.end());
    return found_;
  }

 private:
  using Scalar = typename Points::Scalar;
  using Candidate = std::pair<Scalar, int>;  // squared distance, index: pairs order ties by index
  using Corner = Eigen::Matrix<Scalar, Points::RowsAtCompileTime, 1>;

  struct Box {
    std::size_t first, last;  // of order_
    Corner low, high;
    int smallest = 0;        // index
    std::size_t second = 0;  // child; the first is the next box, 0 where this has points alone
  };

  static constexpr std::size_t kLeaf = 8;

  std::size_t build(std::size_t first, std::size_t last) {
    const std::size_t here = boxes_.size();
    Box box{first, last, points_.col(order_[first]), points_.col(order_[first])};
    box.smallest = order_[first];
    for (std::size_t m = first + 1; m < last; ++m) {
      box.low = box.low.cwiseMin(points_.col(order_[m]));
      box.high = box.high.cwiseMax(points_.col(order_[m]));
      box.smallest = std::min(box.smallest, order_[m]);
    }
    boxes_.push_back(box);
    if (last - first <= kLeaf) return here;
    Eigen::Index axis = 0;
    (box.high / 2 - box.low / 2).maxCoeff(&axis);  // halves, for their difference not to overflow
    const std::size_t middle = first + (last - first) / 2;
    const auto begin = order_.begin();
    std::nth_element(begin + static_cast<std::ptrdiff_t>(first), begin + static_cast<std::ptrdiff_t>(middle),
                     begin + static_cast<std::ptrdiff_t>(last), [&](int a, int b) {
                       return std::pair(points_(axis, a), a) < std::pair(points_(axis, b), b);
                     });
    build(first, middle);
    boxes_[here].second = build(middle, last);
    return here;
  }

  // What no point of a box comes before, by the arithmetic of its points' own distances, to the last digit.
  Candidate bound(std::size_t box) {
    const Box& of = boxes_[box];
    const auto query = points_.col(query_);
    offset_ = (of.low - query).cwiseMax(query - of.high).cwiseMax(Scalar(0));
    return {offset_.squaredNorm(), of.smallest};
  }

  void search(std::size_t here, const Candidate& least) {
    if (found_.size() == k_ && !(least < found_.front())) return;
    const Box& box = boxes_[here];
    if (box.second == 0) {
      for (std::size_t m = box.first; m < box.last; ++m) {
        if (order_[m] == query_) continue;
        offset_ = points_.col(order_[m]) - points_.col(query_);
        offer({offset_.squaredNorm(), order_[m]});
      }
      return;
    }
    const Candidate first = bound(here + 1);
    const Candidate second = bound(box.second);
    if (first < second) {
      search(here + 1, first);
      search(box.second, second);
    } else {
      search(box.second, second);
      search(here + 1, first);
    }
  }

  void offer(Candidate candidate) {
    if (found_.size() == k_) {
      if (!(candidate < found_.front())) return;
      std::pop_heap(found_.begin(), found_.end());
      found_.back() = candidate;
    } else {
      found_.push_back(candidate);
    }
    std::push_heap(found_.begin(), found_.end());
  }

  const Points& points_;
  std::size_t k_;
  int query_ = 0;
  std::vector<int> order_;
  std::vector<Box> boxes_;
  std::vector<Candidate> found_;  // a heap, the last of them in front
  Corner offset_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
