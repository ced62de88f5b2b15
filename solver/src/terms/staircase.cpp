#include <Eigen/Eigenvalues>
#include <algorithm>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/stopwatch.hpp>
#include <asterism/solver/terms/solution.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "matrix.hpp"
#include "methods.hpp"
#include "prover.hpp"
#include "run.hpp"
#include "stopping_rule.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

std::string why_not_liftable(const System& system) {
  for (int t = 0; t < system.term_count(); ++t) {
    const Term& term = system.term(t);
    if (term.size() == 0) continue;
    if (const char* why = term.why_not_liftable()) return std::string(term.kind()) + ": " + why;
  }
  if (system.dim() + kMostLifts > System::kMaxDim)
    return "a system of more than " + std::to_string(System::kMaxDim - kMostLifts) +
           " coordinates has no room for more";
  return missing_curvature(system, Curvature::True);
}

namespace {

System lifted(const System& system, int dim) {
  System result(system.nodes(), dim);
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) result.fix(i);
  }
  for (int t = 0; t < system.term_count(); ++t) {
    if (system.term(t).size() > 0) result.add(system.term(t).lifted(dim));
  }
  return result;
}

// W: the second derivatives by the last coordinate of all nodes, at points where it is 0. It is coupled to no
// other coordinate there.
class LastCoordinate final : public CurvatureSink {
 public:
  LastCoordinate(const System& system, const Eigen::MatrixXd& x)
      : system_(system), w_(Eigen::MatrixXd::Zero(system.nodes(), system.nodes())) {
    for (int t = 0; t < system.term_count(); ++t) system.term(t).add_curvature(x, Curvature::True, *this);
  }

  void add(const int* nodes, int count, const double* matrix, int rows) override {
    const int dim = system_.dim();
    int row = 0;
    for (int a = 0; a < count; row += nodes[a] < 0 ? 1 : dim, ++a) {
      int column = 0;
      for (int b = 0; b < count; column += nodes[b] < 0 ? 1 : dim, ++b)
        add(nodes[a], nodes[b], matrix[(column + dim - 1) * rows + row + dim - 1]);
    }
  }
  void add_blocks(const int* nodes, int arity, int count, const double* c, const double* B,
                  int dim) override {
    const std::ptrdiff_t entries = std::ptrdiff_t{dim} * dim;
    for (; count > 0; --count, nodes += arity, B += entries) {
      for (int a = 0; a < arity; ++a) {
        for (int b = 0; b < arity; ++b) add(nodes[a], nodes[b], c[a] * c[b] * B[entries - 1]);
      }
    }
  }

  // The direction in which W is most negative, one number for each node, and v^T W v; 0 where there is none
  // that rounding may not have made.
  double negative_direction(Eigen::VectorXd& v) const {
    if (!all_finite(w_) || w_.size() == 0) return 0;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(w_);
    v = eigen.eigenvectors().col(0);
    const double rounding = 64 * std::numeric_limits<double>::epsilon() * w_.diagonal().cwiseAbs().maxCoeff();
    return std::min(eigen.eigenvalues()[0] + rounding, 0.0);
  }

 private:
  void add(int a, int b, double value) {
    if (a >= 0 && b >= 0 && !system_.is_fixed(a) && !system_.is_fixed(b)) w_(a, b) += value;
  }

  const System& system_;
  Eigen::MatrixXd w_;
};

// The highest lower bound of the energy by quadratics that touch it near x, and not at x: at a minimum in
// more dimensions than it needs, the one that touches it at x is constant along a line. x is moved in the
// coordinates from `from` on, in which nothing is at rest elsewhere, so that no link becomes shorter; and in
// all coordinates away from the centroid, so that most links become longer. With a small share of it the
// quadratic has no minimum or a very low one, with a large one it is far below the energy: the best is
// searched for by ever smaller factors.
double bound_near(const System& system, const Eigen::MatrixXd& x, int from) {
  if (!missing_curvature(system, Curvature::Minorising).empty()) return 0;
  SystemProver prover(system);
  Eigen::MatrixXd last = x, all = x.colwise() - x.rowwise().mean();
  last.topRows(from).setZero();
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) all.col(i).setZero();
  }
  constexpr double kFactor = 10, kNear = 1e-3;
  constexpr int kRefinements = 3;
  double highest = 0;
  const double nearly_all = (1 - kNear) * energy(system, x);
  for (const Eigen::MatrixXd* out : {&last, &all}) {
    if (!(out->array() != 0).any() || highest > nearly_all) continue;
    double best = 0, best_share = 0;
    bool has_minimum = false;
    const auto is_better = [&](double share) {
      const Certificate certificate = prover.certify(x + share * *out, 0);
      has_minimum = is_finite(certificate.distance);
      if (!has_minimum || !(certificate.lower_bound > best)) return false;
      best = certificate.lower_bound;
      best_share = share;
      return true;
    };
    for (double share = 1e-9; share <= 1; share *= kFactor) {
      if (!is_better(share) && has_minimum && best > 0) break;
    }
    double factor = kFactor;
    for (int refinement = 0; refinement < kRefinements && best > 0; ++refinement) {
      factor = std::sqrt(factor);
      if (!is_better(best_share / factor)) is_better(best_share * factor);
    }
    highest = std::max(highest, best);
  }
  return highest;
}

// Newton's method with a share of the nodes' stiffness added to the Hessian, as much as it needs (Levenberg
// 1944): near a minimum in more dimensions, the Hessian is nearly singular, or has slightly negative
// eigenvalues until the last of these dimensions is found.
struct DampedNewton {
  AlignedOptions options;

  Summary solve(const System& system, Eigen::MatrixXd& x) const {
    return SystemRun::solve("damped Newton", options, system, x, iterate);
  }

 private:
  static Status iterate(SystemRun& run) {
    constexpr double kFirst = 1e-6, kMost = 1e3, kFactor = 10;
    SystemMatrix matrix(SystemMatrix::Storage::Best);
    SystemFactor factor;
    double share = kFirst;
    while (!run.is_over()) {
      matrix.assemble(run.system(), run.x(), Curvature::True);
      double added = 0, step = 1;
      for (bool has_moved = false; !has_moved; share *= step == 1 && has_moved ? 1 / kFactor : kFactor) {
        if (share > kMost) return Status::NoProgress;
        matrix.shift(run.rule().node_stiffness(), share - added);
        added = share;
        ++run.summary().factorizations;
        step = 1;
        has_moved = factor.factorize(matrix) && run.search(-factor.solve(run.gradient()), step);
      }
      ++run.summary().iterations;
    }
    return run.end();
  }
};

// A certificate at each iterate would take longer than the iterations.
AlignedOptions without_gap(AlignedOptions options) {
  options.gap = 0;
  return options;
}

class Climb {
 public:
  Climb(const System& system, const StaircaseOptions& options, Eigen::MatrixXd& x, Summary& best)
      : system_(system), options_(options), x_(x), best_(best) {
    if (!missing_curvature(system, Curvature::Minorising).empty()) return;
    prover_.emplace(system);
  }

  void run() {
    best_.lower_bound = std::max(best_.lower_bound, 0.0);  // of all terms but loads
    if (is_proven()) return;
    Eigen::MatrixXd points = x_;
    for (int more = 1; more <= kMostLifts; ++more) {
      if (!descend(lifted(system_, system_.dim() + more), points) || is_end(points) || !is_loose()) return;
    }
  }

 private:
  // Where a further dimension still leads down from a minimum, the nodes are hardly moved in it, and the
  // energy hardly falls; but W lacks more to be semi-definite than any bound can bear. With a tolerance so
  // much finer it lacks next to nothing.
  static constexpr double kFine = 1e-4;
  static constexpr int kMostSteps = 40;  // from near a minimum in fewer dimensions

  // Whether the interval is wide because little is proven of the minimum in more dimensions. If it is wide
  // because that minimum is so low, further dimensions do not help.
  bool is_loose() const {
    constexpr double kShare = 0.1;
    return relaxed_ - best_.lower_bound > kShare * (best_.final_energy - best_.lower_bound);
  }

  // Of many parts that hardly depend on each other, each of which may have a better place in one more
  // dimension. What takes the cube of the number of nodes takes minutes.
  bool is_large() const { return system_.nodes() > 200; }

  // Moves `points`, of fewer rows, down from where they are: first into a dimension that they lack, then to a
  // minimum, and raises the lower bound by what is proven there. False where there is no way down.
  bool descend(const System& lifted, Eigen::MatrixXd& points) {
    Eigen::MatrixXd x = Eigen::MatrixXd::Zero(lifted.dim(), lifted.nodes());
    x.topRows(points.rows()) = points;
    if (is_large()) {
      displace(lifted, x);
    } else if (!step_off(lifted, x)) {
      best_.lower_bound =
          std::max(best_.lower_bound, bound_near(system_, x.topRows(system_.dim()), system_.dim()));
      return false;
    }
    const bool is_first = points.rows() == system_.dim();
    if (is_first && !minimise<SystemAuto>(lifted, x, 1)) return false;
    if (!is_large() && prover_) {
      if (!minimise<DampedNewton>(lifted, x, kFine, kMostSteps)) return false;
    } else if (!is_first && !minimise<SystemNewtonCg>(lifted, x, 1, kMostSteps)) {
      return false;
    }
    relaxed_ = energy(lifted, x);
    best_.lower_bound = std::max(best_.lower_bound, bound_near(lifted, x, system_.dim()));
    points.swap(x);  // Eigen 3.4 frees a matrix twice if memory runs out where it changes its size
    return true;
  }

  // Moves x to a minimum in more dimensions, to a share of the tolerance. False where the caller asks to
  // stop.
  template <typename Method>
  bool minimise(const System& lifted, Eigen::MatrixXd& x, double share,
                int most_steps = std::numeric_limits<int>::max()) {
    Method method{without_gap(options_)};
    method.options.align = false;
    method.options.on_iteration = options_.on_lifted_iteration;
    method.options.tolerance *= share;
    method.options.max_iterations = std::min(options_.max_iterations, most_steps);
    const Summary summary = method.solve(lifted, x);
    if (summary.status == Status::OutOfMemory) raise(std::bad_alloc());
    best_.add_work(summary);
    return summary.usable() && summary.status != Status::Interrupted;
  }

  // Moves each node in the last coordinate, by up to a tenth of the characteristic length, or by a share of
  // how far the nodes are in the one before: a direction of negative curvature would move one part of the
  // system, or few.
  void displace(const System& lifted, Eigen::MatrixXd& x) const {
    constexpr double kShare = 0.3;
    const double before = x.row(lifted.dim() - 2).norm() / std::sqrt(static_cast<double>(x.cols()));
    const double most =
        lifted.dim() > system_.dim() + 1 ? kShare * before : characteristic_length(lifted, x) / 10;
    for (int i = 0; i < lifted.nodes(); ++i) {
      // Fibonacci hashing: numbers without a pattern, the same on every machine.
      const std::uint64_t hash = (static_cast<std::uint64_t>(x.size() - i)) * 0x9e3779b97f4a7c15U >> 11;
      if (!lifted.is_fixed(i)) x(lifted.dim() - 1, i) = most * (0x1p-52 * static_cast<double>(hash) - 1);
    }
  }

  // Along negative curvature, by the first of ever shorter steps after which the energy still falls by a
  // tenth of what the curvature promises; how far it has fallen, rounding may hide.
  bool step_off(const System& lifted, Eigen::MatrixXd& x) {
    Eigen::VectorXd v;
    double curvature = LastCoordinate(lifted, x).negative_direction(v);
    if (!(curvature < 0)) return false;
    SystemRule rule;
    rule.set(lifted, x, 0);
    const double scale = rule.length() / v.cwiseAbs().maxCoeff();
    v *= scale;
    // Where linked nodes nearly coincide, the curvature has no limit, but holds over next to no distance.
    curvature = std::max(curvature * scale * scale, -rule.node_stiffness().dot(v.cwiseAbs2()));
    const double here = energy(lifted, x), rounding = energy_rounding(lifted, x, here);
    constexpr int kMaxHalvings = 30;
    Eigen::MatrixXd gradient;
    double t = 0.5;
    for (int halving = 0; halving < kMaxHalvings; ++halving, t /= 2) {
      x.bottomRows(1) = t * v.transpose();  // the other side is the same
      ++best_.energy_evaluations;
      const double there = energy_and_gradient(lifted, x, gradient);
      if (there <= here + rounding &&
          gradient.bottomRows(1).cwiseProduct(v.transpose()).sum() < t * curvature / 20)
        return true;
    }
    x.bottomRows(1).setZero();
    return false;
  }

  // Takes the minimum below the lifted points if it is lower. Whether nothing is left to be found.
  bool is_end(const Eigen::MatrixXd& lifted) {
    Eigen::MatrixXd trial = lifted.topRows(system_.dim());
    Summary summary = SystemAuto{without_gap(options_)}.solve(system_, trial);
    if (summary.status == Status::OutOfMemory) raise(std::bad_alloc());
    const bool is_lower = summary.usable() && summary.final_energy < best_.final_energy;
    if (is_lower) {
      x_ = trial;
      summary.initial_energy = best_.initial_energy;
      summary.lower_bound = best_.lower_bound;
      std::swap(summary, best_);
    }
    best_.add_work(summary);
    if (summary.status == Status::Interrupted || best_.status == Status::Interrupted) return true;
    return is_lower ? is_proven() : says_so(false);
  }

  bool is_proven() {
    if (!prover_) return says_so(false);
    const Certificate certificate = prover_->certify(x_, gap());
    if (certificate.proof != Proof::NotApplicable)
      best_.lower_bound = std::max(best_.lower_bound, certificate.lower_bound);
    return says_so(certificate.certified());
  }

  bool says_so(bool is_certified) {
    if (!is_certified && !best_.is_within(gap())) return false;
    best_.message = "within the gap of the global minimum";
    return true;
  }

  double gap() const { return options_.gap > 0 ? options_.gap : CertifyOptions().gap; }

  const System& system_;
  const StaircaseOptions& options_;
  std::optional<SystemProver> prover_;
  Eigen::MatrixXd& x_;
  Summary& best_;
  double relaxed_ = 0;  // the energy of the last minimum in more dimensions
};

}  // namespace

Summary SystemStaircase::solve(const System& system, Eigen::MatrixXd& x) const {
  const Stopwatch stopwatch;
  if (const std::string why = why_not_liftable(system); !why.empty())
    return refused(name(), std::string_view(why));
  if (const char* problem = options.problem()) return refused(name(), problem);
  Summary best = SystemAuto{without_gap(options)}.solve(system, x);
  if (best.usable() && best.status != Status::Interrupted) {
    const auto climb = [&] {
      System held = system;
      for (const int node : floating_nodes(system)) held.fix(node);
      Climb(held, options, x, best).run();
    };
    attempt<std::bad_alloc>(climb,
                            [&best](const std::bad_alloc& error) { best.message = memory_message(error); });
  }
  best.solver = name();
  best.seconds = stopwatch.seconds();
  return best;
}

}  // namespace detail

Summary solve_staircase(const System& system, Eigen::MatrixXd& x, const StaircaseOptions& options) {
  return detail::SystemStaircase{options}.solve(system, x);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
