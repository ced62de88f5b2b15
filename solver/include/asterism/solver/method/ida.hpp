#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/linear/dense_cholesky.hpp>
#include <asterism/solver/run/compiled.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The iterative direct approach, the paper's Algorithm 1.
///
/// The spring system is split into one 1-D system for each dimension; their matrix K_dyn is the same, so it
/// is factored once per solve, and one linear solve per iteration serves all dimensions. Each iteration
/// minimises a quadratic that touches the energy at x and lies above it elsewhere, so that, up to rounding of
/// x and E, the energy never rises (a majorisation, like SMACOF). Convergence is linear: fast at first, slow
/// at the end if anchors are weak compared with the springs.
///
/// The static nodes (paper's x_stat) are the anchors, the dynamic nodes x. With springs ordered as anchors,
/// then links, and B, K of Eqs. 13-14, K_hat = B^T K B (Eq. 16) has the upper blocks (Eq. 17)
///   K_dyn = diag(k_i) + Laplacian(k_ij)      K_stat = -diag(k_i)
/// and with L the current spring vectors of nominal length (0 for anchors, mu_ij u_ij for links), Eq. 18
/// gives
///   C_dyn L = sum over the links at a node of k_ij mu_ij u_ij.
/// Eq. 19 is used in its gradient form: as K_dyn x + K_stat x_stat - C_dyn L is the gradient, Eq. 19's
///   x_dyn = K_dyn^-1 (C_dyn L - K_stat x_stat)  is  x_dyn <- x_dyn - K_dyn^-1 gradient.
/// The iterates are the same; this form gives the stopping rule its gradient at no cost, and corrects the
/// rounding of the factorisation from one iteration to the next.
///
/// If linked nodes coincide, u_ij is as for energy_and_gradient, so the nodes separate. A start with all
/// nodes and anchors on one line stays on it, even if its stationary point is a saddle.
///
/// `Factorization` is DenseCholesky (default), SparseCholesky (SparseIda) or, from
/// <asterism/solver/method/cholmod.hpp>, CholmodCholesky; with these two, E may rise if K_dyn is singular up
/// to rounding. An object holds its workspace: reuse it to solve without allocation, one thread at a time.
template <typename System, typename Factorization = DenseCholesky<System>>
class Ida {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  IdaOptions options;

  Ida() = default;
  /// For type deduction: Ida(system).solve(system, x).
  explicit Ida(const System&, const IdaOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return Factorization::kIdaName; }

  /// Moves x (Dim x N), the start, to a stationary point of the energy. Statuses other than Converged:
  /// MaxIterations, InvalidInput, NumericalFailure (K_dyn is not positive definite to the digits of Scalar),
  /// OutOfMemory, and NoProgress if rounding stops the iteration first.
  Summary solve(const System& given, Points& x) { return detail::Compiled::solve(*this, given, x); }

 private:
  friend detail::Compiled;

  Summary run(const System& given, Points& x);

  Session<System> session_;
  Factorization factorization_;
  Points gradient_;
};

template <typename System, typename Factorization>
Summary Ida<System, Factorization>::run(const System& given, Points& x) {
  return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
    summary.factorizations = 1;
    if (!factorization_.factorize(system)) {  // Algorithm 1, line 1
      summary.message =
          "K_dyn is not positive definite: the anchors are too weak compared with the springs for this "
          "scalar";
      return Status::NumericalFailure;
    }
    while (true) {
      // Lines 4-5: the spring vectors at x, and with them minus the forces at the dynamic nodes, Eq. 15.
      detail::evaluate<false>(system, x, gradient_);
      ++summary.gradient_evaluations;
      if (session_.done(x, gradient_, summary.iterations)) return Status::Converged;
      if (summary.iterations == options.max_iterations) return Status::MaxIterations;
      if (session_.stalls(x, gradient_, summary.iterations)) return Status::NoProgress;
      if (options.relaxation != 1) gradient_ *= static_cast<Scalar>(options.relaxation);
      factorization_.descend(gradient_, x);  // lines 6-7: Eq. 19
      ++summary.linear_solves;
      ++summary.iterations;
    }
  });
}

/// One IDA solve with a workspace of its own; see Ida::solve. For repeated solves, keep an Ida.
template <typename System>
Summary solve_ida(const System& system, typename System::Points& x, const IdaOptions& options = {}) {
  return Ida<System>(system, options).solve(system, x);
}

ASTERISM_COMPILED_SOLVER(Ida)
ASTERISM_COMPILED_SOLVE(solve_ida, IdaOptions)

}  // namespace ASTERISM_ABI
}  // namespace asterism
