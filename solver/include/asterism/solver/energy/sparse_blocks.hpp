#pragma once

#include <Eigen/SparseCore>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <cstddef>
#include <memory>
#include <numeric>
#include <span>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The lower triangle of a symmetric sparse matrix of kBlock x kBlock blocks: one for each node on the
/// diagonal and one for each link off it. The pattern is made once for each topology; after that only values
/// are set.
template <typename Scalar, int kBlock>
class SparseBlocks {
 public:
  using Matrix = Eigen::SparseMatrix<Scalar>;

  /// Makes the pattern and calls analyze(matrix), if it is not that of these links already. Where either
  /// throws, the next call does so again.
  template <typename Analyze>
  void prepare(int nodes, std::span<const Link> links, Analyze&& analyze) {
    if (is_ready_ && matrix_->rows() == kBlock * nodes &&
        std::equal(links.begin(), links.end(), links_.begin(), links_.end()))
      return;
    is_ready_ = false;
    make_pattern(nodes, links);
    analyze(*matrix_);
    is_ready_ = true;
  }

  void set_zero() { matrix_->coeffs().setZero(); }

  /// An entry of the lower triangle of node i's block.
  Scalar& at(int i, int row, int column) { return diagonal(kBlock * i + column)[row - column]; }
  /// An entry of the block of link l, in the rows of its end of higher number and the columns of the lower.
  Scalar& at_link(int l, int row, int column) {
    const Link& link = links_[static_cast<std::size_t>(l)];
    return diagonal(kBlock * std::min(link.i, link.j) +
                    column)[kBlock - column + kBlock * rank_[static_cast<std::size_t>(l)] + row];
  }

  /// Adds to the block of node i.
  template <typename Block>
  void add(int i, const Block& block) {
    for (int c = 0; c < kBlock; ++c) {
      for (int r = c; r < kBlock; ++r) at(i, r, c) += static_cast<Scalar>(block(r, c));
    }
  }

  /// Adds to the block of link l.
  template <typename Block>
  void add_link(int l, const Block& block) {
    for (int c = 0; c < kBlock; ++c) {
      for (int r = 0; r < kBlock; ++r) at_link(l, r, c) += static_cast<Scalar>(block(r, c));
    }
  }

  /// The c-th entry of the diagonal, with its column's below it in memory.
  Scalar* diagonal(int c) { return matrix_->valuePtr() + matrix_->outerIndexPtr()[c]; }

  const Matrix& matrix() const { return *matrix_; }

 private:
  void make_pattern(int n, std::span<const Link> links) {
    require_entries(double{kBlock} * kBlock * (n + static_cast<double>(links.size())), sizeof(Scalar));
    links_.assign(links.begin(), links.end());
    const auto ends = [this](int l) {
      const Link& link = links_[static_cast<std::size_t>(l)];
      return std::minmax(link.i, link.j);
    };
    std::vector<int> order(links.size());
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(), [&ends](int a, int b) { return ends(a) < ends(b); });

    // A node's neighbours of higher number, each once, also where links are parallel.
    std::vector<int> first(static_cast<std::size_t>(n) + 1, 0);
    std::vector<int> neighbours;
    rank_.resize(links.size());
    neighbours.reserve(links.size());
    int low = -1;
    for (const int l : order) {
      const auto [i, j] = ends(l);
      while (low < i) first[static_cast<std::size_t>(++low)] = static_cast<int>(neighbours.size());
      const auto begin = first[static_cast<std::size_t>(low)];
      if (static_cast<int>(neighbours.size()) == begin || neighbours.back() != j) neighbours.push_back(j);
      rank_[static_cast<std::size_t>(l)] = static_cast<int>(neighbours.size()) - 1 - begin;
    }
    while (low < n) first[static_cast<std::size_t>(++low)] = static_cast<int>(neighbours.size());

    matrix_ = std::make_unique<Matrix>(kBlock * n, kBlock * n);
    matrix_->resizeNonZeros(n * kBlock * (kBlock + 1) / 2 +
                            kBlock * kBlock * static_cast<Eigen::Index>(neighbours.size()));
    int at = 0;
    for (int i = 0; i < n; ++i) {
      for (int c = 0; c < kBlock; ++c) {
        matrix_->outerIndexPtr()[kBlock * i + c] = at;
        for (int r = c; r < kBlock; ++r) matrix_->innerIndexPtr()[at++] = kBlock * i + r;
        for (int k = first[static_cast<std::size_t>(i)]; k < first[static_cast<std::size_t>(i) + 1]; ++k) {
          const int j = neighbours[static_cast<std::size_t>(k)];
          for (int r = 0; r < kBlock; ++r) matrix_->innerIndexPtr()[at++] = kBlock * j + r;
        }
      }
    }
    matrix_->outerIndexPtr()[kBlock * n] = at;
  }

  std::unique_ptr<Matrix> matrix_;  // Eigen's allocates as it is moved
  std::vector<Link> links_;
  std::vector<int> rank_;  // a link's place among the neighbours above its lower node
  bool is_ready_ = false;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
