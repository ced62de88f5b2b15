#pragma once

// Accelerations of IDA from the literature of simulation, to compare the library's solvers with. Both are
// guarded: if their step does not lower the energy, IDA's is taken, which does.

#include <Eigen/QR>
#include <algorithm>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/linear/dense_cholesky.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <string_view>

namespace asterism::bench {

/// The common part of the guarded accelerations: energy and gradient at the iterate, IDA's step from there,
/// and the choice between a candidate and that step.
template <typename System, typename Factorization>
class GuardedIda {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  /// False if K_dyn is not positive definite.
  bool start(const System& system, const Points& x, Summary& summary) {
    ++summary.factorizations;
    if (!factorization_.factorize(system)) {
      summary.message =
          "K_dyn is not positive definite: the anchors are too weak compared with the springs for this "
          "scalar";
      return false;
    }
    energy_ = evaluate(system, x, gradient_, summary);
    return true;
  }

  const Points& gradient() const { return gradient_; }

  /// x + IDA's step from x.
  const Points& ida(const Points& x, Summary& summary) {
    ida_ = x;
    factorization_.descend(gradient_, ida_);
    ++summary.linear_solves;
    return ida_;
  }

  /// Moves x to `candidate` and returns true if that lowers the energy; else moves it to the result of the
  /// last call of ida() and returns false.
  bool step(const System& system, Points& x, const Points& candidate, Summary& summary) {
    Scalar next = evaluate(system, candidate, next_gradient_, summary);
    const bool accepted = next < energy_;
    if (accepted) {
      x = candidate;
    } else {
      x = ida_;
      next = evaluate(system, x, next_gradient_, summary);
    }
    energy_ = next;
    gradient_.swap(next_gradient_);
    ++summary.iterations;
    return accepted;
  }

 private:
  static Scalar evaluate(const System& system, const Points& x, Points& gradient, Summary& summary) {
    ++summary.energy_evaluations, ++summary.gradient_evaluations;
    return energy_and_gradient(system, x, gradient);
  }

  Factorization factorization_;
  Scalar energy_ = 0;
  Points gradient_;
  Points next_gradient_;
  Points ida_;
};

/// Anderson acceleration of IDA's fixed point iteration with a memory of five (Walker & Ni 2011), as Peng et
/// al. use it for local-global solvers (Anderson Acceleration for Geometry Optimization and Physics
/// Simulation, 2018).
template <typename System, typename Factorization = DenseCholesky<System>>
class AndersonIda {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  SolverOptions options;

  AndersonIda() = default;
  explicit AndersonIda(const System&, const SolverOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return "IDA, Anderson acceleration"; }

  /// As Ida::solve.
  Summary solve(const System& given, Points& x) {
    return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
      if (!ida_.start(system, x, summary)) return Status::NumericalFailure;
      used_ = next_ = 0;
      for (bool first = true;; first = false) {
        if (session_.done(x, ida_.gradient(), summary.iterations)) return Status::Converged;
        if (summary.iterations == options.max_iterations) return Status::MaxIterations;
        if (session_.stalls(x, ida_.gradient(), summary.iterations)) return Status::NoProgress;
        candidate_ = ida_.ida(x, summary);
        residual_ = candidate_ - x;
        if (!first) remember();
        previous_ida_ = candidate_;
        previous_residual_ = residual_;
        mix();
        ida_.step(system, x, candidate_, summary);
      }
    });
  }

 private:
  static constexpr int kMemory = 5;
  using Vector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
  using History = Eigen::Matrix<Scalar, Eigen::Dynamic, kMemory>;
  using Small = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMemory, kMemory>;

  static auto as_vector(const Points& points) {
    return Eigen::Map<const Vector>(points.data(), points.size());
  }

  void remember() {
    residual_changes_.resize(residual_.size(), kMemory);
    ida_changes_.resize(residual_.size(), kMemory);
    residual_changes_.col(next_) = as_vector(residual_) - as_vector(previous_residual_);
    ida_changes_.col(next_) = as_vector(candidate_) - as_vector(previous_ida_);
    used_ = std::max(used_, next_ + 1);
    for (int i = 0; i < used_; ++i) {
      products_(i, next_) = products_(next_, i) = residual_changes_.col(i).dot(residual_changes_.col(next_));
    }
    next_ = (next_ + 1) % kMemory;
  }

  // candidate_ = G - dG gamma with gamma that minimises |f - dF gamma|, by normal equations of scaled
  // columns.
  void mix() {
    if (used_ == 0) return;
    Eigen::Matrix<Scalar, Eigen::Dynamic, 1, Eigen::ColMajor, kMemory, 1> scale(used_), right(used_);
    for (int i = 0; i < used_; ++i) {
      scale[i] = products_(i, i) > 0 ? 1 / std::sqrt(products_(i, i)) : Scalar(0);
      right[i] = scale[i] * residual_changes_.col(i).dot(as_vector(residual_));
    }
    const Small normal = scale.asDiagonal() * products_.topLeftCorner(used_, used_) * scale.asDiagonal();
    const auto gamma = (scale.asDiagonal() * normal.completeOrthogonalDecomposition().solve(right)).eval();
    if (!gamma.allFinite()) return;
    Eigen::Map<Vector>(candidate_.data(), candidate_.size()).noalias() -=
        ida_changes_.leftCols(used_) * gamma;
  }

  Session<System> session_;
  GuardedIda<System, Factorization> ida_;
  Points candidate_;  // IDA's iterate, then the mixed one
  Points residual_;
  Points previous_ida_;
  Points previous_residual_;
  History residual_changes_;
  History ida_changes_;
  Eigen::Matrix<Scalar, kMemory, kMemory> products_ =
      Eigen::Matrix<Scalar, kMemory, kMemory>::Zero();  // dF^T dF
  int used_ = 0;
  int next_ = 0;
};

/// Chebyshev's semi-iterative method on IDA's iteration (Wang, A Chebyshev Semi-Iterative Approach for
/// Accelerating Projective and Position-based Dynamics, 2015), with an initial estimate of 0.95 for the
/// spectral radius; restarts after a step that fails.
template <typename System, typename Factorization = DenseCholesky<System>>
class ChebyshevIda {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  SolverOptions options;

  ChebyshevIda() = default;
  explicit ChebyshevIda(const System&, const SolverOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return "IDA, Chebyshev acceleration"; }

  /// As Ida::solve.
  Summary solve(const System& given, Points& x) {
    return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
      if (!ida_.start(system, x, summary)) return Status::NumericalFailure;
      constexpr Scalar kSquare = Scalar(0.95) * Scalar(0.95);
      Scalar weight = 1;
      previous_ = x;
      for (bool first = true;;) {
        if (session_.done(x, ida_.gradient(), summary.iterations)) return Status::Converged;
        if (summary.iterations == options.max_iterations) return Status::MaxIterations;
        if (session_.stalls(x, ida_.gradient(), summary.iterations)) return Status::NoProgress;
        if (!first) weight = weight == 1 ? 2 / (2 - kSquare) : 4 / (4 - kSquare * weight);
        candidate_ = weight * (ida_.ida(x, summary) - previous_) + previous_;
        previous_ = x;
        first = !ida_.step(system, x, candidate_, summary);
        if (first) weight = 1;
      }
    });
  }

 private:
  Session<System> session_;
  GuardedIda<System, Factorization> ida_;
  Points candidate_;
  Points previous_;
};

}  // namespace asterism::bench
