#include "matrix.hpp"

#include <algorithm>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "kernels.hpp"

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

// A dense factor is as fast as a sparse one of a good part of the entries, and small systems are faster
// without a pattern.
bool SystemMatrix::should_be_dense() const {
  constexpr int kSmall = 64;
  constexpr double kDensity = 0.125;
  if (storage_ == Storage::Sparse) return false;
  if (size_ <= kSmall) return true;
  double entries = 0;
  for (int t = 0; t < system_->term_count(); ++t) {
    const Term& term = system_->term(t);
    entries += static_cast<double>(term.size()) * term.arity() * (term.arity() - 1) * per_node_ * per_node_;
  }
  return entries > kDensity * size_ * size_;
}

void SystemMatrix::assemble(const System& system, const Eigen::MatrixXd& x, Curvature curvature) {
  system_ = &system;
  nodes_ = system.nodes();
  is_shared_ =
      storage_ == Storage::Best && (curvature == Curvature::Majorising || curvature == Curvature::Minorising);
  if (is_shared_ && assemble_entries(x, curvature)) return;
  is_shared_ = false;
  assemble_entries(x, curvature);
}

bool SystemMatrix::assemble_entries(const Eigen::MatrixXd& x, Curvature curvature) {
  const System& system = *system_;
  const int former_size = size_;
  per_node_ = is_shared_ ? 1 : system.dim();
  has_own_rows_ = false;
  size_ = nodes_ * per_node_;
  for (int t = 0; t < system.term_count(); ++t) {
    if (system.term(t).size() > 0 && system.term(t).has_hidden()) ++size_;
  }
  is_dense_ = should_be_dense();
  has_fixed_ = false;
  for (int i = 0; i < nodes_; ++i) has_fixed_ = has_fixed_ || system.is_fixed(i);
  if (is_dense_) {
    require_memory(3.0 * size_ * size_ * sizeof(double));
    dense_.setZero(size_, size_);
    add_terms(x, curvature);
    for (int i = 0; i < nodes_; ++i) {
      if (system.is_fixed(i)) dense_.diagonal().segment(i * per_node_, per_node_).setOnes();
    }
    return !has_own_rows_;
  }

  std::vector<bool> fixed(static_cast<std::size_t>(nodes_));
  for (int i = 0; i < nodes_; ++i) fixed[static_cast<std::size_t>(i)] = system.is_fixed(i);
  bool are_same = size_ == former_size && sparse_.rows() == size_ && fixed == known_fixed_;
  known_fixed_.swap(fixed);
  if (are_same) {
    adding_ = Adding::ToSlots;
    next_known_ = 0;
    next_slot_ = 0;
    sparse_.coeffs().setZero();
    add_terms(x, curvature);
    are_same = adding_ == Adding::ToSlots && next_known_ == known_.size();
  }
  if (!are_same) {
    adding_ = Adding::Recorded;
    known_.clear();
    add_terms(x, curvature);
    make_pattern();
  }
  for (int i = 0; i < nodes_; ++i) {
    for (int d = 0; system.is_fixed(i) && d < per_node_; ++d) pivot(i * per_node_ + d) = 1;
  }
  return !has_own_rows_;
}

void SystemMatrix::add_terms(const Eigen::MatrixXd& x, Curvature curvature) {
  int hidden = nodes_;
  for (int t = 0; t < system_->term_count(); ++t) {
    const Term& term = system_->term(t);
    if (term.size() == 0) continue;
    set_hidden_node(term.has_hidden() ? hidden++ : -1);
    term.add_curvature(x, curvature, *this);
  }
}

template <typename Value, typename To>
void SystemMatrix::for_each_entry(const int* nodes, int count, Value&& value, To&& to) const {
  const auto is_fixed = [this](int node) { return node < nodes_ && system_->is_fixed(node); };
  for (int b = 0; b < count; ++b) {
    if (is_fixed(nodes[b])) continue;
    const int column = first_unknown(nodes[b]), columns = unknowns(nodes[b]);
    for (int a = 0; a < count; ++a) {
      const int row = first_unknown(nodes[a]), rows = unknowns(nodes[a]);
      if (row < column || is_fixed(nodes[a])) continue;
      for (int j = 0; j < columns; ++j) {
        for (int i = row == column ? j : 0; i < rows; ++i) to(row + i, column + j, value(a, b, i, j));
      }
    }
  }
}

bool SystemMatrix::are_known(const int* nodes, int count) {
  if (next_known_ + static_cast<std::size_t>(count) >= known_.size()) return false;
  const int* const known = known_.data() + next_known_;
  if (known[0] != count || !std::equal(nodes, nodes + count, known + 1)) return false;
  next_known_ += static_cast<std::size_t>(count) + 1;
  return true;
}

template <typename Value>
void SystemMatrix::add_element(const int* nodes, int count, Value&& value) {
  if (is_dense_) {
    double* const entries = dense_.data();
    for_each_entry(nodes, count, value,
                   [entries, stride = std::ptrdiff_t{size_}](int row, int column, double v) {
                     entries[column * stride + row] += v;
                   });
    return;
  }
  if (adding_ == Adding::ToSlots && !are_known(nodes, count)) adding_ = Adding::Ignored;
  if (adding_ == Adding::ToSlots) {
    double* const entries = sparse_.valuePtr();
    const int* slot = slots_.data() + next_slot_;
    for_each_entry(nodes, count, value, [&](int, int, double v) { entries[*slot++] += v; });
    next_slot_ = static_cast<std::size_t>(slot - slots_.data());
  } else if (adding_ == Adding::Recorded) {
    known_.push_back(count);
    known_.insert(known_.end(), nodes, nodes + count);
    for_each_entry(nodes, count, value, [&](int row, int column, double v) {
      rows_.push_back(row);
      columns_.push_back(column);
      values_.push_back(v);
    });
  }
}

void SystemMatrix::add(const int* nodes, int count, const double* matrix, int rows) {
  has_own_rows_ = true;
  if (is_shared_) return;
  constexpr int kMostNodes = 64;
  int few[kMostNodes];
  std::vector<int> many(count > kMostNodes ? static_cast<std::size_t>(count) : 0);
  int* const first = count > kMostNodes ? many.data() : few;  // the row of each node's first unknown
  for (int a = 0, row = 0; a < count; row += unknowns(nodes[a]), ++a) first[a] = row;
  add_element(nodes, count, [=](int a, int b, int i, int j) {
    return matrix[std::ptrdiff_t{first[b] + j} * rows + first[a] + i];
  });
}

// The same for most small systems. It also adds to the upper triangles of the diagonal's blocks.
template <int D>
void SystemMatrix::add_to_dense(const int* nodes, int arity, int count, const double* c, const double* B) {
  const std::ptrdiff_t stride = size_;
  const auto add = [this, stride](int row, int column, double factor, const double* block) {
    double* const at = dense_.data() + D * (column * stride + row);
    for (int j = 0; j < D; ++j) {
      for (int i = 0; i < D; ++i) at[j * stride + i] += factor * block[D * j + i];
    }
  };
  for (; count > 0; --count, nodes += arity, B += D * D) {
    for (int b = 0; b < arity; ++b) {
      add(nodes[b], nodes[b], c[b] * c[b], B);
      for (int a = 0; a < b; ++a)
        add(std::max(nodes[a], nodes[b]), std::min(nodes[a], nodes[b]), c[a] * c[b], B);
    }
  }
}

void SystemMatrix::add_blocks(const int* nodes, int arity, int count, const double* c, const double* B,
                              int dim) {
  if (is_dense_ && !is_shared_ && !has_fixed_) {
    if (dim == 2) return add_to_dense<2>(nodes, arity, count, c, B);
    if (dim == 3) return add_to_dense<3>(nodes, arity, count, c, B);
    if (dim == 4) return add_to_dense<4>(nodes, arity, count, c, B);
    if (dim == 5) return add_to_dense<5>(nodes, arity, count, c, B);
  }
  const int* const end = nodes + std::ptrdiff_t{arity} * count;
  for (; nodes != end; nodes += arity, B += std::ptrdiff_t{dim} * dim) {
    if (is_shared_) {
      for (int j = 0; j < dim; ++j) {
        for (int i = 0; i < dim; ++i) has_own_rows_ |= B[dim * j + i] != (i == j ? B[0] : 0.0);
      }
      add_element(nodes, arity, [=](int a, int b, int, int) { return c[a] * c[b] * B[0]; });
    } else if (dim == 2) {  // of a known size, which is faster
      add_element(nodes, arity, [=](int a, int b, int i, int j) { return c[a] * c[b] * B[2 * j + i]; });
    } else {
      add_element(nodes, arity, [=](int a, int b, int i, int j) { return c[a] * c[b] * B[dim * j + i]; });
    }
  }
}

void SystemMatrix::add_multiples(const int* nodes, int arity, int count, const double* c, const double* k,
                                 int dim) {
  if (!is_shared_) return CurvatureSink::add_multiples(nodes, arity, count, c, k, dim);
  const bool is_plain = is_dense_ && !has_fixed_;
  for (int e = 0; e < count; ++e, nodes += arity) {
    if (!is_plain) {
      add_element(nodes, arity, [=](int a, int b, int, int) { return c[a] * c[b] * k[e]; });
      continue;
    }
    for (int b = 0; b < arity; ++b) {
      double* const column = dense_.data() + std::ptrdiff_t{nodes[b]} * size_;
      for (int a = 0; a < arity; ++a) {
        if (nodes[a] >= nodes[b]) column[nodes[a]] += c[a] * c[b] * k[e];
      }
    }
  }
}

// Entries by column and then by row, by two counting sorts.
void SystemMatrix::make_pattern() {
  // Every unknown has an entry on the diagonal, for shifts and for nodes without elements.
  const std::size_t added = values_.size();
  for (int c = 0; c < size_; ++c) {
    rows_.push_back(c);
    columns_.push_back(c);
  }
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
  sparse_.resize(size_, size_);
  sparse_.resizeNonZeros(static_cast<Eigen::Index>(inner.size()));
  std::copy(outer.begin(), outer.end(), sparse_.outerIndexPtr());
  std::copy(inner.begin(), inner.end(), sparse_.innerIndexPtr());
  sparse_.coeffs().setZero();
  slots_.resize(added);
  for (std::size_t e = 0; e < added; ++e) sparse_.valuePtr()[slots_[e]] += values_[e];
  rows_ = columns_ = {};
  values_ = {};
  ++pattern_;
}

// The first entry of a column of the triangle.
double& SystemMatrix::pivot(int row) {
  return is_dense_ ? dense_(row, row) : sparse_.valuePtr()[sparse_.outerIndexPtr()[row]];
}
double SystemMatrix::diagonal(int row) const {
  return is_dense_ ? dense_(row, row) : sparse_.valuePtr()[sparse_.outerIndexPtr()[row]];
}

bool SystemMatrix::is_finite() const {
  // Entries in the upper triangle of a dense matrix are 0, or those of the lower.
  return is_dense_ ? all_finite(dense_) : all_finite(sparse_.coeffs());
}

Eigen::VectorXd SystemMatrix::operator*(const Eigen::VectorXd& v) const {
  if (is_dense_) return dense_.selfadjointView<Eigen::Lower>() * v;
  return sparse_.selfadjointView<Eigen::Lower>() * v;
}

void SystemMatrix::shift(const Eigen::VectorXd& node_stiffness, double share) {
  for (int c = 0; c < size_; ++c) {
    const bool is_hidden = c >= nodes_ * per_node_;
    if (!is_hidden && system_->is_fixed(c / per_node_)) continue;
    double& diagonal = pivot(c);
    diagonal += share * (is_hidden ? diagonal : node_stiffness[c / per_node_]);
  }
}

void SystemFactor::analyze(const SystemMatrix& matrix) {
  if (analyzed_ == &matrix && pattern_ == matrix.pattern()) return;
  if (other_) {
    other_->analyze(matrix.sparse());
  } else {
    sparse_.analyze(matrix.sparse(), matrix.nodes(), matrix.per_node());
  }
  analyzed_ = &matrix;
  pattern_ = matrix.pattern();
}

bool SystemFactor::is_thin(const SystemMatrix& matrix) {
  constexpr double kMost = 50;  // multiplications for each row; 10 for a chain, 150 for six neighbours
  if (matrix.is_dense() || other_) return false;
  analyze(matrix);
  return sparse_.multiplications() <= kMost * matrix.rows();
}

bool SystemFactor::factorize(const SystemMatrix& matrix) {
  rows_ = matrix.rows();
  is_dense_ = matrix.is_dense();
  is_shared_ = matrix.is_shared();
  if (is_dense_) {
    const Eigen::MatrixXd& dense = matrix.dense();  // of which the lower triangle counts
    factor_.resize(dense.rows(), dense.cols());
    for (Eigen::Index c = 0; c < dense.cols(); ++c)
      std::copy_n(&dense(c, c), dense.rows() - c, &factor_(c, c));
    if (lanes_v0_1::factorize(lanes_v0_1::SymmetricMatrix<double>{factor_.data(), rows_, rows_}) < rows_)
      return false;
    for (int c = 0; c < matrix.rows(); ++c) {
      if (!is_pivot(factor_(c, c) * factor_(c, c), matrix.diagonal(c))) return false;
    }
    inverse_pivots_ = factor_.diagonal().cwiseInverse();
    return true;
  }
  analyze(matrix);
  return other_ ? other_->factorize(matrix.sparse()) : sparse_.factorize(matrix.sparse());
}

void SystemFactor::solve_dense(Eigen::MatrixXd& right) const {
  lanes_v0_1::solve(
      {factor_.data(), inverse_pivots_.data(), rows_, right.data(), static_cast<int>(right.cols())});
}

Eigen::MatrixXd SystemFactor::solve_all(Eigen::MatrixXd right) const {
  if (!is_dense_ && other_) return other_->solve(right);
  if (!is_dense_) return sparse_.solve(right);
  solve_dense(right);
  return right;
}

Eigen::MatrixXd SystemFactor::solve(const Eigen::MatrixXd& points) const {
  if (is_shared_) return solve_all(points.transpose()).transpose();
  Eigen::MatrixXd right = Eigen::VectorXd::Zero(rows_);
  right.reshaped().head(points.size()) = points.reshaped();
  right = solve_all(std::move(right));
  return right.reshaped().head(points.size()).reshaped(points.rows(), points.cols());
}

namespace {

// L D L^T of a dense matrix, in place: L below the diagonal, D on it. Returns how many columns it has: a
// pivot of 0 ends it.
Eigen::Index factorize_indefinite(Eigen::MatrixXd& a) {
  for (Eigen::Index c = 0; c < a.cols(); ++c) {
    const Eigen::Index below = a.rows() - c - 1;
    const double pivot = a(c, c);
    if (pivot == 0 || !is_finite(pivot)) return c;
    const Eigen::VectorXd column = a.col(c).tail(below);
    for (Eigen::Index j = 0; j < below; ++j)
      a.col(c + 1 + j).tail(below - j) -= column[j] / pivot * column.tail(below - j);
    a.col(c).tail(below) /= pivot;
  }
  return a.cols();
}

// From the least pivot of A = L D L^T: v = L^-T e has v^T A v = D_ii.
Eigen::VectorXd negative_direction_of(Eigen::MatrixXd a) {
  const Eigen::Index columns = factorize_indefinite(a);
  Eigen::Index least = 0;
  if (columns == 0 || !(a.diagonal().head(columns).minCoeff(&least) < 0)) return {};
  Eigen::VectorXd v = Eigen::VectorXd::Unit(a.rows(), least);
  a.topLeftCorner(columns, columns)
      .triangularView<Eigen::UnitLower>()
      .transpose()
      .solveInPlace(v.head(columns));
  return v;
}

}  // namespace

Eigen::VectorXd SystemFactor::negative_direction(const SystemMatrix& matrix) {
  if (is_dense_) return negative_direction_of(matrix.dense());
  if (other_) sparse_.analyze(matrix.sparse(), matrix.nodes(), matrix.per_node());
  return sparse_.negative_direction(matrix.sparse());
}

Eigen::VectorXd SystemFactor::diagonal_of_inverse() const {
  Eigen::VectorXd result(rows_);
  std::vector<double> room(static_cast<std::size_t>(lanes_v0_1::kMostLanes * rows_));
  lanes_v0_1::invert(lanes_v0_1::InverseDiagonal{factor_.data(), rows_, result.data(), room.data()});
  return result;
}

double SystemFactor::log_determinant() const {
  if (is_dense_) return 2 * factor_.diagonal().array().log().sum();
  return sparse_.log_determinant();
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
