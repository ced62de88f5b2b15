#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "loss.hpp"
#include "methods.hpp"
#include "run.hpp"

// Newton's method whose steps are found by conjugate gradients.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

namespace {

// The second derivatives at x as an operator: it multiplies the elements one by one, without a matrix of all
// of them. A vector has the coordinates of the nodes and then the hidden unknowns.
class HessianOperator final : public CurvatureSink {
 public:
  void assemble(const System& system, const Eigen::MatrixXd& x) {
    nodes_ = system.nodes();
    dim_ = system.dim();
    node_blocks_.setZero(dim_, dim_ * nodes_);
    for (Group& group : groups_) group.clear();
    used_ = 0;
    elements_.clear();
    hidden_ = 0;
    for (int t = 0; t < system.term_count(); ++t) {
      const Term& term = system.term(t);
      if (term.size() == 0) continue;
      set_hidden_node(term.has_hidden() ? nodes_ + hidden_++ : -1);
      term.add_curvature(x, Curvature::True, *this);
    }
    fixed_.clear();
    for (int i = 0; i < nodes_; ++i) {
      if (system.is_fixed(i)) fixed_.push_back(i);
    }
  }

  int rows() const { return nodes_ * dim_ + hidden_; }

  // result = H v, 0 for fixed nodes.
  void apply(const Eigen::VectorXd& v, Eigen::VectorXd& result) const {
    result.resize(rows());
    result.tail(hidden_).setZero();
    with_dim(dim_, [&]<int D>() {
      for (std::ptrdiff_t i = 0; i < nodes_; ++i) {
        const Eigen::Map<const BlockOf<D>> block(node_blocks_.data() + i * dim_ * dim_, dim_, dim_);
        point<D>(result, i).noalias() = block * point<D>(v, i);
      }
      for (std::size_t g = 0; g < used_; ++g) apply<D>(groups_[g], v, result);
    });
    for (const Element& element : elements_) apply(element, v, result);
    for (const int i : fixed_) result.segment(std::ptrdiff_t{dim_} * i, dim_).setZero();
  }

  void add_blocks(const int* nodes, int arity, int count, const double* c, const double* B,
                  int dim) override {
    with_dim(dim, [&]<int D>() {
      const std::ptrdiff_t entries = std::ptrdiff_t{dim} * dim;
      if (arity == 1) {
        for (std::ptrdiff_t e = 0; e < count; ++e) {
          double* const block = node_blocks_.data() + entries * nodes[e];
          for (std::ptrdiff_t entry = 0; entry < entries; ++entry)
            block[entry] += c[0] * c[0] * B[e * entries + entry];
        }
        return;
      }
      Group& group = group_of(arity, c);
      group.nodes.insert(group.nodes.end(), nodes, nodes + std::ptrdiff_t{arity} * count);
      const std::size_t before = group.blocks.size();
      const std::ptrdiff_t kept = kept_entries<D>(dim);
      group.blocks.resize(before + static_cast<std::size_t>(kept * count));
      double* to = group.blocks.data() + before;
      for (std::ptrdiff_t e = 0; e < count; ++e, to += kept) pack<D>(B + e * entries, entries, to);
    });
  }

  void add(const int* nodes, int count, const double* matrix, int rows) override {
    const auto entries = std::ptrdiff_t{rows} * rows;
    elements_.push_back({{nodes, nodes + count}, {matrix, matrix + entries}, rows});
  }

 private:
  // Elements of as many nodes with the same coefficients.
  struct Group {
    int arity = 0;
    std::vector<double> coefficients;
    std::vector<int> nodes;
    std::vector<double> blocks;  // in 2 and 3 dimensions, the lower triangles

    void clear() {
      nodes.clear();
      blocks.clear();
    }
  };
  struct Element {
    std::vector<int> nodes;
    std::vector<double> matrix;
    int rows;
  };

  template <int D>
  Eigen::Map<PointOf<D>> point(Eigen::VectorXd& v, std::ptrdiff_t i) const {
    return {v.data() + i * dim_, dim_};
  }
  template <int D>
  Eigen::Map<const PointOf<D>> point(const Eigen::VectorXd& v, std::ptrdiff_t i) const {
    return {v.data() + i * dim_, dim_};
  }

  Group& group_of(int arity, const double* c) {
    const auto fits = [&](const Group& group) {
      return group.arity == arity && std::equal(c, c + arity, group.coefficients.begin());
    };
    if (used_ > 0 && fits(groups_[used_ - 1])) return groups_[used_ - 1];
    if (used_ == groups_.size()) groups_.emplace_back();
    Group& group = groups_[used_++];
    if (!fits(group)) {
      group.arity = arity;
      group.coefficients.assign(c, c + arity);
    }
    return group;
  }

  template <int D>
  static std::ptrdiff_t kept_entries(int dim) {
    return D == Eigen::Dynamic ? std::ptrdiff_t{dim} * dim : D * (D + 1) / 2;
  }
  template <int D>
  static void pack(const double* block, std::ptrdiff_t entries, double* to) {
    if constexpr (D == Eigen::Dynamic) {
      std::copy(block, block + entries, to);
    } else {
      for (int j = 0; j < D; ++j) {
        for (int i = j; i < D; ++i) *to++ = block[D * j + i];
      }
    }
  }
  // B d.
  template <int D>
  static PointOf<D> times(const double* block, const PointOf<D>& d) {
    if constexpr (D == 2) {
      return {block[0] * d[0] + block[1] * d[1], block[1] * d[0] + block[2] * d[1]};
    } else if constexpr (D == 3) {
      return {block[0] * d[0] + block[1] * d[1] + block[2] * d[2],
              block[1] * d[0] + block[3] * d[1] + block[4] * d[2],
              block[2] * d[0] + block[4] * d[1] + block[5] * d[2]};
    } else {
      return Eigen::Map<const Eigen::MatrixXd>(block, d.size(), d.size()) * d;
    }
  }

  template <int D>
  void apply(const Group& group, const Eigen::VectorXd& v, Eigen::VectorXd& result) const {
    const double* block = group.blocks.data();
    const std::ptrdiff_t kept = kept_entries<D>(dim_);
    const int *node = group.nodes.data(), *const end = node + group.nodes.size();
    const double* const c = group.coefficients.data();
    if (group.arity == 2 && c[0] == 1 && c[1] == -1) {  // most
      for (; node != end; node += 2, block += kept) {
        const PointOf<D> d = point<D>(v, node[0]) - point<D>(v, node[1]);
        const PointOf<D> image = times<D>(block, d);
        point<D>(result, node[0]) += image;
        point<D>(result, node[1]) -= image;
      }
      return;
    }
    for (; node != end; node += group.arity, block += kept) {
      PointOf<D> d = c[0] * point<D>(v, node[0]);
      for (int a = 1; a < group.arity; ++a) d += c[a] * point<D>(v, node[a]);
      const PointOf<D> image = times<D>(block, d);
      for (int a = 0; a < group.arity; ++a) point<D>(result, node[a]) += c[a] * image;
    }
  }

  void apply(const Element& element, const Eigen::VectorXd& v, Eigen::VectorXd& result) const {
    Eigen::VectorXd own(element.rows);
    const auto for_each = [&](auto&& f) {  // f(first row of the element, first of the vector, rows)
      std::ptrdiff_t row = 0;
      for (const std::ptrdiff_t node : element.nodes) {
        const bool is_hidden = node >= nodes_;
        const std::ptrdiff_t rows = is_hidden ? 1 : dim_;
        f(row, is_hidden ? node - nodes_ + std::ptrdiff_t{nodes_} * dim_ : node * dim_, rows);
        row += rows;
      }
    };
    for_each([&](auto row, auto at, auto rows) { own.segment(row, rows) = v.segment(at, rows); });
    own = (Eigen::Map<const Eigen::MatrixXd>(element.matrix.data(), element.rows, element.rows) * own).eval();
    for_each([&](auto row, auto at, auto rows) { result.segment(at, rows) += own.segment(row, rows); });
  }

  int nodes_ = 0, dim_ = 0, hidden_ = 0;
  Eigen::MatrixXd node_blocks_;  // of elements of one node
  std::vector<Group> groups_;    // whose memory is kept; the first used_ ones count
  std::size_t used_ = 0;
  std::vector<Element> elements_;  // of no such form
  std::vector<int> fixed_;
};

// The inverse of a symmetric positive definite block, in place.
template <typename Block>
void invert_definite(Block& block) {
  if constexpr (Block::RowsAtCompileTime != Eigen::Dynamic) {
    block = block.inverse().eval();
  } else {  // Gauss and Jordan; Eigen's is a decomposition that takes a second to compile
    for (Eigen::Index k = 0; k < block.rows(); ++k) {
      const double inverse_pivot = 1 / block(k, k);
      block(k, k) = 1;
      for (Eigen::Index j = 0; j < block.rows(); ++j) block(k, j) *= inverse_pivot;
      for (Eigen::Index i = 0; i < block.rows(); ++i) {
        if (i == k) continue;
        const double factor = block(i, k);
        block(i, k) = 0;
        for (Eigen::Index j = 0; j < block.rows(); ++j) block(i, j) -= factor * block(k, j);
      }
    }
  }
}

// The inverses of the diagonal blocks of the clamped second derivatives, with a share of the nodes'
// stiffness: those of nodes, and of hidden unknowns.
class BlockDiagonal final : public CurvatureSink {
 public:
  void assemble(const SystemRun& run) {
    constexpr double kShare = 1e-3;
    const System& system = run.system();
    dim_ = system.dim();
    nodes_ = system.nodes();
    blocks_.setZero(dim_, dim_ * nodes_);
    hidden_.clear();
    for (int i = 0; i < nodes_; ++i)
      blocks_.middleCols(dim_ * i, dim_).diagonal().setConstant(kShare * run.rule().node_stiffness()[i]);
    for (int t = 0; t < system.term_count(); ++t) {
      const Term& term = system.term(t);
      if (term.size() == 0) continue;
      if (term.has_hidden()) {
        set_hidden_node(nodes_ + static_cast<int>(hidden_.size()));
        hidden_.push_back(0);
      }
      term.add_curvature(run.x(), Curvature::Clamped, *this);
    }
    for (double& h : hidden_) h *= 1 + kShare;
    with_dim(dim_, [&]<int D>() {
      for (int i = 0; i < nodes_; ++i) {
        Eigen::Map<BlockOf<D>> block(blocks_.data() + std::ptrdiff_t{dim_} * dim_ * i, dim_, dim_);
        if (system.is_fixed(i)) {
          block.setIdentity();
        } else {
          invert_definite(block);
        }
      }
    });
  }

  void add_blocks(const int* nodes, int arity, int count, const double* c, const double* B,
                  int dim) override {
    with_dim(dim, [&]<int D>() {
      const std::ptrdiff_t entries = std::ptrdiff_t{dim} * dim;
      for (int e = 0; e < count; ++e, nodes += arity, B += entries) {
        for (int a = 0; a < arity; ++a) {
          double sum = 0;
          for (int b = 0; b < arity; ++b) sum += nodes[b] == nodes[a] ? c[b] : 0.0;
          Eigen::Map<BlockOf<D>>(blocks_.data() + entries * nodes[a], dim, dim) +=
              (c[a] * sum) * Eigen::Map<const BlockOf<D>>(B, dim, dim);
        }
      }
    });
  }

  void add(const int* nodes, int count, const double* matrix, int rows) override {
    for (int a = 0, row = 0; a < count; ++a) {
      if (nodes[a] >= nodes_) {
        hidden_[static_cast<std::size_t>(nodes[a] - nodes_)] += matrix[row * rows + row];
        ++row;
        continue;
      }
      for (int b = 0, column = 0; b < count; column += nodes[b] < nodes_ ? dim_ : 1, ++b) {
        if (nodes[b] != nodes[a]) continue;
        for (int j = 0; j < dim_; ++j) {
          for (int i = 0; i < dim_; ++i)
            blocks_(i, dim_ * nodes[a] + j) += matrix[(column + j) * rows + row + i];
        }
      }
      row += dim_;
    }
  }

  // result = M^-1 v; returns v^T M^-1 v.
  double solve(const Eigen::VectorXd& v, Eigen::VectorXd& result) const {
    result.resize(v.size());
    double product = 0;
    with_dim(dim_, [&]<int D>() {
      for (std::ptrdiff_t i = 0; i < nodes_; ++i) {
        const Eigen::Map<const BlockOf<D>> block(blocks_.data() + i * dim_ * dim_, dim_, dim_);
        const Eigen::Map<const PointOf<D>> from(v.data() + i * dim_, dim_);
        const PointOf<D> solution = block * from;
        Eigen::Map<PointOf<D>>(result.data() + i * dim_, dim_) = solution;
        product += from.dot(solution);
      }
    });
    const Eigen::Index points = Eigen::Index{dim_} * nodes_;
    for (std::size_t h = 0; h < hidden_.size(); ++h) {
      const Eigen::Index row = points + static_cast<Eigen::Index>(h);
      result[row] = v[row] / hidden_[h];
      product += v[row] * result[row];
    }
    return product;
  }

 private:
  int dim_ = 0, nodes_ = 0;
  Eigen::MatrixXd blocks_;
  std::vector<double> hidden_;
};

}  // namespace

Summary SystemNewtonCg::solve(const System& system, Eigen::MatrixXd& x) const {
  return SystemRun::solve(name(), options, system, x, [](SystemRun& run) {
    if (run.lacks_hessian()) return Status::InvalidInput;
    HessianOperator hessian;
    BlockDiagonal preconditioner;
    Eigen::VectorXd step, residual, direction, image, z;
    double previous_norm = 0, forcing = 0.5;
    while (!run.is_over()) {
      hessian.assemble(run.system(), run.x());
      preconditioner.assemble(run);

      const double norm = run.gradient().norm();
      if (previous_norm > 0) {
        const double ratio = norm / previous_norm, safe = 0.9 * forcing * forcing;
        forcing = std::clamp(std::max(0.9 * ratio * ratio, safe > 0.1 ? safe : 0.0), 1e-6, 0.5);
      }
      previous_norm = norm;

      const Eigen::Index points = run.x().size();
      residual.setZero(hessian.rows());
      residual.head(points) = -run.gradient().reshaped();
      step.setZero(residual.size());
      double product = preconditioner.solve(residual, z);
      direction = z;
      const double target = forcing * forcing * product;
      const auto most = 10 + 2 * residual.size();
      bool is_definite = true;  // as far as the directions tell
      for (Eigen::Index inner = 0; inner < most; ++inner) {
        hessian.apply(direction, image);
        const double curvature = direction.dot(image);
        if (!(curvature > 0)) {
          is_definite = false;
          if (inner == 0) step = direction;
          break;
        }
        const double length = product / curvature;
        step += length * direction;
        residual -= length * image;
        const double next = preconditioner.solve(residual, z);
        if (!(next > target) || run.is_asked_to_stop()) break;
        direction = z + (next / product) * direction;
        product = next;
        ++run.summary().linear_solves;
      }
      const Eigen::MatrixXd newton = step.head(points).reshaped(run.x().rows(), run.x().cols());
      double length = is_definite ? 1.0 : run.trusted_step(newton);
      if (!run.search(newton, length)) {
        length = 1;
        const Eigen::MatrixXd descent =
            -run.gradient() * run.rule().node_stiffness().cwiseInverse().asDiagonal();
        if (!run.search(descent, length)) return Status::NoProgress;
      }
      ++run.summary().iterations;
    }
    return run.end();
  });
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
