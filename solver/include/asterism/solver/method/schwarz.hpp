#pragma once

#include <algorithm>
#include <asterism/solver/detail/compiled.hpp>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/detail/partition.hpp>
#include <asterism/solver/detail/policy_name.hpp>
#include <asterism/solver/detail/spring_chunks.hpp>
#include <asterism/solver/energy/align.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/method/newton_cg.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/executor.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <new>
#include <optional>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of Schwarz.
using SchwarzOptions = ThreadedOptions;

namespace detail {

/// Copies the values of some nodes and links of `from` into `to`.
template <typename System>
void gather(const System& from, std::span<const int> nodes, std::span<const int> links, System& to) {
  to.loads.resize(System::kDim, from.has_loads() ? to.nodes() : 0);
  gather_functions(from.anchor_loss, nodes, to.anchor_loss);
  gather_functions(from.link_potential, links, to.link_potential);
  for (int k = 0; const int i : nodes) {
    to.anchors.col(k) = from.anchors.col(i);
    to.anchor_stiffness[k] = from.anchor_stiffness[i];
    if (from.has_loads()) to.loads.col(k) = from.loads.col(i);
    if constexpr (System::kAnisotropic) {
      constexpr int kDim = System::kDim;
      to.anchor_shape.template block<kDim, kDim>(0, kDim * k) =
          from.anchor_shape.template block<kDim, kDim>(0, kDim * i);
    }
    if (from.is_fixed(i)) {
      to.fix(k);
    } else {
      to.release(k);
    }
    ++k;
  }
  to.rest_offset.resize(System::kDim, from.has_offsets() ? to.link_count() : 0);
  for (int k = 0; const int l : links) {
    to.rest_length[k] = from.rest_length[l];
    if (from.has_offsets()) to.rest_offset.col(k) = from.rest_offset.col(l);
    if constexpr (System::kAnisotropicLinks) {
      constexpr int kDim = System::kDim;
      to.link_shape.template block<kDim, kDim>(0, kDim * k) =
          from.link_shape.template block<kDim, kDim>(0, kDim * l);
    }
    to.link_stiffness[k] = from.link_stiffness[l];
    ++k;
  }
}

/// A system with its nodes renumbered subdomain by subdomain, so that nodes that are near each other in the
/// constellation are near in memory, and the subsystems of the subdomains.
template <typename System>
class Decomposition {
 public:
  using Points = typename System::Points;

  /// Takes the values of `system`; divides its topology, on up to `threads` threads, if that differs from the
  /// last call's.
  void set(const System& system, int size, int threads = 1) {
    if (!is_cut_for(system)) cut(system, size, threads);
    gather(system, partition_.order, links_, *renumbered_);
  }

  const System& system() const { return *renumbered_; }
  int count() const { return partition_.count(); }

  /// The subdomains by color: the solves of those of one color do not read what the others write, so that
  /// they can be at the same time or in any order.
  int colors() const { return static_cast<int>(color_first_.size()) - 1; }
  std::span<const int> of_color(int color) const {
    return {by_color_.data() + color_first_[color], by_color_.data() + color_first_[color + 1]};
  }

  /// What a solve of a subdomain works with.
  class Scratch {
   public:
    /// To be called before the first solve, and after one that threw.
    void set(int nodes) { local_.assign(static_cast<std::size_t>(nodes), kOutside); }

   private:
    friend Decomposition;

    void enter(int i) {
      local_[i] = static_cast<int>(nodes_.size());
      nodes_.push_back(i);
    }
    void leave() {
      for (const int i : nodes_) local_[i] = kOutside;
    }

    Indexed<int> local_;  // a node's number in the present subsystem
    Indexed<int> nodes_;  // of the present subsystem: those that move, then those that are held
    Indexed<Link> links_;
    Indexed<int> link_numbers_;
  };

  Points renumbered(const Points& x) const {
    Points result(System::kDim, x.cols());
    for (int k = 0; const int i : partition_.order) result.col(k++) = x.col(i);
    return result;
  }
  template <typename Renumbered, typename Given>
  void restore(const Renumbered& renumbered, Given& x) const {
    for (int k = 0; const int i : partition_.order) x.col(i) = renumbered.col(k++);
  }

  /// Solves subdomain s of system(), extended by one layer of neighbours where that does not double it, with
  /// all other nodes held where they are. A neighbour that is linked to more nodes than the subdomain has
  /// stays outside: its neighbours, too, would have to be gathered for each subdomain that it is next to.
  template <typename Solver>
  Summary solve(int s, Solver& solver, Scratch& scratch, Points& x) const {
    const std::size_t moving = enter(s, scratch);
    const Indexed<int>& nodes = scratch.nodes_;
    scratch.links_.clear();
    scratch.link_numbers_.clear();
    for (std::size_t k = 0; k < moving; ++k) {
      const int here = static_cast<int>(k);
      for (const auto [node, link] : neighbours_.of(nodes[k])) {
        const int there = scratch.local_[node];
        if (there < here) continue;  // each link between two that move once
        scratch.links_.push_back({here, there});
        scratch.link_numbers_.push_back(link);
      }
    }
    scratch.leave();
    System sub(System::TopologyType::from_links(static_cast<int>(nodes.size()), scratch.links_));
    gather(*renumbered_, nodes, scratch.link_numbers_, sub);
    Points sub_x(System::kDim, sub.nodes());
    for (int k = 0; const int i : nodes) {
      sub_x.col(k) = x.col(i);
      if (k >= static_cast<int>(moving)) sub.fix(k);
      ++k;
    }
    const Summary summary = solver.solve(sub, sub_x);
    for (std::size_t k = 0; k < moving; ++k) x.col(nodes[k]) = sub_x.col(static_cast<int>(k));
    return summary;
  }

 private:
  static constexpr int kOutside = -1;

  bool is_cut_for(const System& system) const {
    if (!renumbered_ || renumbered_->nodes() != system.nodes() ||
        renumbered_->link_count() != system.link_count())
      return false;
    const auto links = system.links();
    for (int k = 0; const Link& link : renumbered_->links()) {
      if (Link{partition_.order[link.i], partition_.order[link.j]} !=
          links[static_cast<std::size_t>(links_[k++])])
        return false;
    }
    return true;
  }

  void cut(const System& system, int size, int threads) {
    const int n = system.nodes();
    const auto links = system.links();
    renumbered_.reset();
    partition_ = Partition(n, Neighbours(n, links), size);
    Indexed<int> number(static_cast<std::size_t>(n));
    for (int k = 0; const int i : partition_.order) number[i] = k++;

    // Links in the order of their lower node.
    Indexed<int> next(static_cast<std::size_t>(n) + 1, 0);
    const auto lower = [&number](const Link& link) { return std::min(number[link.i], number[link.j]); };
    for (const Link& link : links) ++next[lower(link)];
    int sum = 0;
    for (int& at : next) sum += std::exchange(at, sum);
    links_.resize(links.size());
    Indexed<Link> renumbered(links.size());
    for (int l = 0; const Link& link : links) {
      const int at = next[lower(link)]++;
      links_[at] = l++;
      renumbered[at] = {number[link.i], number[link.j]};
    }
    std::optional<System> made;  // renumbered_ is there only where all of it is
    for_each_task(std::min(threads, 2), 2, [&](int, int task) {
      if (task == 0) {
        neighbours_ = Neighbours(n, renumbered);
        color(n);
      } else {
        made.emplace(System::TopologyType::from_links(n, renumbered));
      }
    });
    renumbered_ = std::move(made);
  }

  // Gives each subdomain the first color that none has which moves a node that it reads, or reads one that it
  // moves. Colors are bits; a subdomain for which no bit is left has a color of its own.
  void color(int nodes) {
    constexpr int kBits = 32;
    Scratch scratch;
    scratch.set(nodes);
    Indexed<std::uint32_t> moved(static_cast<std::size_t>(nodes), 0);
    Indexed<std::uint32_t> read(static_cast<std::size_t>(nodes), 0);
    Indexed<int> color(static_cast<std::size_t>(count()));
    color_first_.assign(1, 0);
    int more = kBits;
    for (int s = 0; s < count(); ++s) {
      const std::size_t moving = enter(s, scratch);
      scratch.leave();
      std::uint32_t taken = 0;
      for (std::size_t k = 0; k < scratch.nodes_.size(); ++k) {
        const int i = scratch.nodes_[k];
        taken |= k < moving ? moved[i] | read[i] : moved[i];
      }
      color[s] = std::countr_one(taken);
      if (color[s] == kBits) {
        color[s] = more++;
      } else {
        const std::uint32_t bit = std::uint32_t{1} << color[s];
        for (std::size_t k = 0; k < scratch.nodes_.size(); ++k) {
          (k < moving ? moved : read)[scratch.nodes_[k]] |= bit;
        }
      }
      if (colors() <= color[s]) color_first_.resize(static_cast<std::size_t>(color[s]) + 2, 0);
      ++color_first_[color[s]];
    }
    int sum = 0;
    for (int& first : color_first_) sum += std::exchange(first, sum);
    by_color_.resize(color.size());
    Indexed<int> next(color_first_);
    for (int s = 0; s < count(); ++s) by_color_[next[color[s]]++] = s;
  }

  // Enters the nodes of subdomain s. Returns how many of them move; these are the first.
  std::size_t enter(int s, Scratch& scratch) const {
    Indexed<int>& nodes = scratch.nodes_;
    nodes.clear();
    for (int i = partition_.first[s]; i < partition_.first[s + 1]; ++i) scratch.enter(i);
    const auto core = nodes.size();
    add_layer(core, core, scratch);
    if (nodes.size() > 2 * core) {
      for (auto k = core; k < nodes.size(); ++k) scratch.local_[nodes[k]] = kOutside;
      nodes.resize(core);
    }
    const auto moving = nodes.size();
    add_layer(moving, std::numeric_limits<std::size_t>::max(), scratch);
    return moving;
  }

  // The neighbours of the first `count` nodes that have no more than `most` links themselves.
  void add_layer(std::size_t count, std::size_t most, Scratch& scratch) const {
    for (std::size_t k = 0; k < count; ++k) {
      for (const auto [node, link] : neighbours_.of(scratch.nodes_[k])) {
        if (scratch.local_[node] == kOutside && neighbours_.of(node).size() <= most) scratch.enter(node);
      }
    }
  }

  std::optional<System> renumbered_;
  Partition partition_;
  Indexed<int> links_;     // a renumbered link's number in the system given
  Neighbours neighbours_;  // by the new numbers
  Indexed<int> by_color_;  // subdomains
  Indexed<int> color_first_;
};

}  // namespace detail

/// Alternating minimisation over overlapping subdomains, for large sparse constellations (Schwarz's method
/// for minimisation: Tai & Espedal 1998), finished by a method for all nodes at once.
///
/// A large system is slow to solve not because of its size but because of its worst places: springs far from
/// their rest length, where the energy is not convex, limit the length of a step of all nodes together, and
/// more nodes have more such places. Here each subdomain, some hundred connected nodes and their neighbours,
/// is minimised by Newton-CG on its own, with the others held, so that each place takes the steps that it
/// needs, in cache. All of them are a sweep, which never raises the energy: color by color, as subdomains of
/// one color do not depend on each other, and can be minimised on several threads. When sweeps gain little,
/// `Global` (NewtonCg; SparseNewton where anchors are weak beside the links) has to correct what is smooth
/// over many subdomains, which Newton's method does in a few steps. Where it does not, sweeps and Global take
/// turns.
///
/// Time and memory of a sweep are O(nodes + links). Nodes are renumbered by subdomain, once a topology. An
/// object holds its workspace, one thread at a time; it uses the heap.
template <typename System, typename Global = NewtonCg<System>>
class Schwarz {
  static_assert(System::kMaxNodes == Eigen::Dynamic, "for systems without a bound on their nodes");

 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  SchwarzOptions options;

  Schwarz() = default;
  /// For type deduction: Schwarz(system).solve(system, x).
  explicit Schwarz(const System&, const SchwarzOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return detail::NameWithPolicy<kMethod, GlobalName>::value; }

  /// Moves x (Dim x N), the start, to a stationary point of the energy. A sweep and an iteration of Global
  /// are an iteration each; the other counts are of work on all nodes at once. Statuses as for Ida::solve;
  /// Summary::positive_definite is Global's.
  Summary solve(const System& given, Points& x) { return detail::Compiled::solve(*this, given, x); }

 private:
  friend detail::Compiled;

  Summary run(const System& given, Points& x);

  static constexpr std::string_view kMethod = "Schwarz";
  struct GlobalName {
    static constexpr std::string_view kName = Global::name();
  };
  static constexpr int kSubdomain = 300;           // nodes, without overlap
  static constexpr int kMaxSweeps = 8;             // in turn
  static constexpr double kFirstTolerance = 1e-2;  // of subdomains
  static constexpr int kFirstTurn = 4;             // iterations of Global; later ones are longer

  Status iterate(const System& system, Points& x, Summary& summary) {
    const auto report = [&](const Iteration& at) {  // Global knows neither the numbers of nodes nor of sweeps
      Eigen::MatrixXd given(at.x.rows(), at.x.cols());
      decomposition_.restore(at.x, given);
      session_.report({summary.iterations + at.number, at.energy, at.gradient_norm,
                       Eigen::Map<const Eigen::MatrixXd>(given.data(), given.rows(), given.cols())});
      return !session_.stopped();
    };
    static_cast<AlignedOptions&>(global_.options) = options;
    if constexpr (requires { global_.options.threads; }) global_.options.threads = options.threads;
    chunks_.set(system, detail::thread_count(options.threads));
    if (options.on_iteration) global_.options.on_iteration = report;
    // What is stationary to the renumbered sums has to be so to the given ones, too.
    global_.options.tolerance *= 0.9;
    // After the sweeps, x is close to a minimum.
    if constexpr (requires { global_.options.continuation; }) global_.options.continuation = false;
    local_.tolerance = kFirstTolerance;
    local_.max_iterations = 100;
    local_.stop = options.stop;
    for (int turn = kFirstTurn;; turn = std::min(2 * turn, 1 << 20)) {
      if (decomposition_.count() > 1) sweep(system, x, summary);
      const int left = options.max_iterations - summary.iterations;
      if (left == 0) return Status::MaxIterations;
      global_.options.max_iterations = std::min(turn, left);
      const Summary part = global_.solve(system, x);
      add(part, summary);
      if (part.status == Status::OutOfMemory) detail::raise(detail::LackOfMemory(part.message));
      if (part.status != Status::MaxIterations) return part.status;
    }
  }

  // Sweeps until one gains little. What the next changes anyhow need not be exact, but in the end each
  // subdomain is solved to its minimum: where one is left near a saddle, all would have to wait for it.
  void sweep(const System& system, Points& x, Summary& summary) {
    constexpr Scalar kLittle = Scalar(0.02);
    constexpr double kTighter = 1e-2;
    const double least = std::max(options.tolerance, 1e-7);
    Scalar before = chunks_.energy(system, x);
    ++summary.energy_evaluations;
    workers_.resize(
        static_cast<std::size_t>(std::min(detail::thread_count(options.threads), decomposition_.count())));
    for (Worker& worker : workers_) worker.scratch.set(system.nodes());
    for (int i = 0; i < kMaxSweeps && summary.iterations < options.max_iterations && !session_.stopped();
         ++i) {
      for (Worker& worker : workers_) worker.solver.options = local_;
      for (int color = 0; color < decomposition_.colors(); ++color) {
        const std::span<const int> subdomains = decomposition_.of_color(color);
        const auto minimise = [&](int w, int task) {
          Worker& worker = workers_[static_cast<std::size_t>(w)];
          const int s = subdomains[static_cast<std::size_t>(task)];
          if (decomposition_.solve(s, worker.solver, worker.scratch, x).status == Status::OutOfMemory)
            detail::raise(std::bad_alloc());
        };
        detail::for_each_task(static_cast<int>(workers_.size()), static_cast<int>(subdomains.size()),
                              minimise);
      }
      ++summary.iterations;
      if (options.align) detail::align(system, x, false);
      const Scalar after = chunks_.energy(system, x);
      ++summary.energy_evaluations;
      const bool exact = local_.tolerance <= least;
      if (exact && !(before - after > kLittle * detail::energy_scale(system, x, before))) return;
      local_.tolerance = std::max(least, kTighter * local_.tolerance);
      before = after;
    }
  }

  static void add(const Summary& part, Summary& summary) {
    summary.iterations += part.iterations;
    summary.energy_evaluations += part.energy_evaluations;
    summary.gradient_evaluations += part.gradient_evaluations;
    summary.linear_solves += part.linear_solves;
    summary.factorizations += part.factorizations;
    summary.positive_definite = part.positive_definite;
  }

  struct Worker {
    NewtonCg<System> solver;
    typename detail::Decomposition<System>::Scratch scratch;
  };

  Session<System> session_;
  detail::Decomposition<System> decomposition_;
  detail::SpringChunks<System> chunks_;
  std::vector<Worker> workers_;
  AlignedOptions local_;  // of the subdomains
  Global global_;
  Points renumbered_;
};

template <typename System, typename Global>
Summary Schwarz<System, Global>::run(const System& given, Points& x) {
  return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
    if (session_.done(x, session_.gradient(), 0)) return Status::Converged;
    if (options.max_iterations == 0) return Status::MaxIterations;
    decomposition_.set(system, kSubdomain, detail::thread_count(options.threads));
    renumbered_ = decomposition_.renumbered(x);
    const Status status = iterate(decomposition_.system(), renumbered_, summary);
    decomposition_.restore(renumbered_, x);
    return status;
  });
}

ASTERISM_COMPILED_SPARSE_SOLVER(Schwarz)

}  // namespace ASTERISM_ABI
}  // namespace asterism
