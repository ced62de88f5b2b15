#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/linear/dense_cholesky.hpp>
#include <asterism/solver/method/descent.hpp>
#include <asterism/solver/method/lbfgs_pairs.hpp>
#include <asterism/solver/method/policy_name.hpp>
#include <asterism/solver/run/compiled.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Limited memory BFGS (Nocedal & Wright, section 7.2) that starts from IDA's metric.
///
/// IDA's step -K_dyn^-1 g assumes that every spring is as stiff across as it is along itself. Here the last
/// four steps and gradient changes correct that: the inverse Hessian is approximated by gamma K_dyn^-1 plus
/// their update, in the compact form of Byrd, Nocedal and Schnabel (1994). An iteration costs as much as one
/// of IDA and some products of eight vectors, and far fewer are needed. The line search accepts only lower
/// energies; if the direction or the search fails, the memory is cleared and IDA's step is taken, which can
/// fail only by rounding.
///
/// `Metric` is SingleCholesky (default), DenseCholesky, SparseCholesky or CholmodCholesky of K_dyn, or
/// JacobiMetric, its diagonal. An object holds its workspace: reuse it to solve without allocation, one
/// thread at a time.
template <typename System, typename Metric = SingleCholesky<System>>
class Lbfgs {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  AlignedOptions options;

  Lbfgs() = default;
  /// For type deduction: Lbfgs(system).solve(system, x).
  explicit Lbfgs(const System&, const AlignedOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return detail::NameWithPolicy<kMethod, Metric>::value; }

  /// Moves x (Dim x N), the start, to a stationary point of the energy. Statuses as for Ida::solve.
  Summary solve(const System& given, Points& x) { return detail::Compiled::solve(*this, given, x); }

 private:
  friend detail::Compiled;

  Summary run(const System& given, Points& x);

  static constexpr std::string_view kMethod = "L-BFGS";
  static constexpr int kMemory = 4;

  // IDA's step from the present x.
  void majorised_descent(Summary& summary) {
    descent_.setZero(System::kDim, state_.gradient().cols());
    metric_.descend(state_.gradient(), descent_);
    ++summary.linear_solves;
  }

  Session<System> session_;
  detail::DescentState<System> state_;
  Metric metric_;
  Points descent_;           // -K_dyn^-1 g
  Points previous_descent_;  // at the iterate before
  Points direction_;
  detail::LbfgsPairs<Scalar, detail::times<System::kNodes>(System::kDim),
                     detail::times<System::kMaxNodes>(System::kDim), kMemory, detail::kIsCompiled>
      pairs_;
};

template <typename System, typename Metric>
Summary Lbfgs<System, Metric>::run(const System& given, Points& x) {
  return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
    ++summary.factorizations;
    if (!metric_.factorize(system)) {
      summary.message =
          "K_dyn is not positive definite: the anchors are too weak compared with the springs for this "
          "scalar";
      return Status::NumericalFailure;
    }
    state_.start(system, x, summary);
    pairs_.clear(x.size());
    majorised_descent(summary);
    while (true) {
      const bool converged = session_.done(x, state_.gradient(), summary.iterations);
      if (converged || summary.iterations == options.max_iterations) {
        if (state_.rounds_alike()) {
          session_.adopt(x, state_.energy(), state_.gradient());
        } else {
          session_.evaluate(system, x);
        }
        return converged ? Status::Converged : Status::MaxIterations;
      }
      if (session_.stalls(x, state_.gradient(), summary.iterations)) return Status::NoProgress;

      Scalar slope = pairs_.direction(descent_, state_.gradient(), direction_);
      Scalar step = 1;
      while (!(slope < 0) || !state_.search(system, x, direction_, slope, step, summary)) {
        if (pairs_.empty()) return Status::NoProgress;
        pairs_.clear(x.size());
        direction_ = descent_;
        slope = state_.gradient().cwiseProduct(direction_).sum();
        step = 1;
      }
      previous_descent_.swap(descent_);
      majorised_descent(summary);
      ++summary.iterations;
      pairs_.add(step, direction_, slope, state_.slope(), state_.gradient(), state_.previous_gradient(),
                 descent_, previous_descent_);
    }
  });
}

ASTERISM_COMPILED_SOLVER(Lbfgs)

}  // namespace ASTERISM_ABI
}  // namespace asterism
