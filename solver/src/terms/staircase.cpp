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

#include "kernels.hpp"
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

// Without eigenvectors, which Eigen's solver would compile even if it computes none.
double least_eigenvalue(const Eigen::MatrixXd& symmetric) {
  const Eigen::Tridiagonalization<Eigen::MatrixXd> band(symmetric);
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen;
  eigen.computeFromTridiagonal(band.diagonal(), band.subDiagonal(), Eigen::EigenvaluesOnly);
  return eigen.eigenvalues()[0];
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
    const auto rows_of = [dim](int node) { return node < 0 ? 1 : dim; };  // an unknown common to all has one
    for (int a = 0, row = 0; a < count; row += rows_of(nodes[a]), ++a) {
      for (int b = 0, column = 0; b < count; column += rows_of(nodes[b]), ++b) {
        if (nodes[a] < 0 || nodes[b] < 0) continue;
        add(nodes[a], nodes[b], matrix[(column + dim - 1) * rows + row + dim - 1]);
      }
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
    const double least = least_eigenvalue(w_), size = w_.diagonal().cwiseAbs().maxCoeff();
    const double rounding = 64 * std::numeric_limits<double>::epsilon() * size;
    if (!(least + rounding < 0)) return 0;
    // By inverse iterations, which take a tenth of what all eigenvectors do.
    constexpr double kNear = 1e-10;
    constexpr int kIterations = 3;
    const Eigen::Index n = w_.rows();
    Eigen::MatrixXd factor = w_;
    factor.diagonal().array() -= least - kNear * size;  // positive definite
    if (lanes_v0_1::factorize(lanes_v0_1::SymmetricMatrix<double>{factor.data(), n, n}) < n) return 0;
    const Eigen::VectorXd inverse_pivots = factor.diagonal().cwiseInverse();
    v.resize(n);
    for (Eigen::Index i = 0; i < n; ++i) v[i] = std::sin(static_cast<double>(i * i + 1));
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      lanes_v0_1::solve({factor.data(), inverse_pivots.data(), n, v.data(), 1});
      v.normalize();
    }
    return v.dot(w_ * v) < 0 ? least + rounding : 0;
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
// searched for by ever smaller factors, until it is as high as `enough`; not if the smallest share has no
// minimum and `is_brief`, as a further dimension then helps more.
double bound_near(const System& system, const Eigen::MatrixXd& x, int from, double enough,
                  bool is_brief = false) {
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
  const double nearly_all = std::min(enough, (1 - kNear) * energy(system, x));
  for (const Eigen::MatrixXd* out : {&last, &all}) {
    if (!(out->array() != 0).any() || highest > nearly_all) continue;
    double best = 0, best_share = 0;
    bool has_minimum = false;
    const auto is_better = [&](double share) {
      const SystemProver::Bound bound = prover.bound(x + share * *out);
      has_minimum = bound.in_range && bound.has_minimum;
      if (!has_minimum || !(bound.lower_bound > best)) return false;
      best = bound.lower_bound;
      best_share = share;
      return true;
    };
    for (double share = 1e-9; share <= 1; share *= kFactor) {
      if (!is_better(share) && has_minimum && best > 0) break;
      if (best >= enough) break;
      if (is_brief && !(best > 0)) return highest;
    }
    double factor = kFactor;
    for (int refinement = 0; refinement < kRefinements && best > 0 && best < enough; ++refinement) {
      factor = std::sqrt(factor);
      if (!is_better(best_share / factor)) is_better(best_share * factor);
    }
    highest = std::max(highest, best);
  }
  return highest;
}

// Lower bounds of the energy E at points that are only near a minimum: those of a system whose anchors are
// stiffer by a share s. No term is negative, so that (1 + s) E is no less than its energy; and the quadratic
// that touches that from below has a minimum where that of E lacks a little curvature. The share is the one
// that costs most of what the bound may lack.
class StifferAnchors {
 public:
  // Of a system in more than `dim` dimensions, that of the plane. The anchors of some nodes stay as they are.
  StifferAnchors(const System& lifted, int dim, const std::vector<int>& without)
      : system_(lifted), dim_(dim) {
    for (int t = 0; t < system_.term_count(); ++t) {
      Term& term = system_.term(t);
      if (term.size() == 0 || term.kind() != "anchors" || !term.is_quadratic()) continue;
      Eigen::MatrixXd& stiffness = term.values("stiffness");
      if (stiffness.cols() != term.size()) stiffness = stiffness.replicate(1, term.size()).eval();
      Eigen::MatrixXd more = stiffness;
      for (int e = 0; e < term.size(); ++e) {
        if (std::find(without.begin(), without.end(), term.nodes()(0, e)) != without.end()) more(0, e) = 0;
      }
      anchors_.push_back({t, stiffness, more});
    }
  }

  // The bound at x, of this energy, with the share that lowers a bound at a minimum by what it may lack to
  // `enough`, or half of that; 0 if none is proven.
  double bound(const Eigen::MatrixXd& x, double energy, double enough) {
    double highest = 0;
    if (anchors_.empty() || !(energy > enough)) return highest;
    // The anchors' energy in the plane grows by the share; what is beyond it the quadratic's minimum has not.
    Eigen::MatrixXd flat = x;
    flat.bottomRows(x.rows() - dim_).setZero();
    double others = energy;
    for (const auto& [t, stiffness, more] : anchors_) {
      system_.term(t).values("stiffness") = more;
      others -= system_.term(t).energy(flat, nullptr);
    }
    for (const double part : {0.8, 0.4}) {
      const double loss = part * (energy - enough);
      const double share = others * kMost > loss ? loss / others : kMost;
      set_share(share);
      const SystemProver::Bound bound = prover_.bound(x);
      if (!bound.in_range || !bound.has_minimum) break;
      highest = std::max(highest, bound.lower_bound * (1 - kRounding) / (1 + share));
      if (highest >= enough) break;
    }
    return highest;
  }

 private:
  static constexpr double kMost = 0.1, kRounding = 8 * std::numeric_limits<double>::epsilon();

  void set_share(double share) {
    for (const auto& [t, stiffness, more] : anchors_)
      system_.term(t).values("stiffness") = stiffness + share * more;
  }

  System system_;
  int dim_;
  struct Anchors {
    int term;
    Eigen::MatrixXd stiffness, more;
  };
  std::vector<Anchors> anchors_;
  SystemProver prover_{system_};
};

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
    constexpr double kFirst = 1e-6, kMost = 1e3;
    constexpr double kFactor = 4;  // from 1.5, 2, 3, 4, 5, 10, 30 and 100 on 300 systems of 100 nodes
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

// A system and a constant: their energy is at most that of another system where some nodes are in a part of
// the plane, as the anchors of these nodes have taken up terms that are not positive there.
struct Part {
  System system;
  double constant;               // to be added to the energy
  int term = 0, element = 0;     // the anchor that `pull` changes
  std::vector<int> pulled = {};  // the nodes whose anchors it has changed

  // Chooses the anchor of a node for `pull`. False where it has none that is a plain spring.
  bool take(int node) {
    for (int t = 0; t < system.term_count(); ++t) {
      Term& anchors = system.term(t);
      if (anchors.kind() != "anchors" || !anchors.is_quadratic() || anchors.values("information").size() > 0)
        continue;
      for (int e = 0; e < anchors.size(); ++e) {
        if (anchors.nodes()(0, e) != node || !anchors.is_stiff(e)) continue;
        for (const char* column : {"position", "stiffness"}) {
          Eigen::MatrixXd& values = anchors.values(column);
          if (values.cols() != anchors.size()) values = values.col(0).replicate(1, anchors.size()).eval();
        }
        term = t;
        element = e;
        pulled.push_back(node);
        return true;
      }
    }
    return false;
  }

  static constexpr double kRounding = 64 * std::numeric_limits<double>::epsilon();

  // Adds k |u|^2 / 2 - f . u + c for the place u of the node from a center.
  void pull(const Eigen::VectorXd& center, double k, const Eigen::VectorXd& f, double c) {
    auto position = system.term(term).values("position").col(element);
    double& stiffness = system.term(term).values("stiffness")(0, element);
    const Eigen::VectorXd from = position - center;
    const double before = stiffness * from.squaredNorm() / 2;
    const Eigen::VectorXd to = (stiffness * from + f) / (stiffness + k);
    stiffness += k;
    position = center + to;
    const double after = stiffness * to.squaredNorm() / 2;
    // Less the rounding, also that of the position where the spring is as long as its energy may make it.
    constant +=
        before - after + c - kRounding * (before + after + std::abs(c) + stiffness * position.squaredNorm());
  }
};

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
      if (!descend(system_, points, best_.lower_bound, best_.final_energy)) break;
      if (is_end(points)) return;
      if (!is_loose(best_.lower_bound, best_.final_energy)) break;
    }
    if (options_.gap > 0 && prover_ && !is_large()) divide(points);
  }

 private:
  // Where a further dimension still leads down from a minimum, the nodes are hardly moved in it, and the
  // energy hardly falls; but W lacks more to be semi-definite than any bound can bear. With a tolerance so
  // much finer it lacks next to nothing.
  static constexpr double kFine = 1e-4;
  static constexpr int kNoLimit = std::numeric_limits<int>::max();
  static constexpr int kMostSteps = 40;  // from near a minimum in fewer dimensions

  // Whether the interval is wide because little is proven of the minimum in more dimensions. If it is wide
  // because that minimum is so low, further dimensions do not help.
  bool is_loose(double bound, double highest) const {
    constexpr double kShare = 0.1;
    return relaxed_ - bound > kShare * (highest - bound);
  }

  // Of many parts that hardly depend on each other, each of which may have a better place in one more
  // dimension. What takes the cube of the number of nodes takes minutes.
  bool is_large() const { return system_.nodes() > 200; }

  // Moves `points` down from where they are: first into a dimension that they lack, then to a minimum, and
  // raises the lower bound by what is proven there, until it is near enough to `highest`. False where there
  // is no way down.
  bool descend(const System& system, Eigen::MatrixXd& points, double& bound, double highest,
               const std::vector<int>& pulled = {}) {
    const int dim = system.dim(), rows = static_cast<int>(points.rows());
    const System more = lifted(system, rows + 1);
    Eigen::MatrixXd x = Eigen::MatrixXd::Zero(rows + 1, points.cols());
    x.topRows(rows) = points;
    if (is_large()) {
      displace(more, x);
    } else if (!step_off(more, x)) {
      bound = std::max(bound, bound_near(system, x.topRows(dim), dim, enough(highest)));
      return false;
    }
    const bool is_first = rows == dim;
    const bool is_fine = !is_large() && prover_;
    std::optional<Watch> watch;
    if (is_fine && options_.gap > 0) watch.emplace(*this, more, bound, highest, pulled);
    if (is_first && !minimise<SystemAuto>(more, x, 1, kNoLimit, watch ? &*watch : nullptr)) return false;
    if (is_fine && !(watch && watch->is_enough) && !minimise_finely(more, x, watch)) return false;
    if (!is_fine && !is_first && !minimise<SystemNewtonCg>(more, x, 1, kMostSteps)) return false;
    raise_bound(more, x, bound, highest);
    points.swap(x);  // Eigen 3.4 frees a matrix twice if memory runs out where it changes its size
    return true;
  }

  // What the lower bound has to be for the interval up to `highest` to be narrow.
  double enough(double highest) const {
    return options_.gap > 0 ? highest - options_.gap * best_.final_energy
                            : std::numeric_limits<double>::infinity();
  }

  void raise_bound(const System& lifted, const Eigen::MatrixXd& x, double& bound, double highest) {
    relaxed_ = energy(lifted, x);
    const bool is_brief = options_.gap > 0 && !is_large() && lifted.dim() < system_.dim() + kMostLifts;
    if (!(bound >= enough(highest)))
      bound = std::max(bound, bound_near(lifted, x, system_.dim(), enough(highest), is_brief));
  }

  // Raises a lower bound at the iterates of a method, and stops it where the bound is high enough. It costs
  // ten iterations without a factorisation, so that the next one is where the gradient is a tenth.
  struct Watch {
    Watch(const Climb& climb, const System& lifted, double& of, double highest,
          const std::vector<int>& pulled)
        : bound(of),
          enough(climb.enough(highest)),
          is_enough(of >= enough),
          stiffer(lifted, climb.system_.dim(), pulled) {}

    bool goes_on(const Iteration& at) {
      constexpr double kLess = 10;
      if (at.number == 0 && !are_steps_long) last = at.gradient_norm;
      if (!are_steps_long && !(kLess * at.gradient_norm < last)) return true;
      last = at.gradient_norm;
      bound = std::max(bound, stiffer.bound(at.x, at.energy, enough));
      is_enough = bound >= enough;
      return !is_enough;
    }

    double& bound;
    double enough, last = 0;
    bool is_enough, are_steps_long = false;  // those of a method with a factorisation
    StifferAnchors stiffer;
  };

  // Raises the lower bound where it is low because nodes leave the plane. The one that leaves it most is, in
  // the plane, inside a box around its place in x or beyond one of the sides, and the least of their bounds
  // holds for all placements. Inside, the box limits how far the node is out of the plane, too; beyond, its
  // springs are under tension. The part inside is then divided by the next node.
  void divide(Eigen::MatrixXd points) {
    constexpr int kMostDivisions = 3;
    constexpr double kSize = 0.2;  // of the box, to how far the node is out of the plane
    const int dim = system_.dim(), rows = static_cast<int>(points.rows()), more = rows - dim;
    if (more == 0) return;
    Part inside{system_, -Part::kRounding * best_.final_energy};
    double beyond = std::numeric_limits<double>::infinity();
    double least = best_.lower_bound;  // about that of the part inside
    for (int division = 0; !says_so(false) && division < kMostDivisions; ++division) {
      const System whole = lifted(inside.system, rows);
      const Eigen::VectorXd stiffness = node_stiffness(whole, points);
      const Eigen::VectorXd squares = points.bottomRows(more).colwise().squaredNorm();
      Eigen::Index node = 0;
      const double most = stiffness.cwiseProduct(squares).maxCoeff(&node);
      if (!(most > 0) || system_.is_fixed(static_cast<int>(node)) || !inside.take(static_cast<int>(node)))
        return;
      const double half = kSize * std::sqrt(squares[node] / dim);
      const Eigen::VectorXd center = x_.col(node);
      SystemMatrix hessian(SystemMatrix::Storage::Best);
      SystemFactor factor;
      hessian.assemble(whole, points, Curvature::True);
      hessian.shift(stiffness, 1e-9);
      if (!factor.factorize(hessian)) return;
      for (int side = 0; side < 2 * dim; ++side) {
        Eigen::MatrixXd force = Eigen::MatrixXd::Zero(rows, points.cols());
        force(side / 2, node) = side % 2 == 0 ? 1 : -1;
        const Eigen::VectorXd normal = force.col(node).head(dim);
        const Eigen::MatrixXd moved = factor.solve(force);
        const double missing = half - normal.dot(points.col(node).head(dim) - center);
        const double strength = std::max(0.0, missing / normal.dot(moved.col(node).head(dim)));
        Part part = inside;
        part.pull(center, 0, strength * normal, strength * half);
        beyond = std::min(beyond, bound_of(part, points + strength * moved));
        if (!(beyond > best_.lower_bound)) return;
      }
      const double tension = 4 * std::max(best_.final_energy - least, 0.0) * stiffness[node] / most;
      inside.pull(center, tension, Eigen::VectorXd::Zero(dim), -tension * half * half * dim / 2);
      least = bound_of(inside, points, &points);
      best_.lower_bound = std::max(best_.lower_bound, std::min(least, beyond));
    }
  }

  // The lower bound of a part, by its minimum near points in more dimensions.
  double bound_of(const Part& part, Eigen::MatrixXd points, Eigen::MatrixXd* minimum = nullptr) {
    const System more = lifted(part.system, static_cast<int>(points.rows()));
    const double highest = best_.final_energy - part.constant;
    double bound = 0;
    std::optional<Watch> watch(std::in_place, *this, more, bound, highest, part.pulled);
    if (!minimise_finely(more, points, watch)) return 0;
    if (minimum != nullptr) *minimum = points;
    raise_bound(more, points, bound, highest);
    while (bound < enough(highest) && is_loose(bound, highest) &&
           points.rows() < system_.dim() + kMostLifts &&
           descend(part.system, points, bound, highest, part.pulled)) {
    }
    bound += part.constant;
    return is_finite(bound) ? bound : 0;
  }

  // Moves x to a minimum in more dimensions, to a share of the tolerance. False where the caller asks to
  // stop.
  template <typename Method>
  bool minimise(const System& lifted, Eigen::MatrixXd& x, double share, int most_steps = kNoLimit,
                Watch* watch = nullptr) {
    Method method{without_gap(options_)};
    method.options.align = false;
    bool is_interrupted = false;
    const auto goes_on = [&](const Iteration& at) {
      is_interrupted = options_.on_lifted_iteration && !options_.on_lifted_iteration(at);
      return !is_interrupted && watch->goes_on(at);
    };
    method.options.on_iteration = options_.on_lifted_iteration;
    if (watch) method.options.on_iteration = goes_on;
    method.options.tolerance *= share;
    method.options.max_iterations = std::min(options_.max_iterations, most_steps);
    const Summary summary = method.solve(lifted, x);
    if (summary.status == Status::OutOfMemory) raise(std::bad_alloc());
    best_.add_work(summary);
    const bool is_done = watch && watch->is_enough && !is_interrupted && !options_.stopped();
    return summary.usable() && (is_done || summary.status != Status::Interrupted);
  }

  bool minimise_finely(const System& lifted, Eigen::MatrixXd& x, std::optional<Watch>& watch) {
    if (watch) watch->are_steps_long = true;
    return minimise<DampedNewton>(lifted, x, kFine, kMostSteps, watch ? &*watch : nullptr);
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
