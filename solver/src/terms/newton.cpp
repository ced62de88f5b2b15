#include <Eigen/LU>
#include <algorithm>
#include <asterism/solver/detail/finite.hpp>
#include <cmath>
#include <limits>

#include "loss.hpp"
#include "matrix.hpp"
#include "methods.hpp"
#include "run.hpp"

// Methods that need second derivatives.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

namespace {

bool lacks_hessian(SystemRun& run) {
  const std::string missing = missing_curvature(run.system(), Curvature::True);
  if (missing.empty()) return false;
  run.summary().message = std::string_view("the method needs second derivatives: " + missing);
  return true;
}

// Moves x down from a saddle along v, of negative curvature, over all unknowns: to the first of ever shorter
// steps to either side that lowers the energy by a tenth of what the curvature promises. False if none does.
bool leave_saddle(SystemRun& run, const Eigen::VectorXd& v, double curvature) {
  Eigen::MatrixXd direction = v.head(run.x().size()).reshaped(run.x().rows(), run.x().cols());
  const double scale = run.rule().length() / direction.colwise().norm().maxCoeff();
  if (!is_finite(scale)) return false;
  direction *= scale;
  curvature *= scale * scale;
  constexpr int kMaxHalvings = 40;
  double t = 0.5;
  for (int halving = 0; halving < kMaxHalvings; ++halving, t /= 2) {
    const Eigen::MatrixXd ahead = run.x() + t * direction, behind = run.x() - t * direction;
    const double energy_ahead = energy(run.system(), ahead), energy_behind = energy(run.system(), behind);
    run.summary().energy_evaluations += 2;
    const double lowest = std::min(energy_ahead, energy_behind);
    if (!(lowest < run.energy() + t * t * curvature / 20) || !is_finite(lowest)) continue;
    if (!(lowest < run.energy() - 4 * std::numeric_limits<double>::epsilon() * std::abs(run.energy())))
      return false;
    run.move_to(energy_ahead <= energy_behind ? ahead : behind);
    return true;
  }
  return false;
}

// The step along a direction up to which a quadratic model is trusted: as far as the nodes are from where
// their springs pull them, or the characteristic length. A robust loss may have little curvature, and beyond
// it none and no force.
double trusted_step(const SystemRun& run, const Eigen::MatrixXd& direction) {
  constexpr double kTrusted = 4;
  const double reach = run.rule().stationarity(run.gradient()) * run.rule().length();
  return std::min(1.0,
                  kTrusted * std::max(run.rule().length(), reach) / direction.colwise().norm().maxCoeff());
}

}  // namespace

Summary SystemNewton::solve(const System& system, Eigen::MatrixXd& x) const {
  return SystemRun::solve(name(), options, system, x, [](SystemRun& run) {
    if (lacks_hessian(run)) return Status::InvalidInput;
    constexpr double kLeastShare = 1e-9, kMostShare = 1e3;
    constexpr int kMaxEscapes = 50;
    SystemMatrix matrix(SystemMatrix::Storage::Best), clamped(SystemMatrix::Storage::Best);
    SystemFactor factor, clamped_factor;
    double share = 1e-3;  // of the nodes' stiffness
    int escapes = 0;
    while (true) {
      const bool is_over = run.is_over();
      if (is_over && run.end() != Status::Converged) return run.end();
      matrix.assemble(run.system(), run.x(), Curvature::True);
      ++run.summary().factorizations;
      const bool is_definite = factor.factorize(matrix);
      if (is_over) {
        run.summary().positive_definite = is_definite ? 1 : 0;
        if (is_definite || !run.rule().reached(run.gradient()) || escapes == kMaxEscapes) return run.end();
        const Eigen::VectorXd v = factor.negative_direction(matrix);
        if (v.size() == 0) return run.end();
        const double curvature = v.dot(matrix * v);
        // What rounding may have made of a free motion is none.
        const double scale =
            v.cwiseAbs2().head(run.x().size()).sum() * run.rule().node_stiffness().maxCoeff();
        if (!(curvature < -1e-9 * scale) || !leave_saddle(run, v, curvature)) return run.end();
        ++escapes;
        ++run.summary().iterations;
        continue;
      }
      double step = 1;
      ++run.summary().linear_solves;
      if (is_definite) {
        const Eigen::MatrixXd direction = -factor.solve(run.gradient());
        if (trusted_step(run, direction) == 1 && run.search(direction, step)) {
          ++run.summary().iterations;
          continue;
        }
      }
      bool has_moved = false, is_whole = false;
      while (!has_moved) {
        clamped.assemble(run.system(), run.x(), Curvature::Clamped);
        clamped.shift(run.rule().node_stiffness(), share);
        ++run.summary().factorizations, ++run.summary().linear_solves;
        if (clamped_factor.factorize(clamped)) {
          const Eigen::MatrixXd direction = -clamped_factor.solve(run.gradient());
          const double first = step = trusted_step(run, direction);
          has_moved = run.search(direction, step);
          is_whole = has_moved && step == first;
        }
        // A step that was not cut short was trusted too little.
        share = std::max(is_whole ? share / 10 : share * 4, kLeastShare);
        if (!has_moved && share > kMostShare) return Status::NoProgress;
      }
      share = std::min(share, 1.0);
      ++run.summary().iterations;
    }
  });
}

namespace {

// The inverses of the diagonal blocks of the clamped second derivatives, with a share of the nodes'
// stiffness: those of nodes, and of hidden unknowns.
class BlockDiagonal final : public CurvatureSink {
 public:
  explicit BlockDiagonal(const SystemRun& run) : dim_(run.system().dim()), nodes_(run.system().nodes()) {
    constexpr double kShare = 1e-3;
    const System& system = run.system();
    blocks_.setZero(dim_, dim_ * nodes_);
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
    for (int i = 0; i < nodes_; ++i) {
      auto block = blocks_.middleCols(dim_ * i, dim_);
      if (system.is_fixed(i)) {
        block.setIdentity();
      } else {
        with_dim(dim_, [&]<int D>() { block = BlockOf<D>(BlockOf<D>(block).inverse()); });
      }
    }
  }

  void add_blocks(const int* nodes, int count, const double* c, const double* B, int dim) override {
    for (int a = 0; a < count; ++a) {
      double* const block = blocks_.data() + std::ptrdiff_t{dim} * dim * nodes[a];
      for (int b = 0; b < count; ++b) {
        if (nodes[b] != nodes[a]) continue;
        for (int entry = 0; entry < dim * dim; ++entry) block[entry] += c[a] * c[b] * B[entry];
      }
    }
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

  Eigen::VectorXd operator()(const Eigen::VectorXd& v) const {
    Eigen::VectorXd result(v.size());
    with_dim(dim_, [&]<int D>() {
      for (Eigen::Index i = 0; i < nodes_; ++i) {
        const Eigen::Map<const BlockOf<D>> block(blocks_.data() + dim_ * dim_ * i, dim_, dim_);
        Eigen::Map<PointOf<D>>(result.data() + dim_ * i, dim_).noalias() =
            block * Eigen::Map<const PointOf<D>>(v.data() + dim_ * i, dim_);
      }
    });
    const Eigen::Index points = dim_ * nodes_;
    for (std::size_t h = 0; h < hidden_.size(); ++h) {
      const Eigen::Index row = points + static_cast<Eigen::Index>(h);
      result[row] = v[row] / hidden_[h];
    }
    return result;
  }

 private:
  int dim_, nodes_;
  Eigen::MatrixXd blocks_;
  std::vector<double> hidden_;
};

}  // namespace

Summary SystemNewtonCg::solve(const System& system, Eigen::MatrixXd& x) const {
  return SystemRun::solve(name(), options, system, x, [](SystemRun& run) {
    if (lacks_hessian(run)) return Status::InvalidInput;
    SystemMatrix matrix(SystemMatrix::Storage::Best);
    double previous_norm = 0, forcing = 0.5;
    while (!run.is_over()) {
      matrix.assemble(run.system(), run.x(), Curvature::True);
      const BlockDiagonal precondition(run);

      const double norm = run.gradient().norm();
      if (previous_norm > 0) {
        const double ratio = norm / previous_norm, safe = 0.9 * forcing * forcing;
        forcing = std::clamp(std::max(0.9 * ratio * ratio, safe > 0.1 ? safe : 0.0), 1e-6, 0.5);
      }
      previous_norm = norm;

      const Eigen::Index points = run.x().size();
      Eigen::VectorXd residual = Eigen::VectorXd::Zero(matrix.rows());
      residual.head(points) = -run.gradient().reshaped();
      Eigen::VectorXd step = Eigen::VectorXd::Zero(residual.size());
      Eigen::VectorXd z = precondition(residual), direction = z;
      double product = residual.dot(z);
      const double target = forcing * forcing * product;
      const auto most = 10 + 2 * residual.size();
      bool is_definite = true;  // as far as the directions tell
      for (Eigen::Index inner = 0; inner < most; ++inner) {
        const Eigen::VectorXd image = matrix * direction;
        const double curvature = direction.dot(image);
        if (!(curvature > 0)) {
          is_definite = false;
          if (inner == 0) step = direction;
          break;
        }
        const double length = product / curvature;
        step += length * direction;
        residual -= length * image;
        z = precondition(residual);
        const double next = residual.dot(z);
        if (!(next > target)) break;
        direction = z + (next / product) * direction;
        product = next;
        ++run.summary().linear_solves;
      }
      const Eigen::MatrixXd newton = step.head(points).reshaped(run.x().rows(), run.x().cols());
      double length = is_definite ? 1.0 : trusted_step(run, newton);
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
