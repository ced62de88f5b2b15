#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/stopwatch.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/dense_bound.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/linear/dense_cholesky.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/cast_system.hpp>
#include <asterism/solver/method/cone_system.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/solver/run/compiled.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/run/time_limit.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/solver/terms/solve.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <new>
#include <queue>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of BranchAndBound: of its lower bound, and of the solver for its upper one.
/// The time includes that of the staircase. The gap applies to the search; the solves in it end by the
/// tolerance.
struct BranchAndBoundOptions : GlobalOptions {
  /// Maximum number of nodes of the search tree.
  int max_nodes = 10000;

  /// The first problem of the options, or nullptr if there is none.
  constexpr const char* problem() const {
    if (max_nodes < 0) return "option max_nodes is negative";
    return GlobalOptions::problem();
  }
};

/// The names of these options, for an OptionVisitor.
inline void visit_options(OptionVisitor& visit, BranchAndBoundOptions& options) {
  visit_options(visit, static_cast<AlignedOptions&>(options));
  visit("max_nodes", options.max_nodes, {0, 1e9});
  visit("max_seconds", options.max_seconds, {0, 1e9});
}

namespace detail {

/// BranchAndBound in double, of any number of nodes.
template <int kDim>
class GlobalSearch {
 public:
  using System = SpringSystem<double, kDim>;
  using Points = typename System::Points;

  /// Maximum number of nodes: matrices are dense.
  static constexpr int kMostNodes = 64;

  /// Moves x to the lowest minimum found.
  void run(const System& system, Points& x, const BranchAndBoundOptions& options, Summary& summary);

 private:
  static constexpr int kTurns = 6;    // of the links' shares
  static constexpr int kRounds = 12;  // of IDA between them
  static constexpr double kFirstRest = 0.03;
  static constexpr double kLeastRest = 1e-6;
  static constexpr double kPromising = 0.05;
  static constexpr const char* kWithinGap = "within the gap of the global minimum";
  using Cell = DirectionCell<kDim>;
  using Cones = ConeSystem<kDim>;
  using Lifted = typename Cones::Points;
  using Direction = typename Cones::Point;

  struct Confined {
    int link;
    Cell cell;
    double rest;  ///< 1 less the share of |d|, see ConeSystem
  };
  // A part of the search: links with their cells, and the placement that bounds it.
  struct Part {
    double bound = 0;
    std::vector<Confined> links;
    Lifted x;
    int loosest = -1;  // link, -1 where there is none to divide

    bool operator<(const Part& other) const { return bound > other.bound; }
  };

  void search(const System& given, Points& x, const TimeLimit& time, Summary& summary) {
    // What nothing holds, hold_floating does, by its first node.
    System system = given;
    ComponentScratch<System> scratch;
    for_each_floating_component(system, scratch, [&system](int i) { system.fix(i); });
    // Anew, as Eigen 3.4 frees a matrix before it allocates it in another size, and once more at its end if
    // that failed.
    quadratic_ = {};
    dense_ = {};
    inverse_ = {};
    cones_.system = &system;
    is_done_ = false;
    prepare(system);
    Part root;
    root.x.setZero(kDim + Cones::kExtra, system.nodes());
    root.x.template topRows<kDim>() = x;
    const double length = characteristic_length(given, x);
    for (int i = 0; i < system.nodes(); ++i) {
      if (!system.is_fixed(i)) root.x(kDim + i % Cones::kExtra, i) = (i % 3 - 1) * length / 10;
    }
    bound(system, root, summary.lower_bound);
    std::priority_queue<Part> open;
    open.push(std::move(root));
    int nodes = 0;
    double closed = std::numeric_limits<double>::infinity();  // the lowest bound of parts that are left alone
    std::string_view limit;
    while (true) {
      const double lowest =
          std::min({open.empty() ? closed : open.top().bound, closed, summary.final_energy});
      summary.lower_bound = std::max(summary.lower_bound, lowest);
      if (is_done_ || summary.is_within(options_.gap) || open.empty()) break;
      if (nodes >= options_.max_nodes) limit = "the limit of nodes was reached before the gap";
      if (time.is_over()) limit = TimeLimit::kMessage;
      if (options_.stopped()) limit = "stopped on request before the gap was reached";
      if (!limit.empty()) break;
      const Part part = open.top();
      open.pop();
      if (part.loosest < 0) {  // no links, or numbers that say nothing
        closed = std::min(closed, part.bound);
        continue;
      }
      for (const Cell& cell : divided(part)) {
        if (time.is_over()) {  // the rest of the part is left alone
          closed = std::min(closed, part.bound);
          break;
        }
        Part child{part.bound, part.links, part.x, -1};
        const auto known = std::find_if(child.links.begin(), child.links.end(),
                                        [&](const Confined& c) { return c.link == part.loosest; });
        if (known != child.links.end()) {
          known->cell = cell;
        } else {
          child.links.push_back({part.loosest, cell, kFirstRest});
        }
        bound(system, child, part.bound);
        ++nodes;
        if (child.bound >= summary.final_energy * (1 - options_.gap / 2)) {
          closed = std::min(closed, child.bound);
          continue;
        }
        improve(given, child, x, summary);
        open.push(std::move(child));
      }
    }
    summary.iterations = nodes;
    if (limit.empty() && !is_done_ && !summary.is_within(options_.gap)) limit = "no link is left to divide";
    if (limit.empty()) {
      summary.message = kWithinGap;
    } else {
      summary.status = options_.stopped() ? Status::Interrupted : Status::MaxIterations;
      summary.message = limit;
    }
  }

  // The inverse of K_dyn.
  void prepare(const System& system) {
    const int n = system.nodes();
    Eigen::MatrixXd K;
    assemble_k_dyn(system, node_stiffness(system), 1.0, K);
    inverse_ = K.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
  }

  // Bounds a part from below, and says which of its links is loosest.
  void bound(const System& system, Part& part, double known) {
    const auto links = static_cast<std::size_t>(system.link_count());
    cones_.shares.assign(links, 1);
    cones_.reaches.assign(links, Direction::Zero());
    for (const Confined& c : part.links) {
      cones_.reaches[static_cast<std::size_t>(c.link)].template head<kDim>() = c.cell.reach();
      cones_.shares[static_cast<std::size_t>(c.link)] = 1 - c.rest;
    }
    for (int turn = 0; turn < kTurns; ++turn) {
      for (int round = 0; round < kRounds; ++round) {
        if (!quadratic_.set(cones_, part.x, 1)) break;
        part.x.noalias() -= 1.5 * quadratic_.gradient * inverse_;  // over-relaxed, and still descending
      }
      // The bound is concave in the shares, and grows as mu (d . reach - |d|).
      for (Confined& c : part.links) {
        const Link& link = system.links()[static_cast<std::size_t>(c.link)];
        const Direction& reach = cones_.reaches[static_cast<std::size_t>(c.link)];
        const Direction d = cones_.difference(c.link, link, part.x);
        const double length = d.norm();
        const double excess = (d.dot(reach) - length) / ((reach.norm() - 1) * length);
        c.rest = std::clamp(c.rest * std::exp(-2 * std::clamp(excess, -1.0, 1.0) / (1 + turn / 2)),
                            kLeastRest, 1.0);
        cones_.shares[static_cast<std::size_t>(c.link)] = 1 - c.rest;
      }
    }
    part.bound = known;
    for (double more = 1e-7; more <= 1; more *= 10) {
      if (!quadratic_.set(cones_, part.x, 1 + more)) break;
      const MinoriserBound result = dense_.bound(cones_, quadratic_);
      if (!result.is_definite) continue;
      const double lowest = quadratic_.lowest(result);
      if (lowest > part.bound) {
        part.bound = lowest;
      } else if (more > 1e-4) {
        break;
      }
    }
    // How much lower each link counts than it would in the plane.
    double most = -std::numeric_limits<double>::infinity();
    part.loosest = -1;
    int l = 0;
    for (const Link& link : system.links()) {
      const Direction d = cones_.difference(l, link, part.x);
      const double flat = d.template head<kDim>().norm();
      const auto at = static_cast<std::size_t>(l);
      const double counted =
          cones_.shares[at] * d.norm() + (1 - cones_.shares[at]) * d.dot(cones_.reaches[at]);
      const double loose = system.link_stiffness[l] * system.rest_length[l] * (counted - flat);
      if (loose > most) most = loose, part.loosest = l;
      ++l;
    }
  }

  std::vector<Cell> divided(const Part& part) const {
    for (const Confined& c : part.links) {
      if (c.link != part.loosest) continue;
      const auto halves = c.cell.halves();
      return {halves.begin(), halves.end()};
    }
    return Cell::faces();
  }

  // A minimum from the part's placement, if that is promising.
  void improve(const System& system, const Part& part, Points& x, Summary& summary) {
    Points trial = part.x.template topRows<kDim>();
    if (!(energy(system, trial) < summary.final_energy * (1 + kPromising))) return;
    const Summary found = solver_.solve(system, trial);
    summary.add_work(found);
    if (!found.usable() || found.status == Status::Interrupted ||
        !(found.final_energy < summary.final_energy))
      return;
    x = trial;
    summary.status = found.status;
    summary.final_energy = found.final_energy;
    summary.gradient_norm = found.gradient_norm;
    summary.stationarity = found.stationarity;
    summary.positive_definite = found.positive_definite;
    is_done_ = is_done(system, x, summary);
  }

  // Also where there is no energy to speak of, of which no share could be proven.
  bool is_done(const System& system, const Points& x, Summary& summary) {
    if (summary.is_within(options_.gap)) return true;
    certifier_.options.gap = options_.gap;
    const Certificate certificate = certifier_.certify(system, x);
    if (certificate.proof != Proof::NotApplicable)
      summary.lower_bound = std::max(summary.lower_bound, certificate.lower_bound);
    return certificate.certified();
  }

  BranchAndBoundOptions options_;
  Auto<System> solver_;
  Certifier<System> certifier_;
  bool is_done_ = false;
  Cones cones_;
  Minoriser<Cones> quadratic_;
  DenseBound<Eigen::Dynamic, Eigen::Dynamic> dense_;
  Eigen::MatrixXd inverse_;
};

template <int kDim>
void GlobalSearch<kDim>::run(const System& system, Points& x, const BranchAndBoundOptions& options,
                             Summary& summary) {
  const TimeLimit time(options.max_seconds, options);
  options_ = options;
  StaircaseOptions staircase{options};
  staircase.gap = 0;  // placements are to be minima: the gap is the search's
  staircase.on_iteration = time.observed();
  solver_.options = staircase;
  solver_.options.on_iteration = staircase.on_lifted_iteration = time.hidden();
  summary = solve_staircase(system, x, staircase);
  if (!summary.usable()) return;
  summary.lower_bound = std::max(summary.lower_bound, 0.0);
  time.explain(summary);
  if (summary.status == Status::Interrupted) return;
  if (is_done(system, x, summary)) {
    summary.message = kWithinGap;
    return;
  }
  if (time.is_over()) {
    summary.status = Status::MaxIterations;
    summary.message = TimeLimit::kMessage;
    return;
  }
  if (system.nodes() > kMostNodes) {
    summary.status = Status::MaxIterations;
    summary.message = "too many nodes for the search: the interval is that of the staircase";
    return;
  }
  attempt<std::bad_alloc>([&] { search(system, x, time, summary); },
                          [&summary](const std::bad_alloc& error) {
                            summary.status = Status::MaxIterations;
                            summary.message = memory_message(error);
                          });
}

#ifdef ASTERISM_SOLVER_COMPILED
extern template ASTERISM_API void GlobalSearch<2>::run(const PlaneSystem&, PlaneSystem::Points&,
                                                       const BranchAndBoundOptions&, Summary&);
extern template ASTERISM_API void GlobalSearch<3>::run(const SpaceSystem&, SpaceSystem::Points&,
                                                       const BranchAndBoundOptions&, Summary&);
#endif

}  // namespace detail

namespace detail {

/// Whether BranchAndBound can solve systems of this type.
template <typename System>
constexpr bool is_searchable() {
  return std::is_same_v<typename System::Model, Springs> && (System::kDim == 2 || System::kDim == 3);
}

}  // namespace detail

/// The global minimum of a few parts, within a given gap: narrows the interval of solve_staircase by
/// branch and bound.
///
/// The staircase's lower bound is below the least energy because nodes may leave the plane. A link whose
/// direction in the plane is known up to a half angle h has |d| <= d . c / cos h, with c the middle
/// direction: its energy is then above a convex quadratic, whose loss is of the order of h^2, and nothing is
/// gained by leaving the plane; counted in part (ConeSystem), the loss is no more than is needed. So the
/// search divides the directions of links, the loosest first, and bounds each part as the staircase bounds
/// all: by the least energy in more dimensions (IDA's iterations, whose matrix is the same for all parts) and
/// the quadratic that touches it there. The part of the lowest bound is divided next.
///
/// Summary::lower_bound and final_energy are the interval. Converged means that x is stationary and the
/// interval within options.gap (or, where the energy is mere rounding, that certify proves x); MaxIterations,
/// that a limit came first, which the message names. `iterations`
/// counts nodes of the tree. For about 8 nodes or fewer: the tree grows as a power of the number of loose
/// links, and without end if a component without anchors turns freely. More than 64 nodes are left to the
/// staircase. For springs only, without loads, in 2 or 3 dimensions; in double; uses the heap; one thread at
/// a time. Needs asterism::solver_compiled.
template <typename System>
requires(detail::is_searchable<System>()) class BranchAndBound {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  BranchAndBoundOptions options;

  static constexpr std::string_view name() { return "branch and bound"; }

  /// Moves x (Dim x N) to the lowest minimum found. Statuses other than those above are as for
  /// solve_staircase.
  Summary solve(const System& system, Points& x) {
    const detail::Stopwatch stopwatch;
    Summary summary;
    summary.status = Status::InvalidInput;
    if (detail::shares_memory(system, x.data(), x.size())) {
      summary.message = detail::kSharesMemory;
    } else if (const char* problem = options.problem()) {
      summary.message = problem;
    } else if (system.has_loads()) {
      summary.message = detail::kNoLoads;
    } else {
      detail::attempt<std::bad_alloc>([&] { search(system, x, summary); },
                                      [&summary](const std::bad_alloc& error) {
                                        summary.status = Status::OutOfMemory;
                                        summary.message = detail::memory_message(error);
                                      });
    }
    summary.solver = name();
    summary.seconds = stopwatch.seconds();
    return summary;
  }

 private:
  using Search = detail::GlobalSearch<System::kDim>;
  using Plane = typename Search::System;

  void search(const System& system, Points& x, Summary& summary) {
    const auto plane = detail::cast_system<Plane>(system);
    typename Plane::Points found = x.template cast<double>();
    search_.run(plane, found, options, summary);
    if (!summary.usable()) return;
    x = found.template cast<Scalar>();
    if constexpr (!std::is_same_v<Scalar, double>) {
      found = x.template cast<double>();
      summary.final_energy = energy(plane, found);
      summary.gradient_norm = gradient(plane, found).norm();
      summary.stationarity = stationarity(plane, found);
    }
  }

  Search search_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
