#include "multifrontal.hpp"

#include <Eigen/OrderingMethods>
#include <algorithm>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <cmath>
#include <limits>
#include <utility>

#include "kernels.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

namespace {

constexpr int kNone = -1;

std::size_t size_of(int count) { return static_cast<std::size_t>(count); }

}  // namespace

// The order in which nodes are eliminated, and those whose columns are stored together.
class MultifrontalFactor::Elimination {
 public:
  // The lower triangle of the nodes' graph, and how many rows each node has.
  Elimination(const Sparse& lower, Indexed<int> weights) : weights_(std::move(weights)) {
    graph_ = lower.selfadjointView<Eigen::Lower>();
    Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
    Eigen::AMDOrdering<int>()(lower.selfadjointView<Eigen::Lower>(), order);
    given_.assign(order.indices().data(), order.indices().data() + order.size());
    make_tree();
    sort_tree();
    make_tree();
    make_groups();
  }

  int count() const { return static_cast<int>(given_.size()); }
  // The number that a node has in the order.
  int number(int node) const { return number_[node]; }
  // The rows of the factor that belong to number k begin here.
  int row(int k) const { return row_[k]; }
  // The first number of each group, and count().
  const Indexed<int>& groups() const { return groups_; }
  double multiplications() const { return multiplications_; }
  // Calls to(i) for the number i of each neighbour of number k.
  template <typename To>
  void for_each_neighbour(int k, To&& to) const {
    for (Sparse::InnerIterator entry(graph_, given_[k]); entry; ++entry) to(number_[entry.row()]);
  }

 private:
  int weight(int k) const { return row_[k + 1] - row_[k]; }

  // The parent of a node is the first one in whose rows its columns of the factor have entries (Liu 1986).
  void make_tree() {
    number_.resize(given_.size());
    row_.assign(given_.size() + 1, 0);
    for (int k = 0; k < count(); ++k) {
      number_[given_[k]] = k;
      row_[k + 1] = row_[k] + weights_[given_[k]];
    }
    parent_.assign(given_.size(), kNone);
    Indexed<int> ancestor(given_.size(), kNone);
    for (int k = 0; k < count(); ++k) {
      for_each_neighbour(k, [&](int i) {
        while (i != kNone && i < k) {
          const int next = std::exchange(ancestor[i], k);
          if (next == kNone) parent_[i] = k;
          i = next;
        }
      });
    }
  }

  // Numbers the nodes so that all those below a node in the tree directly precede it.
  void sort_tree() {
    Indexed<int> child(given_.size(), kNone), next(given_.size(), kNone), order, waiting;
    for (int k = count(); k-- > 0;) {
      if (parent_[k] != kNone) next[k] = std::exchange(child[parent_[k]], k);
    }
    for (int k = 0; k < count(); ++k) {
      if (parent_[k] == kNone) waiting.push_back(k);
    }
    while (!waiting.empty()) {
      const int k = waiting.back();
      waiting.pop_back();
      order.push_back(given_[k]);
      for (int c = child[k]; c != kNone; c = next[c]) waiting.push_back(c);
    }
    std::reverse(order.begin(), order.end());
    given_.swap(order);
  }

  // The rows below those of the node itself in which its columns of the factor have entries.
  Indexed<double> rows_below() const {
    Indexed<double> result(given_.size(), 0);
    Indexed<int> seen(given_.size(), kNone);
    for (int k = 0; k < count(); ++k) {
      seen[k] = k;
      for_each_neighbour(k, [&](int i) {
        for (; i < k && seen[i] != k; i = parent_[i]) {
          seen[i] = k;
          result[i] += weight(k);
        }
      });
    }
    return result;
  }

  // Nodes of the same pattern are together. From the root down, so are then a group and its parent where the
  // one follows the other and few entries are stored in vain.
  void make_groups() {
    struct Group {
      int first;
      double columns, size, zeros;
    };
    const Indexed<double> below = rows_below();
    Indexed<Group> groups;
    Indexed<int> group_of(given_.size());
    multiplications_ = 0;
    for (int k = 0; k < count(); ++k) {
      const bool is_same = k > 0 && parent_[k - 1] == k && below[k - 1] == below[k] + weight(k);
      if (!is_same) groups.push_back({k, 0, weight(k) + below[k], 0});
      groups.back().columns += weight(k);
      group_of[k] = static_cast<int>(groups.size()) - 1;
      for (int c = 1; c <= weight(k); ++c) multiplications_ += (below[k] + c) * (below[k] + c) / 2;
    }
    const int n = static_cast<int>(groups.size());
    Indexed<int> top(size_of(n));  // of those that are together
    for (int g = n; g-- > 0;) {
      top[g] = g;
      const int parent = parent_[(g + 1 < n ? groups[g + 1].first : count()) - 1];
      if (parent == kNone) continue;
      int above = group_of[parent];
      while (top[above] != above) above = top[above] = top[top[above]];
      if (above != g + 1) continue;
      const Group &a = groups[g], &b = groups[g + 1];
      const Group both{a.first, a.columns + b.columns, a.columns + b.size,
                       a.zeros + b.zeros + a.columns * (a.columns + b.size - a.size)};
      const double share = both.zeros / (both.columns * (both.size - both.columns / 2));
      if (both.columns <= 4 || (both.columns <= 16 && share < 0.3) || (both.columns <= 48 && share < 0.1) ||
          share < 0.05) {
        groups[g] = both;
        top[g + 1] = g;
      }
    }
    for (int g = 0; g < n; ++g) {
      if (top[g] == g) groups_.push_back(groups[g].first);
    }
    groups_.push_back(count());
  }

  Sparse graph_;
  Indexed<int> weights_;         // by nodes
  Indexed<int> given_, number_;  // the node that has a number, and the number of a node
  Indexed<int> parent_, row_;    // by numbers
  Indexed<int> groups_;
  double multiplications_ = 0;
};

void MultifrontalFactor::analyze(const Sparse& lower, int nodes, int per_node) {
  const int rows = static_cast<int>(lower.cols()), of_nodes = nodes * per_node;
  const auto node_of = [=](int row) { return row < of_nodes ? row / per_node : row - of_nodes + nodes; };
  const int count = nodes + rows - of_nodes;
  Indexed<int> weights(size_of(count), 1), seen(size_of(count), kNone);
  std::fill_n(weights.begin(), nodes, per_node);
  Sparse graph(count, count);
  for (int c = 0, node = kNone; c < rows; ++c) {
    while (node < node_of(c)) graph.startVec(++node);
    for (Sparse::InnerIterator entry(lower, c); entry; ++entry) {
      const int other = node_of(static_cast<int>(entry.row()));
      if (std::exchange(seen[other], node) != node) graph.insertBackByOuterInnerUnordered(node, other) = 1;
    }
  }
  graph.finalize();
  const Elimination elimination(graph, std::move(weights));
  multiplications_ = elimination.multiplications();
  place_.resize(size_of(rows));
  for (int r = 0; r < rows; ++r)
    place_[r] = elimination.row(elimination.number(node_of(r))) + (r < of_nodes ? r % per_node : 0);
  make_supernodes(elimination);
  make_entries(lower);
  make_room();
}

void MultifrontalFactor::make_supernodes(const Elimination& elimination) {
  const Indexed<int>& groups = elimination.groups();
  const std::size_t count = groups.size() - 1;
  Indexed<int> group_of(size_of(elimination.count())), seen(group_of.size(), kNone);
  for (std::size_t g = 0; g < count; ++g) {
    for (int k = groups[g]; k < groups[g + 1]; ++k) group_of[k] = static_cast<int>(g);
  }
  Indexed<Indexed<int>> below(count), children(count);  // numbers of nodes, and of groups
  supernodes_.clear();
  rows_.clear();
  std::ptrdiff_t values = 0;
  for (int g = 0; g < static_cast<int>(count); ++g) {
    const int end = groups[g + 1];
    const auto add = [&](int k) {
      if (k >= end && std::exchange(seen[k], g) != g) below[g].push_back(k);
    };
    for (int k = groups[g]; k < end; ++k) elimination.for_each_neighbour(k, add);
    for (const int child : children[g]) std::for_each(below[child].begin(), below[child].end(), add);
    for (const int child : children[g]) below[child] = {};
    std::sort(below[g].begin(), below[g].end());
    if (!below[g].empty()) children[group_of[below[g].front()]].push_back(g);

    const auto add_rows = [&](int from, int to) {
      for (int r = elimination.row(from); r < elimination.row(to); ++r) rows_.push_back(r);
    };
    const std::size_t first_row = rows_.size();
    add_rows(groups[g], end);
    const int columns = static_cast<int>(rows_.size() - first_row);
    for (const int k : below[g]) add_rows(k, k + 1);
    const int size = static_cast<int>(rows_.size() - first_row);
    supernodes_.push_back({elimination.row(groups[g]), columns, size, static_cast<int>(children[g].size()),
                           static_cast<std::ptrdiff_t>(first_row), values, 0});
    values += std::ptrdiff_t{size} * columns;
  }
}

void MultifrontalFactor::make_entries(const Sparse& lower) {
  supernode_of_.resize(place_.size());
  for (std::size_t s = 0; s < supernodes_.size(); ++s)
    std::fill_n(supernode_of_.begin() + supernodes_[s].first, supernodes_[s].columns, static_cast<int>(s));
  const auto for_each_entry = [&](auto&& to) {  // to(number, supernode, row, column)
    for (int c = 0; c < static_cast<int>(lower.cols()); ++c) {
      for (int e = lower.outerIndexPtr()[c]; e < lower.outerIndexPtr()[c + 1]; ++e) {
        const auto [column, row] = std::minmax(place_[c], place_[lower.innerIndexPtr()[e]]);
        to(e, supernode_of_[column], row, column);
      }
    }
  };
  Indexed<int> next(supernodes_.size() + 1, 0);
  for_each_entry([&](int, int s, int, int) { ++next[s + 1]; });
  for (std::size_t s = 0; s < supernodes_.size(); ++s) {
    supernodes_[s].entries = next[s + 1];
    next[s + 1] += next[s];
  }
  entries_.resize(static_cast<std::size_t>(lower.nonZeros()));
  for_each_entry([&](int e, int of, int row, int column) {
    const Supernode& s = supernodes_[size_of(of)];
    const std::ptrdiff_t at = std::lower_bound(rows_of(s), rows_of(s) + s.size, row) - rows_of(s);
    entries_[size_of(next[of]++)] = {e, std::ptrdiff_t{column - s.first} * s.size + at};
  });
}

void MultifrontalFactor::make_room() {
  const auto square = [](int n) { return static_cast<double>(n) * n; };
  double largest = 0, left = 0, most_left = 0, values = 0;
  std::vector<double> fronts;
  for (const Supernode& s : supernodes_) {
    for (int c = 0; c < s.children; ++c) {
      left -= fronts.back();
      fronts.pop_back();
    }
    if (s.below() > 0) left += fronts.emplace_back(square(s.below()));
    most_left = std::max(most_left, left);
    largest = std::max(largest, square(s.size));
    values += static_cast<double>(s.size) * s.columns;
  }
  require_memory(sizeof(double) * (values + largest + most_left));
  values_.resize(static_cast<std::size_t>(values));
  front_.resize(static_cast<std::size_t>(largest));
  left_.resize(static_cast<std::size_t>(most_left));
  position_.resize(place_.size());
}

bool MultifrontalFactor::factorize(const Sparse& lower) {
  double* const front = front_.data();
  double* left = left_.data();
  const Entry* entry = entries_.data();
  std::vector<const Supernode*> waiting;  // those whose fronts are left
  Eigen::VectorXd diagonal;
  for (const Supernode& s : supernodes_) {
    const std::ptrdiff_t n = s.size;
    const int* const rows = rows_of(s);
    for (std::ptrdiff_t c = 0; c < n; ++c) std::fill(front + c * n + c, front + (c + 1) * n, 0.0);
    for (const Entry* const end = entry + s.entries; entry != end; ++entry)
      front[entry->target] = lower.valuePtr()[entry->source];
    diagonal = Eigen::Map<const Eigen::MatrixXd>(front, n, s.columns).diagonal();
    for (int r = 0; r < s.size; ++r) position_[rows[r]] = r;
    for (int c = 0; c < s.children; ++c) {
      const Supernode& child = *waiting.back();
      waiting.pop_back();
      const std::ptrdiff_t m = child.below();
      const int* const of = rows_of(child) + child.columns;
      left -= m * m;
      for (std::ptrdiff_t j = 0; j < m; ++j) {
        double* const to = front + n * position_[of[j]];
        for (std::ptrdiff_t i = j; i < m; ++i) to[position_[of[i]]] += left[m * j + i];
      }
    }
    const std::ptrdiff_t done =
        lanes_v0_1::factorize(lanes_v0_1::SymmetricMatrix<double>{front, n, s.columns});
    for (std::ptrdiff_t c = 0; c < s.columns; ++c) {
      const double root = front[c * (n + 1)], pivot = c < done ? root * root : root;
      if (is_pivot(pivot, diagonal[c])) continue;
      refused_ = {static_cast<std::size_t>(&s - supernodes_.data()), static_cast<int>(c),
                  pivot < -kPivotRounding * std::abs(diagonal[c])};
      return false;
    }
    std::copy_n(front, n * s.columns, values_.data() + s.values);
    if (s.below() == 0) continue;
    const std::ptrdiff_t m = s.below();
    for (std::ptrdiff_t j = 0; j < m; ++j)
      std::copy_n(front + (s.columns + j) * (n + 1), m - j, left + j * (m + 1));
    left += m * m;
    waiting.push_back(&s);
  }
  return true;
}

void MultifrontalFactor::substitute_forward(double* x, std::vector<double>& part) const {
  for (const Supernode& s : supernodes_) {
    const int* const rows = rows_of(s);
    const double* column = values_.data() + s.values;
    part.assign(size_of(s.size), 0);
    std::copy_n(x + s.first, s.columns, part.begin());
    for (int c = 0; c < s.columns; ++c, column += s.size) {
      const double value = x[s.first + c] = part[size_of(c)] / column[c];
      for (int r = c + 1; r < s.size; ++r) part[size_of(r)] -= value * column[r];
    }
    for (int r = s.columns; r < s.size; ++r) x[rows[r]] += part[size_of(r)];
  }
}

void MultifrontalFactor::substitute_backward(double* x, std::size_t count, std::vector<double>& part) const {
  while (count-- > 0) {
    const Supernode& s = supernodes_[count];
    const int* const rows = rows_of(s);
    part.resize(size_of(s.size));
    for (int r = 0; r < s.size; ++r) part[size_of(r)] = x[rows[r]];
    const Eigen::Map<const Eigen::VectorXd> known(part.data(), s.size);
    for (int c = s.columns; c-- > 0;) {
      const auto column = columns_of(s).col(c);
      const int below = s.size - c - 1;
      part[size_of(c)] = (part[size_of(c)] - column.tail(below).dot(known.tail(below))) / column[c];
    }
    std::copy_n(part.begin(), s.columns, x + s.first);
  }
}

Eigen::MatrixXd MultifrontalFactor::solve(const Eigen::MatrixXd& right) const {
  Eigen::MatrixXd result(right.rows(), right.cols());
  Eigen::VectorXd x(right.rows());
  std::vector<double> part;
  for (Eigen::Index j = 0; j < right.cols(); ++j) {
    for (Eigen::Index r = 0; r < right.rows(); ++r) x[place_[r]] = right(r, j);
    substitute_forward(x.data(), part);
    substitute_backward(x.data(), supernodes_.size(), part);
    for (Eigen::Index r = 0; r < right.rows(); ++r) result(r, j) = x[place_[r]];
  }
  return result;
}

Eigen::VectorXd MultifrontalFactor::negative_direction(Sparse lower) {
  if (factorize(lower)) return {};
  if (!refused_.is_negative) {
    // A pivot is often 0 where motions are free: with a slightly larger diagonal, negative ones still are.
    const double share = std::sqrt(std::numeric_limits<double>::epsilon());
    for (Eigen::Index c = 0; c < lower.cols(); ++c) {
      double& diagonal = lower.valuePtr()[lower.outerIndexPtr()[c]];
      diagonal += share * std::abs(diagonal);
    }
    if (factorize(lower) || !refused_.is_negative) return {};
  }
  // The leading block A of the matrix that ends with this pivot d has A = L diag(1, .., 1, d) L^T, with a row
  // l^T of L and a 1 below the factor so far: L^T v = e has v^T A v = d.
  const Supernode& s = supernodes_[refused_.supernode];
  const Eigen::Map<const Eigen::MatrixXd> front(front_.data(), s.size, s.size);
  const Eigen::Index c = refused_.column;
  Eigen::VectorXd v = Eigen::VectorXd::Zero(lower.cols());
  auto own = v.segment(s.first, c);
  own = -front.row(c).head(c).transpose();
  front.topLeftCorner(c, c).transpose().triangularView<Eigen::Upper>().solveInPlace(own);
  v[s.first + c] = 1;
  std::vector<double> part;
  substitute_backward(v.data(), refused_.supernode, part);
  return Eigen::VectorXd::NullaryExpr(v.rows(), [&](Eigen::Index r) { return v[place_[r]]; });
}

double MultifrontalFactor::log_determinant() const {
  double sum = 0;
  for (const Supernode& s : supernodes_) sum += 2 * columns_of(s).diagonal().array().log().sum();
  return sum;
}

MultifrontalInverse::MultifrontalInverse(const MultifrontalFactor& factor) : factor_(factor) {
  require_memory(sizeof(double) * static_cast<double>(factor.values_.size()));
  values_.resize(factor.values_.size());
  // The transpose of a matrix that is stored by rows is stored by columns.
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  RowMajor inverse, Y, Z_RC;  // L_CC^-1
  Eigen::MatrixXd product;
  Eigen::VectorXd room;
  const auto multiply = [&product](const double* left, Eigen::Index stride, Eigen::Index rows,
                                   const RowMajor& right) -> const Eigen::MatrixXd& {
    product.resize(rows, right.cols());
    lanes_v0_1::multiply(lanes_v0_1::MatrixProduct{left, stride, rows, right.rows(), right.data(),
                                                   right.cols(), product.data()});
    return product;
  };
  for (auto s = factor.supernodes_.rbegin(); s != factor.supernodes_.rend(); ++s) {
    const Eigen::Index c = s->columns, m = s->below();
    const auto columns = factor.columns_of(*s);
    Eigen::Map<Eigen::MatrixXd> Z(values_.data() + s->values, s->size, c);
    if (m == 0) {
      room.resize(c * lanes_v0_1::kMostLanes);
      lanes_v0_1::invert(lanes_v0_1::Inverse<double>{columns.data(), c, Z.data(), room.data()});
      continue;
    }
    inverse.setIdentity(c, c);
    columns.topRows(c).triangularView<Eigen::Lower>().solveInPlace(inverse);
    Z.topRows(c) = multiply(inverse.data(), c, c, inverse);
    gather(*s);
    Y = multiply(columns.data() + c, s->size, m, inverse);
    Z_RC = -multiply(gathered_.data(), m, m, Y);
    Z.bottomRows(m) = Z_RC;
    Z.topRows(c) -= multiply(Y.data(), c, c, Z_RC);
  }
}

// By the rules of fill, the front of a row in R has all of R beyond it among its rows.
void MultifrontalInverse::gather(const MultifrontalFactor::Supernode& s) {
  const int m = s.below();
  const int* const below = factor_.rows_of(s) + s.columns;
  gathered_.resize(m, m);
  std::vector<int> place(size_of(m));
  for (int a = 0; a < m;) {
    const auto& other = factor_.supernodes_[size_of(factor_.supernode_of_[below[a]])];
    const int* row = factor_.rows_of(other);
    for (int b = a; b < m; ++b) {
      while (*row != below[b]) ++row;
      place[size_of(b)] = static_cast<int>(row - factor_.rows_of(other));
    }
    for (; a < m && below[a] < other.first + other.columns; ++a) {
      const double* const column =
          values_.data() + other.values + std::ptrdiff_t{below[a] - other.first} * other.size;
      for (int b = a; b < m; ++b) gathered_(a, b) = gathered_(b, a) = column[place[size_of(b)]];
    }
  }
}

double MultifrontalInverse::operator()(int i, int j) const {
  const auto [column, row] = std::minmax(factor_.place_[i], factor_.place_[j]);
  const auto& s = factor_.supernodes_[size_of(factor_.supernode_of_[column])];
  return values_[static_cast<std::size_t>(s.values + std::ptrdiff_t{column - s.first} * s.size + row -
                                          s.first)];
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
