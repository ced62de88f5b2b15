#pragma once

#include <lbfgs.h>

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <memory>
#include <new>
#include <string_view>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace reference {

/// liblbfgs as a reference for the library's own solvers: L-BFGS with its own memory of six, and
/// More and Thuente's line search, as liblbfgs sets them, in double. Its own tolerances are off: it is
/// stopped by the same rule as every other solver, and its verdict is recomputed. liblbfgs's message is in
/// the summary. Needs target asterism::lbfgs.
template <typename System>
class Liblbfgs {
  static_assert(std::is_same_v<typename System::Scalar, double> && std::is_same_v<lbfgsfloatval_t, double>,
                "liblbfgs works in double");

 public:
  using Points = typename System::Points;

  SolverOptions options;

  Liblbfgs() = default;
  /// For type deduction: Liblbfgs(system).solve(system, x).
  explicit Liblbfgs(const System&, const SolverOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return "liblbfgs"; }

  /// Moves x (Dim x N), the start, to a stationary point of the energy. Statuses other than Converged:
  /// MaxIterations, InvalidInput, NumericalFailure (overflow), OutOfMemory, and NoProgress if liblbfgs
  /// gives up.
  Summary solve(const System& given, Points& x) {
    if constexpr (System::kMaxNodes == Eigen::Dynamic) {
      if (!session_.fits(given)) {  // see asterism::detail::Compiled
        session_ = {};
        trial_ = gradient_ = Points();
      }
    }
    return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
      if (session_.done(x, session_.gradient(), 0)) return Status::Converged;
      if (options.max_iterations == 0) return Status::MaxIterations;  // to liblbfgs it is no limit

      // The first step is one unit long and others are bounded by thresholds in such units, so the system
      // is given unit size. Powers of two, for the scaling to be exact.
      Run run{*this, system, summary, power_of_two(session_.length()),
              power_of_two(session_.node_stiffness().maxCoeff())};
      gradient_ = trial_ = x;  // allocates here, as nothing may throw through C
      const std::unique_ptr<double, void (*)(double*)> nodes(lbfgs_malloc(static_cast<int>(x.size())),
                                                             lbfgs_free);
      if (nodes == nullptr) asterism::detail::raise(std::bad_alloc());
      Eigen::Map<Points>(nodes.get(), x.rows(), x.cols()) = x / run.length;

      lbfgs_parameter_t parameters;
      lbfgs_parameter_init(&parameters);
      parameters.epsilon = 0;
      parameters.max_iterations = options.max_iterations;
      const int code =
          lbfgs(static_cast<int>(x.size()), nodes.get(), nullptr, evaluate, progress, &run, &parameters);
      if (code == LBFGSERR_OUTOFMEMORY) asterism::detail::raise(std::bad_alloc());

      x = run.length * Eigen::Map<const Points>(nodes.get(), x.rows(), x.cols());
      summary.message = words(code);
      summary.message.append(" (").append(code).append(")");
      if (code >= 0) return Status::Converged;
      return code == LBFGSERR_MAXIMUMITERATION ? Status::MaxIterations : Status::NoProgress;
    });
  }

 private:
  struct Run {
    Liblbfgs& self;
    const System& system;
    Summary& summary;
    double length;     // unit of length
    double stiffness;  // unit of stiffness
  };

  static double power_of_two(double value) { return value > 0 ? std::ldexp(1.0, std::ilogb(value)) : 1.0; }

  static double evaluate(void* instance, const double* nodes, double* gradient, int, double) {
    const Run& run = *static_cast<const Run*>(instance);
    Points& x = run.self.trial_;
    Points& g = run.self.gradient_;
    x = run.length * Eigen::Map<const Points>(nodes, x.rows(), x.cols());
    const double energy = energy_and_gradient(run.system, x, g);
    ++run.summary.energy_evaluations, ++run.summary.gradient_evaluations;
    Eigen::Map<Points>(gradient, g.rows(), g.cols()) = g / (run.stiffness * run.length);
    return energy / (run.stiffness * run.length * run.length);
  }

  // After each iteration: not 0 stops.
  static int progress(void* instance, const double* nodes, const double* gradient, double, double, double,
                      double, int, int, int) {
    const Run& run = *static_cast<const Run*>(instance);
    Points& x = run.self.trial_;
    Points& g = run.self.gradient_;
    ++run.summary.iterations;
    x = run.length * Eigen::Map<const Points>(nodes, x.rows(), x.cols());
    g = (run.stiffness * run.length) * Eigen::Map<const Points>(gradient, g.rows(), g.cols());
    return run.self.session_.done(x, g, run.summary.iterations) ? LBFGS_STOP : 0;
  }

  // liblbfgs has no texts for its codes but those of its header.
  static constexpr std::string_view words(int code) {
    switch (code) {
      case LBFGS_SUCCESS:
        return "LBFGS_SUCCESS";
      case LBFGS_STOP:
        return "LBFGS_STOP";
      case LBFGS_ALREADY_MINIMIZED:
        return "LBFGS_ALREADY_MINIMIZED: the initial variables already minimize the objective function";
      case LBFGSERR_INVALID_N:
        return "LBFGSERR_INVALID_N: invalid number of variables";
      case LBFGSERR_OUTOFINTERVAL:
        return "LBFGSERR_OUTOFINTERVAL: the line-search step went out of the interval of uncertainty";
      case LBFGSERR_INCORRECT_TMINMAX:
        return "LBFGSERR_INCORRECT_TMINMAX: a logic error, or the interval of uncertainty became too small";
      case LBFGSERR_ROUNDING_ERROR:
        return "LBFGSERR_ROUNDING_ERROR: a rounding error, or no line-search step satisfies the conditions";
      case LBFGSERR_MINIMUMSTEP:
        return "LBFGSERR_MINIMUMSTEP: the line-search step became smaller than min_step";
      case LBFGSERR_MAXIMUMSTEP:
        return "LBFGSERR_MAXIMUMSTEP: the line-search step became larger than max_step";
      case LBFGSERR_MAXIMUMLINESEARCH:
        return "LBFGSERR_MAXIMUMLINESEARCH: the line search reaches the maximum number of evaluations";
      case LBFGSERR_MAXIMUMITERATION:
        return "LBFGSERR_MAXIMUMITERATION: the maximum number of iterations";
      case LBFGSERR_WIDTHTOOSMALL:
        return "LBFGSERR_WIDTHTOOSMALL: relative width of the interval of uncertainty is at most xtol";
      case LBFGSERR_INVALIDPARAMETERS:
        return "LBFGSERR_INVALIDPARAMETERS: a logic error (negative line-search step)";
      case LBFGSERR_INCREASEGRADIENT:
        return "LBFGSERR_INCREASEGRADIENT: the search direction increases the objective function value";
    }
    return "liblbfgs's error";
  }

  Session<System> session_;
  Points trial_;
  Points gradient_;
};

/// Adds "liblbfgs".
template <typename System>
void add_liblbfgs(SolverRegistry<System>& registry) {
  registry.template add<Liblbfgs<System>>("liblbfgs");
}

}  // namespace reference
}  // namespace ASTERISM_ABI
}  // namespace asterism
