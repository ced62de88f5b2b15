#include "matrix.hpp"

#include <algorithm>
#include <asterism/solver/detail/finite.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <cmath>
#include <limits>
#include <numeric>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

std::string missing_curvature(const System& system, Curvature curvature) {
  for (int t = 0; t < system.term_count(); ++t) {
    const Term& term = system.term(t);
    if (term.size() == 0) continue;
    if (const char* problem = term.problem_with(curvature)) return std::string(term.kind()) + ": " + problem;
  }
  return {};
}

void SystemMatrix::assemble(const System& system, const Eigen::MatrixXd& x, Curvature curvature) {
  nodes_ = system.nodes();
  dim_ = system.dim();
  size_ = nodes_ * dim_;
  system_ = &system;
  rows_.swap(old_rows_);
  columns_.swap(old_columns_);
  rows_.clear();
  columns_.clear();
  values_.clear();
  int hidden = nodes_;
  for (int t = 0; t < system.term_count(); ++t) {
    const Term& term = system.term(t);
    if (term.size() == 0) continue;
    set_hidden_node(term.has_hidden() ? hidden : -1);
    term.add_curvature(x, curvature, *this);
    if (term.has_hidden()) ++hidden, ++size_;
  }
  for (int i = 0; i < nodes_; ++i) {
    // Every coordinate has an entry on the diagonal, for shifts and for nodes without elements.
    for (int d = 0; d < dim_; ++d) {
      rows_.push_back(i * dim_ + d);
      columns_.push_back(i * dim_ + d);
      values_.push_back(system.is_fixed(i) ? 1.0 : 0.0);
    }
  }
  if (size_ != matrix_.rows() || rows_ != old_rows_ || columns_ != old_columns_) make_pattern();
  double* const entries = matrix_.valuePtr();
  std::fill(entries, entries + matrix_.nonZeros(), 0.0);
  for (std::size_t e = 0; e < values_.size(); ++e) entries[slots_[e]] += values_[e];
}

void SystemMatrix::add(const int* nodes, int count, const double* matrix, int rows) {
  for (int a = 0, row = 0; a < count; row += unknowns(nodes[a]), ++a) {
    if (nodes[a] < nodes_ && system_->is_fixed(nodes[a])) continue;
    for (int b = 0, column = 0; b < count; column += unknowns(nodes[b]), ++b) {
      if (nodes[b] < nodes_ && system_->is_fixed(nodes[b])) continue;
      const int to_row = first_unknown(nodes[a]), to_column = first_unknown(nodes[b]);
      if (to_row < to_column) continue;
      for (int j = 0; j < unknowns(nodes[b]); ++j) {
        for (int i = to_row == to_column ? j : 0; i < unknowns(nodes[a]); ++i) {
          rows_.push_back(to_row + i);
          columns_.push_back(to_column + j);
          values_.push_back(matrix[(column + j) * rows + row + i]);
        }
      }
    }
  }
}

// Entries by column and then by row, by two counting sorts.
void SystemMatrix::make_pattern() {
  require_entries(static_cast<double>(rows_.size()), sizeof(double) + 2 * sizeof(int));
  const auto sorted = [this](const std::vector<int>& keys, const std::vector<int>& order) {
    std::vector<int> next(static_cast<std::size_t>(size_) + 1);
    for (const int key : keys) ++next[static_cast<std::size_t>(key) + 1];
    std::partial_sum(next.begin(), next.end(), next.begin());
    std::vector<int> result(order.size());
    for (const int e : order)
      result[static_cast<std::size_t>(next[static_cast<std::size_t>(keys[static_cast<std::size_t>(e)])]++)] =
          e;
    return result;
  };
  std::vector<int> order(rows_.size());
  std::iota(order.begin(), order.end(), 0);
  order = sorted(columns_, sorted(rows_, order));

  slots_.resize(order.size());
  std::vector<int> outer(static_cast<std::size_t>(size_) + 1), inner;
  int row = -1, column = -1;
  for (const int entry : order) {
    const auto e = static_cast<std::size_t>(entry);
    if (rows_[e] != row || columns_[e] != column) {
      row = rows_[e];
      column = columns_[e];
      inner.push_back(row);
      ++outer[static_cast<std::size_t>(column) + 1];
    }
    slots_[e] = static_cast<int>(inner.size()) - 1;
  }
  std::partial_sum(outer.begin(), outer.end(), outer.begin());
  matrix_.resize(size_, size_);
  matrix_.resizeNonZeros(static_cast<Eigen::Index>(inner.size()));
  std::copy(outer.begin(), outer.end(), matrix_.outerIndexPtr());
  std::copy(inner.begin(), inner.end(), matrix_.innerIndexPtr());
  ++pattern_;
}

void SystemMatrix::shift(const Eigen::VectorXd& node_stiffness, double share) {
  for (int c = 0; c < size_; ++c) {
    const bool is_hidden = c >= nodes_ * dim_;
    if (!is_hidden && system_->is_fixed(c / dim_)) continue;
    double& pivot = matrix_.valuePtr()[matrix_.outerIndexPtr()[c]];  // the first of a column of the triangle
    pivot += share * (is_hidden ? pivot : node_stiffness[c / dim_]);
  }
}

void SystemFactor::analyse(const SystemMatrix& matrix) {
  if (analysed_ != &matrix || pattern_ != matrix.pattern()) {
    cholesky_.analyzePattern(matrix.matrix());
    analysed_ = &matrix;
    pattern_ = matrix.pattern();
  }
}

double SystemFactor::entries(const SystemMatrix& matrix) {
  analyse(matrix);
  return static_cast<double>(cholesky_.matrixL().nestedExpression().data().size());
}

bool SystemFactor::factorize(const SystemMatrix& matrix) {
  analyse(matrix);
  cholesky_.factorize(matrix.matrix());
  if (cholesky_.info() != Eigen::Success) return false;
  constexpr double kRounding = 64 * std::numeric_limits<double>::epsilon();
  const Eigen::VectorXd& pivots = cholesky_.vectorD();
  const auto& place = cholesky_.permutationP().indices();
  const auto& entries = matrix.matrix();
  for (Eigen::Index c = 0; c < pivots.size(); ++c) {
    const double diagonal = entries.valuePtr()[entries.outerIndexPtr()[c]];
    const double pivot = pivots[place[c]];
    if (!(pivot > kRounding * diagonal) || !(pivot > 0) || !is_finite(pivot)) return false;
  }
  return true;
}

Eigen::MatrixXd SystemFactor::solve_all(const Eigen::MatrixXd& right) const { return cholesky_.solve(right); }

Eigen::MatrixXd SystemFactor::solve(const Eigen::MatrixXd& points) const {
  Eigen::VectorXd right = Eigen::VectorXd::Zero(cholesky_.rows());
  right.head(points.size()) = points.reshaped();
  const Eigen::VectorXd solution = cholesky_.solve(right);
  return solution.head(points.size()).reshaped(points.rows(), points.cols());
}

Eigen::VectorXd SystemFactor::negative_direction() const {
  if (cholesky_.info() != Eigen::Success) return {};
  Eigen::Index least = 0;
  const Eigen::VectorXd& pivots = cholesky_.vectorD();
  if (pivots.size() == 0 || !(pivots.minCoeff(&least) < 0)) return {};
  // A = P^T L D L^T P: v = P^T L^-T e has v^T A v = D_ii.
  Eigen::VectorXd v = Eigen::VectorXd::Unit(pivots.size(), least);
  cholesky_.matrixU().solveInPlace(v);
  return cholesky_.permutationPinv() * v;
}

double SystemFactor::log_determinant() const { return cholesky_.vectorD().array().log().sum(); }

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
