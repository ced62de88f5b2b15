// NLopt's local optimisers that use gradients.
#include <nlopt.h>

#include <memory>
#include <new>
#include <vector>

#include "objective.hpp"

namespace asterism::bench {
namespace {

struct Run {
  Objective& objective;
  nlopt_opt optimizer;
};

double evaluate(unsigned, const double* x, double* gradient, void* data) {
  const Run& run = *static_cast<Run*>(data);
  const double energy = run.objective(x, gradient);
  if (run.objective.iterated()) nlopt_force_stop(run.optimizer);
  return energy;
}

constexpr const char* title(nlopt_algorithm algorithm) {
  switch (algorithm) {
    case NLOPT_LD_LBFGS:
      return "NLopt, L-BFGS (its iterations are evaluations)";
    case NLOPT_LD_TNEWTON_PRECOND_RESTART:
      return "NLopt, truncated Newton (its iterations are evaluations)";
    default:
      return "NLopt, SLSQP (its iterations are evaluations)";
  }
}

template <nlopt_algorithm kAlgorithm>
struct Nlopt {
  static constexpr std::string_view name() { return title(kAlgorithm); }

  // NLopt counts evaluations alone.
  static Status minimise(Objective& objective, const Points& start, int max_iterations, Summary& summary) {
    const auto size = static_cast<unsigned>(objective.size());
    const std::unique_ptr<nlopt_opt_s, void (*)(nlopt_opt)> optimizer(nlopt_create(kAlgorithm, size),
                                                                      nlopt_destroy);
    if (optimizer == nullptr) throw std::bad_alloc();
    Run run{objective, optimizer.get()};
    std::vector<double> x(size);
    objective.write(start, x.data());
    nlopt_set_min_objective(optimizer.get(), evaluate, &run);
    nlopt_set_maxeval(optimizer.get(), max_iterations);
    double lowest = 0;
    const nlopt_result result = nlopt_optimize(optimizer.get(), x.data(), &lowest);
    summary.iterations = nlopt_get_numevals(optimizer.get());
    summary.message.assign(nlopt_result_to_string(result));
    return result == NLOPT_MAXEVAL_REACHED ? Status::MaxIterations : Status::NoProgress;
  }
};

template <nlopt_algorithm kAlgorithm>
SolverEntry entry(const std::string& name, int nodes) {
  using Solver = PeerSolver<Nlopt<kAlgorithm>>;
  int major = 0, minor = 0, bugfix = 0;
  nlopt_version(&major, &minor, &bugfix);
  return {name, std::string(Solver::name()), format("NLopt %d.%d.%d", major, minor, bugfix), nodes,
          0,    make_runner<Solver>};
}

const Registration kLbfgs(entry<NLOPT_LD_LBFGS>("nlopt-lbfgs", 1000));
const Registration kTruncatedNewton(entry<NLOPT_LD_TNEWTON_PRECOND_RESTART>("nlopt-tnewton", 1000));
const Registration kSlsqp(entry<NLOPT_LD_SLSQP>("nlopt-slsqp", 36));

}  // namespace
}  // namespace asterism::bench
