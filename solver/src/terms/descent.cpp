#include <algorithm>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/linear/vector_kernels.hpp>
#include <cmath>
#include <limits>
#include <optional>

#include "lbfgs.hpp"
#include "matrix.hpp"
#include "methods.hpp"
#include "run.hpp"

// Methods that need the gradient alone, and a matrix that stays as it is: IDA, L-BFGS and nonlinear CG.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

namespace {

// -A^-1 v for the nodes' stiffness A.
void scale(const SystemRun& run, const Eigen::MatrixXd& v, Eigen::MatrixXd& result) {
  result.noalias() = v * (-run.rule().node_stiffness().cwiseInverse()).asDiagonal();
}

// Links between all pairs of nodes, or so many of them and of so like stiffness that (sum k)^2 / sum k^2, the
// number of equally stiff links that are as uneven, is a third of all pairs.
class EvenLinks {
 public:
  // Whether nothing but such links connects the nodes, enough of them for a factorisation to be expensive.
  static bool are_all(const System& system) {
    constexpr int kFew = 64;  // nodes
    double sum = 0, squares = 0;
    for (int t = 0; t < system.term_count(); ++t) {
      const Term& term = system.term(t);
      if (term.size() == 0 || term.arity() == 1) continue;
      if (dynamic_cast<const Links*>(&term) == nullptr || term.values("information").size() > 0) return false;
      const Eigen::MatrixXd& k = term.values("stiffness");
      const double copies = k.cols() == term.size() ? 1 : term.size();
      sum += copies * k.sum();
      squares += copies * k.squaredNorm();
    }
    const double n = system.nodes();
    return n > kFew && is_finite(sum * sum) && 3 * sum * sum >= squares * n * (n - 1) / 2;
  }

  // With the stiffness D of each node, d of it from links.
  EvenLinks(const System& system, const Eigen::VectorXd& node_stiffness)
      : inverse_(node_stiffness.cwiseInverse()), ratio_(Eigen::VectorXd::Zero(system.nodes())) {
    for (int t = 0; t < system.term_count(); ++t) {
      const Term& term = system.term(t);
      if (term.size() == 0 || term.arity() == 1) continue;
      const Eigen::MatrixXd& k = term.values("stiffness");
      for (int e = 0; e < term.size(); ++e) {
        for (const int node : term.nodes().col(e)) ratio_[node] += k(0, k.cols() == 1 ? 0 : e);
      }
    }
    double total = ratio_.sum(), held = 0;  // held: sum d - sum of d^2 / D over the nodes that are not fixed
    share_ = ratio_;
    for (int i = 0; i < system.nodes(); ++i) {
      const double d = ratio_[i];
      ratio_[i] = system.is_fixed(i) ? 0 : d * inverse_[i];
      held += d * (1 - ratio_[i]);
    }
    share_ *= held > 1e-14 * total ? 1 / held : 0.0;
  }

  // -(D - d d^T / sum d)^-1 v (Sherman and Morrison 1950), 0 for fixed nodes, as v is.
  void descend(const Eigen::MatrixXd& v, Eigen::MatrixXd& result) const {
    result.noalias() = v * (-inverse_).asDiagonal();
    const Eigen::VectorXd together = result * share_;
    result.noalias() += together * ratio_.transpose();
  }

 private:
  Eigen::VectorXd inverse_, ratio_, share_;
};

// Solves with IDA's factored matrix. That of few nodes is inverted: a product is faster than two
// substitutions, each of whose steps waits for the one before. An inverse may be off by eps cond(K) of
// itself: a step of IDA then no longer lowers the energy, and other methods have a metric of no use. So it
// serves only where half of the digits are left; the trace is no less than the largest eigenvalue of the
// inverse of K scaled to a diagonal of 1.
class SharedSteps {
 public:
  // False where the matrix is not positive definite.
  bool factorize(const SystemMatrix& matrix) {
    has_inverse_ = invert(matrix);
    return has_inverse_ || factor_.factorize(matrix);
  }

  // result <- -K^-1 v.
  void descend(const Eigen::MatrixXd& v, Eigen::MatrixXd& result) const {
    if (!has_inverse_) {
      result = -factor_.solve(v);
      return;
    }
    const int n = static_cast<int>(inverse_.cols()), dim = static_cast<int>(v.rows());
    if (dim > 3) {
      result = -v.lazyProduct(inverse_.topRows(n));
      return;
    }
    result.setZero(dim, n);
    lanes_v0_1::subtract({inverse_.data(), inverse_.rows(), n, dim, v.data(), result.data()});
  }

 private:
  bool invert(const SystemMatrix& matrix) {
    constexpr double kHalfOfDigits = 1.5e-8;
    const int n = matrix.rows();
    if (!matrix.is_shared() || !matrix.is_dense() || n > lanes_v0_1::kMostInverted) return false;
    const Eigen::VectorXd diagonal = matrix.dense().diagonal();
    inverse_.setZero(lanes_v0_1::aligned_rows(n), n);
    inverse_.topRows(n) = matrix.dense().selfadjointView<Eigen::Lower>();
    return lanes_v0_1::invert({inverse_.data(), inverse_.rows(), n, kPivotRounding, diagonal.data()}) &&
           kHalfOfDigits * diagonal.dot(inverse_.diagonal()) < 1;
  }

  SystemFactor factor_;
  Eigen::MatrixXd inverse_;  // below its rows, zeros
  bool has_inverse_ = false;
};

// The inverse of IDA's matrix, or of what stands for it: where links are even, of that of links between all
// pairs whose stiffness is d_i d_j / sum d, which is IDA's if all are the same, and needs no factorisation.
class Metric {
 public:
  explicit Metric(SystemRun& run) : run_(run) {
    const System& system = run.system();
    if (!missing_curvature(system, Curvature::True).empty()) return;
    const bool is_majoriser = missing_curvature(system, Curvature::Majorising).empty();
    if (is_majoriser && EvenLinks::are_all(system)) {
      even_.emplace(system, run.rule().node_stiffness());
      return;
    }
    SystemMatrix matrix(SystemMatrix::Storage::Best);
    matrix.assemble(system, run.x(), is_majoriser ? Curvature::Majorising : Curvature::Clamped);
    if (!is_majoriser) matrix.shift(run.rule().node_stiffness(), kShare);
    ++run.summary().factorizations;
    is_factored_ = steps_.factorize(matrix);
  }

  // result <- -M^-1 gradient.
  void descend(const Eigen::MatrixXd& gradient, Eigen::MatrixXd& result) const {
    if (even_) return even_->descend(gradient, result);
    if (!is_factored_) return scale(run_, gradient, result);
    ++run_.summary().linear_solves;
    steps_.descend(gradient, result);
  }

 private:
  static constexpr double kShare = 1e-3;

  SystemRun& run_;
  std::optional<EvenLinks> even_;
  SharedSteps steps_;
  bool is_factored_ = false;
};

double dot(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) { return a.cwiseProduct(b).sum(); }

}  // namespace

Summary SystemIda::solve(const System& system, Eigen::MatrixXd& x) const {
  if (const char* problem = options.problem()) return refused(name(), problem);
  const double relaxation = options.relaxation;
  return SystemRun::solve(name(), options, system, x, [relaxation](SystemRun& run) {
    if (const std::string missing = missing_curvature(run.system(), Curvature::Majorising);
        !missing.empty()) {
      run.summary().message = std::string_view("the method needs a majoriser: " + missing);
      return Status::InvalidInput;
    }
    SystemMatrix matrix(SystemMatrix::Storage::Best);
    SharedSteps steps;
    matrix.assemble(run.system(), run.x(), Curvature::Majorising);
    ++run.summary().factorizations;
    if (!steps.factorize(matrix)) {
      run.summary().message =
          "K_dyn is not positive definite: the anchors are too weak compared with the springs";
      return Status::NumericalFailure;
    }
    Eigen::MatrixXd step;
    while (!run.is_over()) {
      steps.descend(run.gradient(), step);
      ++run.summary().linear_solves;
      run.move_by(relaxation, step);  // Eq. 19
      ++run.summary().iterations;
    }
    return run.end();
  });
}

Summary SystemLbfgs::solve(const System& system, Eigen::MatrixXd& x) const {
  return SystemRun::solve(name(), options, system, x, [](SystemRun& run) {
    const Metric metric(run);
    LbfgsSteps steps(
        run, [&metric](const Eigen::MatrixXd& v, Eigen::MatrixXd& result) { metric.descend(v, result); });
    while (!run.is_over()) {
      if (!steps.advance()) return Status::NoProgress;
      ++run.summary().iterations;
    }
    return run.end();
  });
}

Summary SystemCg::solve(const System& system, Eigen::MatrixXd& x) const {
  return SystemRun::solve(name(), options, system, x, [](SystemRun& run) {
    Eigen::MatrixXd descent, next;
    scale(run, run.gradient(), descent);
    Eigen::MatrixXd direction = descent;
    double step = 1, slope = dot(run.gradient(), direction);
    bool is_restart = true;
    while (!run.is_over()) {
      if (!run.search(direction, step)) {
        if (is_restart) return Status::NoProgress;
        is_restart = true;
        direction = descent;
        slope = dot(run.gradient(), direction);
        step = 1;
        continue;
      }
      ++run.summary().iterations;
      scale(run, run.gradient(), next);
      // max(0, g_new A^-1 (g_new - g) / g A^-1 g)
      const double beta =
          std::max(0.0, dot(run.gradient(), next - descent) / dot(run.previous_gradient(), descent));
      descent.swap(next);
      direction = descent + beta * direction;
      const double previous_slope = slope;
      slope = dot(run.gradient(), direction);
      is_restart = !(slope < 0);
      if (is_restart) {
        direction = descent;
        slope = dot(run.gradient(), direction);
      }
      step = std::min(2 * step * previous_slope / slope, 10.0);  // twice the first-order decrease before
      if (!(step > 0) || !is_finite(step)) step = 1;
    }
    return run.end();
  });
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
