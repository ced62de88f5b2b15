#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/dense_bound.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/detail/minoriser.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/linear/dense_cholesky.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/staircase.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <chrono>
#include <cmath>
#include <limits>
#include <new>
#include <queue>
#include <string_view>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// A set of directions in kDim dimensions: a box on a face of the cube around the origin.
template <int kDim>
struct DirectionCell {
  using Point = Eigen::Matrix<double, kDim, 1>;

  int axis = 0;  ///< the face is where this coordinate is `side`
  double side = 1;
  Point low = Point::Constant(-1), high = Point::Constant(1);  ///< of the others

  /// The middle direction, a unit vector, over the cosine of the widest angle from it: d of this cell has
  /// |d| <= d . reach().
  Point reach() const {
    Point middle = (low + high) / 2;
    middle[axis] = side;
    middle.normalize();
    double cosine = 1;
    for (int corner = 0; corner < (1 << kDim); ++corner) {
      Point direction;
      for (int d = 0; d < kDim; ++d) direction[d] = (corner >> d & 1) != 0 ? high[d] : low[d];
      direction[axis] = side;
      cosine = std::min(cosine, middle.dot(direction.normalized()));
    }
    return middle / (cosine * (1 - 8 * std::numeric_limits<double>::epsilon()));
  }

  /// The two halves, across the longest edge.
  std::array<DirectionCell, 2> halves() const {
    int longest = axis == 0 ? 1 : 0;
    for (int d = 0; d < kDim; ++d) {
      if (d != axis && high[d] - low[d] > high[longest] - low[longest]) longest = d;
    }
    std::array<DirectionCell, 2> result{*this, *this};
    const double middle = (low[longest] + high[longest]) / 2;
    result[0].high[longest] = result[1].low[longest] = middle;
    return result;
  }

  /// All directions.
  static std::vector<DirectionCell> faces() {
    std::vector<DirectionCell> result;
    for (int axis = 0; axis < kDim; ++axis) {
      for (const double side : {-1.0, 1.0}) result.push_back({axis, side});
    }
    return result;
  }
};

/// A system of springs in kExtra more dimensions, some of whose links have a direction, without these, in a
/// cell. In kDim dimensions the length r of such a link is at most |d| and at most d . reach; it counts for
/// k (|d|^2 - 2 mu (share |d| + (1 - share) d . reach) + mu^2) / 2 with any share in [0, 1]. The least energy
/// is a lower bound of that of placements in kDim dimensions with such directions.
template <int kDim_>
struct ConeSystem {
  static constexpr int kDim = kDim_;
  static constexpr int kExtra = 2;
  using Point = Eigen::Matrix<double, kDim + kExtra, 1>;
  using Points = Eigen::Matrix<double, kDim + kExtra, Eigen::Dynamic>;

  const SpringSystem<double, kDim>* system;
  std::vector<Point> reaches;  ///< of the links' cells
  std::vector<double> shares;  ///< 1 for a link without a cell

  int nodes() const { return system->nodes(); }
};

/// The quadratic below the energy of a ConeSystem: as that of a SpringSystem.
template <int kDim>
class Minoriser<ConeSystem<kDim>> {
 public:
  using System = ConeSystem<kDim>;
  using Points = typename System::Points;
  using Point = typename System::Point;
  static constexpr int kBlock = 1;
  static constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

  /// At x, touching links without a cell at `stretch` times their length. False where one of these has none.
  bool set(const System& cones, const Points& x, double stretch) {
    const auto& system = *cones.system;
    const int n = system.nodes();
    energy = rounding_ = 0;
    gradient.setZero(x.rows(), n);
    stiffness_ = scale = system.anchor_stiffness;
    gradient_scale.setZero(n);
    weights_.resize(system.link_count());
    for (int i = 0; i < n; ++i) {
      if (!(system.anchor_stiffness[i] > 0)) continue;
      Point offset = x.col(i);
      offset.template head<kDim>() -= system.anchors.col(i);
      gradient.col(i) = system.anchor_stiffness[i] * offset;
      gradient_scale[i] = system.anchor_stiffness[i] * offset.cwiseAbs().sum();
      add(gradient.col(i).dot(offset) / 2);
    }
    bool is_known = true;
    int l = 0;
    for (const Link& link : system.links()) {
      const double k = system.link_stiffness[l];
      const double mu = k > 0 ? system.rest_length[l] : 0;
      const Point d = x.col(link.i) - x.col(link.j);
      const double square = d.squaredNorm(), length = std::sqrt(square), touched = stretch * length;
      const double share = cones.shares[static_cast<std::size_t>(l)];
      is_known &= touched > 0 || !(share * mu > 0);
      const double w = touched > 0 ? k * (1 - share * mu / touched) : k;
      Point pull = w * d;
      add(k * (touched * touched / 2 - share * mu * touched)), add(k * mu * mu / 2);
      add(w * (square - touched * touched) / 2);
      if (share < 1) {
        const Point towards = (1 - share) * k * mu * cones.reaches[static_cast<std::size_t>(l)];
        pull -= towards;
        add(-d.dot(towards));
      }
      weights_[l] = w;
      gradient.col(link.i) += pull;
      gradient.col(link.j) -= pull;
      for (const int i : {link.i, link.j}) {
        stiffness_[i] += w;
        scale[i] += k + std::abs(w - k);
        gradient_scale[i] += k * (length + 2 * mu) + std::abs(w) * length;
      }
      ++l;
    }
    for (int i = 0; i < n; ++i) {
      if (!system.is_fixed(i)) continue;
      gradient.col(i).setZero();
      gradient_scale[i] = 0;
      scale[i] = 1;
    }
    return is_known;
  }

  template <typename Diagonal, typename Couple>
  void for_each_entry(const System& cones, Diagonal&& diagonal, Couple&& couple) const {
    const auto& system = *cones.system;
    for (int i = 0; i < system.nodes(); ++i) diagonal(i, 0, 0, system.is_fixed(i) ? 1.0 : stiffness_[i]);
    int l = 0;
    for (const Link& link : system.links()) {
      if (!system.is_fixed(link.i) && !system.is_fixed(link.j)) couple(l, link, weights_[l]);
      ++l;
    }
  }

  MinoriserView view() const {
    const int n = static_cast<int>(scale.size());
    return {n,
            1,
            static_cast<int>(gradient.rows()),
            2 * static_cast<int>(weights_.size()) + 2,
            gradient.data(),
            scale.data(),
            gradient_scale.data()};
  }

  /// The least value of the quadratic, given its bound.
  double lowest(const MinoriserBound& bound) const {
    return energy - bound.gap - kEpsilon * (16 + static_cast<double>(weights_.size())) * rounding_;
  }

  double energy = 0;
  Points gradient;
  Eigen::VectorXd scale, gradient_scale;

 private:
  void add(double term) {
    energy += term;
    rounding_ += std::abs(term);
  }

  double rounding_ = 0;  // of the terms
  Eigen::VectorXd stiffness_, weights_;
};

}  // namespace detail

/// What BranchAndBound takes.
struct BranchAndBoundOptions : AlignedOptions {
  /// Nodes of the search tree at most.
  int max_nodes = 10000;
  /// Wall-clock time at most, after the Staircase's [s].
  double max_seconds = 1;

  /// A gap of 1e-3.
  constexpr BranchAndBoundOptions() { gap = 1e-3; }

  /// What is wrong with the options, nullptr for nothing.
  constexpr const char* problem() const {
    if (!(gap > 0)) return "option gap is not positive";
    if (max_nodes < 0) return "option max_nodes is negative";
    if (!(max_seconds >= 0)) return "option max_seconds is negative or not a number";
    return AlignedOptions::problem();
  }
};

/// The names of these options, for an OptionVisitor.
inline void visit_options(OptionVisitor& visit, BranchAndBoundOptions& options) {
  visit_options(visit, static_cast<AlignedOptions&>(options));
  visit("max_nodes", options.max_nodes, {0, 1e9});
  visit("max_seconds", options.max_seconds, {0, 1e9});
}

/// The global minimum of a few parts to a gap asked for: narrows the interval of Staircase by branch and
/// bound.
///
/// What keeps Staircase's lower bound from the least energy is that nodes leave the plane. A link whose
/// direction in the plane is known up to a half angle h has |d| <= d . c / cos h, with c the middle
/// direction: its energy is then above a convex quadratic, whose loss is of the order of h^2, and nothing is
/// gained by leaving the plane; counted in part (ConeSystem), the loss is no more than is needed. So the
/// search divides the directions of links, the loosest first, and bounds each part as Staircase bounds all:
/// by the least energy in more dimensions (IDA's iterations, whose matrix is the same for all parts) and the
/// quadratic that touches it there. The part of the lowest bound is divided next.
///
/// Summary::lower_bound and final_energy are the interval; Converged says that it is within options.gap,
/// MaxIterations that a limit came first, which the message names. `iterations` are nodes of the tree. For
/// few nodes, 8 or so: the tree grows as a power of the number of loose links, and without end where a
/// component without anchors turns freely. Springs alone, in 2 or 3 dimensions; uses the heap; one thread at
/// a time.
template <typename System>
requires(std::is_same_v<typename System::Model, Springs> &&
         (System::kDim == 2 || System::kDim == 3)) class BranchAndBound {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  BranchAndBoundOptions options;

  static constexpr std::string_view name() { return "branch and bound"; }

  /// Moves x (Dim x N) to the lowest minimum found. Statuses beside those above are Staircase's.
  Summary solve(const System& system, Points& x) {
    const auto begin = std::chrono::steady_clock::now();
    Summary summary;
    if (const char* problem = options.problem()) {
      summary.solver = name();
      summary.status = Status::InvalidInput;
      summary.message = problem;
      return summary;
    }
    staircase_.options = options;
    summary = staircase_.solve(system, x);
    summary.solver = name();
    if (!summary.usable() || summary.status == Status::Interrupted || is_done(system, x, summary))
      return summary;
    detail::attempt<std::bad_alloc>(
        [&] { search(system, x, summary); },
        [&summary](const std::bad_alloc& error) { summary.message = detail::memory_message(error); });
    summary.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return summary;
  }

 private:
  static constexpr int kDim = System::kDim;
  static constexpr int kTurns = 6;    // of the links' shares
  static constexpr int kRounds = 12;  // of IDA between them
  static constexpr double kFirstRest = 0.03;
  static constexpr double kLeastRest = 1e-6;
  using Plane = SpringSystem<double, kDim>;
  using Cell = detail::DirectionCell<kDim>;
  using Cones = detail::ConeSystem<kDim>;
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
    int loosest = -1;  // link

    bool operator<(const Part& other) const { return bound > other.bound; }
  };

  void search(const System& given, Points& x, Summary& summary) {
    const auto begin = std::chrono::steady_clock::now();
    const auto seconds = [begin] {
      return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    };
    const Plane system = plane(given);
    cones_.system = &system;
    is_done_ = false;
    prepare(system);
    Part root;
    root.x.setZero(kDim + Cones::kExtra, system.nodes());
    root.x.template topRows<kDim>() = x.template cast<double>();
    const double length = static_cast<double>(characteristic_length(given, x));
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
      if (is_done_ || summary.is_within(options.gap) || open.empty()) break;
      if (nodes >= options.max_nodes) limit = "the limit of nodes came before the gap";
      if (seconds() > options.max_seconds) limit = "the limit of time came before the gap";
      if (options.stopped()) limit = "asked to stop before the gap";
      if (!limit.empty()) break;
      const Part part = open.top();
      open.pop();
      for (const Cell& cell : divided(part)) {
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
        if (child.bound >= summary.final_energy * (1 - options.gap / 2)) {
          closed = std::min(closed, child.bound);
          continue;
        }
        improve(given, child, x, summary);
        open.push(std::move(child));
      }
    }
    summary.iterations = nodes;
    if (limit.empty()) {
      summary.status = Status::Converged;
      summary.message = "within the gap of the global minimum";
    } else {
      summary.status = options.stopped() ? Status::Interrupted : Status::MaxIterations;
      summary.message = limit;
    }
  }

  static Plane plane(const System& given) {
    Plane system(Topology<>::from_links(given.nodes(), given.links()));
    system.anchors = given.anchors.template cast<double>();
    system.anchor_stiffness = given.anchor_stiffness.template cast<double>();
    system.rest_length = given.rest_length.template cast<double>();
    system.link_stiffness = given.link_stiffness.template cast<double>();
    for (int i = 0; i < given.nodes(); ++i) {
      if (given.is_fixed(i)) system.fix(i);
    }
    // What nothing holds, ground_components does, by its first node.
    detail::ComponentScratch<Plane> scratch;
    detail::for_each_floating_component(system, scratch, [&system](int i) { system.fix(i); });
    return system;
  }

  // The inverse of K_dyn.
  void prepare(const Plane& system) {
    const int n = system.nodes();
    Eigen::MatrixXd K;
    detail::assemble_k_dyn(system, node_stiffness(system), 1.0, K);
    inverse_ = K.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
  }

  // Bounds a part from below, and says which of its links is loosest.
  void bound(const Plane& system, Part& part, double known) {
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
        const Direction d = part.x.col(link.i) - part.x.col(link.j);
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
      const detail::MinoriserBound result = dense_.bound(cones_, quadratic_);
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
    part.loosest = 0;
    int l = 0;
    for (const Link& link : system.links()) {
      const Direction d = part.x.col(link.i) - part.x.col(link.j);
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
    Points trial = part.x.template topRows<kDim>().template cast<Scalar>();
    const auto here = static_cast<double>(energy(system, trial));
    if (!(here < summary.final_energy * (1 + kPromising))) return;
    const Summary found = solver_.solve(system, trial);
    summary.add_work(found);
    if (!found.usable() || !(found.final_energy < summary.final_energy)) return;
    x = trial;
    summary.final_energy = found.final_energy;
    summary.gradient_norm = found.gradient_norm;
    summary.stationarity = found.stationarity;
    summary.positive_definite = found.positive_definite;
    is_done_ = is_done(system, x, summary);
  }

  // Also where there is no energy to speak of, of which no share could be proven.
  bool is_done(const System& system, const Points& x, const Summary& summary) {
    certifier_.options.gap = options.gap;
    return summary.is_within(options.gap) || certifier_.certify(system, x).certified();
  }

  static constexpr double kPromising = 0.05;

  Staircase<System, Auto<System>> staircase_;
  Auto<System> solver_;
  Certifier<System> certifier_;
  bool is_done_ = false;
  Cones cones_;
  detail::Minoriser<Cones> quadratic_;
  detail::DenseBound<Eigen::Dynamic, Eigen::Dynamic> dense_;
  Eigen::MatrixXd inverse_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
