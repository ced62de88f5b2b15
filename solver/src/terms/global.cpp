#include <algorithm>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/split_mix.hpp>
#include <asterism/solver/base/stopwatch.hpp>
#include <asterism/solver/run/time_limit.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/solver/terms/solve.hpp>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "matrix.hpp"
#include "methods.hpp"
#include "run.hpp"
#include "stopping_rule.hpp"

// Methods around a method, and all of them by name.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

namespace {

bool is_quadratic(const System& system) {
  for (int t = 0; t < system.term_count(); ++t) {
    if (system.term(t).size() > 0 && !system.term(t).is_quadratic()) return false;
  }
  return true;
}

// Whether a third of all pairs of nodes, or more, are in an element together.
bool has_many_pairs(const System& system) {
  double pairs = 0;
  for (int t = 0; t < system.term_count(); ++t) {
    const double arity = system.term(t).arity();
    pairs += arity * (arity - 1) / 2 * system.term(t).size();
  }
  const double n = system.nodes();
  return 3 * pairs >= n * (n - 1) / 2;
}

// Whether elements that connect nodes are fewer than coordinates, and so cannot hold a shape (Maxwell 1864).
bool is_floppy(const System& system) {
  double count = 0;  // of what an element holds, its coordinates or one length, angle or area
  for (int t = 0; t < system.term_count(); ++t) {
    const Term& term = system.term(t);
    if (term.arity() > 1) count += term.is_quadratic() ? system.dim() * term.size() : term.size();
  }
  return count < static_cast<double>(system.dim()) * system.nodes();
}

bool has_thin_factor(const System& system, const Eigen::MatrixXd& x) {
  SystemMatrix matrix(SystemMatrix::Storage::Best);
  matrix.assemble(system, x, Curvature::True);
  return SystemFactor().is_thin(matrix);
}

// How strongly the nodes are held.
class Anchoring {
 public:
  Anchoring(const System& system, const Eigen::MatrixXd& x) : held_(Eigen::VectorXd::Zero(system.nodes())) {
    const Scales scales = scales_of(system, x);
    for (const Scales::Place& place : scales.places) held_[place.node] += place.stiffness;
    others_ = (scales.stiffness - held_).mean();
  }

  // Whether most nodes have less than this share of the stiffness that the other elements of a node have on
  // average.
  bool is_below(double share) const { return 2 * (held_.array() < share * others_).count() > held_.size(); }

 private:
  Eigen::VectorXd held_;
  double others_;
};

}  // namespace

Summary SystemAuto::solve(const System& system, Eigen::MatrixXd& x) const {
  if (!missing_curvature(system, Curvature::True).empty()) return SystemLbfgs{options}.solve(system, x);
  constexpr int kSmall = 64;  // unknowns
  if (x.size() <= kSmall || is_quadratic(system)) return SystemNewton{options}.solve(system, x);
  const bool is_dense = has_many_pairs(system);
  if (is_dense && missing_curvature(system, Curvature::Majorising).empty())
    return SystemLbfgs{options}.solve(system, x);
  // Also what every method refuses.
  if (is_dense || !validate(system, x, false).empty()) return SystemNewtonCg{options}.solve(system, x);
  constexpr int kFew = 1000, kMedium = 30000, kFactored = 300000;  // nodes
  constexpr double kWeak = 5e-5, kWeakForFloppy = 5e-3;
  const int n = system.nodes();
  const Anchoring anchors(system, x);
  if (n <= kMedium && ((is_floppy(system) && anchors.is_below(kWeakForFloppy)) ||
                       (anchors.is_below(kWeak) && has_thin_factor(system, x))))
    return SystemNewton{options}.solve(system, x);
  if (n <= kFew) return SystemNewtonCg{options}.solve(system, x);
  if (n > kFactored || !anchors.is_below(kWeak))
    return SystemSchwarz<SystemNewtonCg>{options}.solve(system, x);
  if (n > kMedium) return SystemSchwarz<SystemNewton>{options}.solve(system, x);
  return SystemNewtonCg{options}.solve(system, x);
}

namespace {

// Where the anchors of each node want it together, NaN for nodes without.
Eigen::MatrixXd places(const System& system, const Eigen::MatrixXd& x) {
  const Scales scales = scales_of(system, x);
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(system.dim(), system.nodes());
  Eigen::RowVectorXd weight = Eigen::RowVectorXd::Zero(system.nodes());
  for (const Scales::Place& place : scales.places) {
    if (!(place.stiffness > 0)) continue;
    sum.col(place.node) += place.stiffness * Eigen::Map<const Eigen::VectorXd>(place.position, system.dim());
    weight[place.node] += place.stiffness;
  }
  return sum.array().rowwise() / weight.array();
}

}  // namespace

Summary SystemMultiStart::solve(const System& system, Eigen::MatrixXd& x) const {
  const Stopwatch stopwatch;
  if (const char* problem = options.problem()) return refused(name(), problem);
  const Eigen::MatrixXd given = x;
  Summary best = SystemAuto{options}.solve(system, x);
  best.solver = name();
  if (best.status == Status::InvalidInput || best.status == Status::OutOfMemory ||
      best.status == Status::Interrupted)
    return best;
  const double initial = best.initial_energy, reach = options.spread * characteristic_length(system, given);
  const Eigen::MatrixXd anchored = places(system, given);
  const bool has_anchors = anchored.array().isFinite().any();
  std::vector<bool> is_held(static_cast<std::size_t>(system.nodes()));
  for (int i = 0; i < system.nodes(); ++i) is_held[static_cast<std::size_t>(i)] = system.is_fixed(i);
  if (options.hold_floating) {
    for (const int i : floating_nodes(system)) is_held[static_cast<std::size_t>(i)] = true;
  }
  SplitMix64 random(options.seed), first_random(~options.seed);
  for (int start = 1; start < options.starts && !(options.gap > 0 && best.is_within(options.gap)); ++start) {
    // The anchors as they are first; without any, not the given x once more.
    const bool is_displaced = start > 1 || !has_anchors;
    SplitMix64& displacement = start > 1 ? random : first_random;
    Eigen::MatrixXd trial = given;
    for (int i = 0; i < system.nodes(); ++i) {
      if (start % 2 == 1 && is_finite(anchored(0, i))) trial.col(i) = anchored.col(i);
      for (int d = 0; is_displaced && d < system.dim(); ++d) trial(d, i) += reach * displacement.symmetric();
      if (is_held[static_cast<std::size_t>(i)]) trial.col(i) = given.col(i);
    }
    Summary found = SystemAuto{options}.solve(system, trial);
    const bool is_interrupted = found.status == Status::Interrupted;
    if (found.usable() && (!best.usable() || found.final_energy < best.final_energy)) {
      x = trial;
      std::swap(found, best);
    }
    best.add_work(found);
    best.lower_bound = std::max(best.lower_bound, found.lower_bound);
    if (is_interrupted) {
      best.status = Status::Interrupted;
      best.message = "stopped on request: not all starts were tried";
      break;
    }
  }
  best.solver = name();
  best.initial_energy = initial;
  best.seconds = stopwatch.seconds();
  return best;
}

namespace {

bool is_graduable(const Term& term) {
  for (const Choice& choice : term.choices()) {
    if (choice.name != "loss" || term.size() == 0) continue;
    const auto loss = static_cast<Loss>(choice.value);
    return loss == Loss::GemanMcClure || loss == Loss::Truncated;
  }
  return false;
}

// The system's losses, nearer to convex ones by mu: GemanMcClure with mu times the square of its scale,
// Truncated with 1 / mu times its sharpness.
System relaxed(const System& system, double mu) {
  System result = system;
  for (int t = 0; t < result.term_count(); ++t) {
    Term& term = result.term(t);
    if (!is_graduable(term)) continue;
    if (term.chosen("loss") == "geman-mcclure") {
      term.values("scale") *= std::sqrt(mu);
    } else {
      term.values("sharpness") /= mu;
    }
  }
  return result;
}

System without_losses(const System& system) {
  System result = system;
  for (int t = 0; t < result.term_count(); ++t) {
    if (is_graduable(result.term(t))) result.term(t).choose("loss", "quadratic");
  }
  return result;
}

}  // namespace

Summary SystemGraduated::solve(const System& system, Eigen::MatrixXd& x) const {
  const Stopwatch stopwatch;
  if (const char* problem = options.problem()) return refused(name(), problem);
  if (const std::string problem = validate(system, x, !options.hold_floating); !problem.empty())
    return refused(name(), std::string_view(problem));
  double least_scale = 0, most_sharpness = 1;
  for (int t = 0; t < system.term_count(); ++t) {
    const Term& term = system.term(t);
    if (!is_graduable(term) || term.values("scale").size() == 0) continue;
    const double scale = term.values("scale").minCoeff();
    least_scale = least_scale > 0 ? std::min(least_scale, scale) : scale;
    if (term.values("sharpness").size() > 0)
      most_sharpness = std::max(most_sharpness, term.values("sharpness").maxCoeff());
  }
  if (!(least_scale > 0)) {
    Summary result = SystemAuto{options}.solve(system, x);
    result.solver = name();
    return result;
  }
  const Eigen::MatrixXd given = x;
  Summary result = SystemAuto{options}.solve(without_losses(system), x);
  const double initial = energy(system, given);
  // No residual is longer than the energy of the springs alone allows by much: start where all are convex.
  double mu = 1;
  if (result.usable()) {
    const double extent = (x.rowwise().maxCoeff() - x.rowwise().minCoeff()).norm() +
                          characteristic_length(system, x) + (x - given).colwise().norm().maxCoeff();
    const double ratio = extent / least_scale;
    mu = std::clamp(3 * ratio * ratio * most_sharpness, 1.0, 1e12);
  }
  bool is_last = false;
  while (result.usable() && result.status != Status::Interrupted && !is_last) {
    is_last = mu == 1;
    Summary done = SystemAuto{options}.solve(is_last ? system : relaxed(system, mu), x);
    std::swap(done, result);
    result.add_work(done);
    mu = std::max(1.0, mu / options.factor);
  }
  // From the start as it was, also where the changed parameters leave the range of a double.
  if (!(is_last && result.usable() && result.final_energy <= initial)) {
    const bool is_stopped = result.status == Status::Interrupted;
    x = given;
    AlignedOptions alone = options;
    if (is_stopped) alone.max_iterations = 0;
    Summary done = SystemAuto{alone}.solve(system, x);
    std::swap(done, result);
    result.add_work(done);
    if (is_stopped) {
      result.status = Status::Interrupted;
      result.message = "stopped on request before the last solve: x is as it was";
    }
  }
  if (result.usable()) result.initial_energy = initial;
  result.solver = name();
  result.seconds = stopwatch.seconds();
  return result;
}

}  // namespace detail

SolverRegistry<System> system_solvers() {
  SolverRegistry<System> registry;
  registry.set_elsewhere(method_elsewhere);
  registry.add<detail::SystemAuto>("auto");
  registry.add<detail::SystemNewton>("newton");
  registry.add<detail::SystemNewtonCg>("newton-cg");
  registry.add<detail::SystemLbfgs>("lbfgs");
  registry.add<detail::SystemCg>("ncg");
  registry.add<detail::SystemIda>("ida");
  registry.add<detail::SystemSchwarz<detail::SystemNewtonCg>>("schwarz");
  registry.add<detail::SystemSchwarz<detail::SystemNewton>>("schwarz-direct");
  registry.add<detail::SystemMultiStart>("multi-start");
  registry.add<detail::SystemStaircase>("staircase");
  registry.add<detail::SystemGraduated>("graduated");
  return registry;
}

std::vector<std::string_view> system_methods() {
  return {"auto",    "newton",         "newton-cg",   "lbfgs",     "ncg",      "ida",
          "schwarz", "schwarz-direct", "multi-start", "staircase", "graduated"};
}

Summary solve(const System& system, Eigen::MatrixXd& x, const AlignedOptions& options) {
  return detail::SystemAuto{options}.solve(system, x);
}

Summary solve(std::string_view method, const System& system, Eigen::MatrixXd& x,
              const AlignedOptions& options) {
  AnySolver<System> solver = system_solvers().make(method);
  static_cast<AlignedOptions&>(solver.options()) = options;
  return solver.solve(system, x);
}

namespace {

bool has_loads(const System& system) {
  for (int t = 0; t < system.term_count(); ++t) {
    if (system.term(t).kind() == "loads" && system.term(t).size() > 0) return true;
  }
  return false;
}

}  // namespace

Summary solve_global(const System& system, Eigen::MatrixXd& x, const GlobalOptions& options) {
  const bool is_liftable = detail::why_not_liftable(system).empty();
  detail::SystemMultiStart starts;
  detail::SystemStaircase staircase;
  if (const char* problem = options.problem())
    return detail::refused(is_liftable ? staircase.name() : starts.name(), problem);
  const detail::TimeLimit time(options.max_seconds, options);
  const auto solve_by = [&](auto& solver) {
    static_cast<AlignedOptions&>(solver.options) = options;
    if (has_loads(system)) solver.options.gap = 0;  // the energy may be negative, and has no share
    solver.options.on_iteration = time.observed();
    Summary summary = solver.solve(system, x);
    time.explain(summary);
    return summary;
  };
  staircase.options.on_lifted_iteration = time.hidden();
  return is_liftable ? solve_by(staircase) : solve_by(starts);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
