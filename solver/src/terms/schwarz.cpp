#include <algorithm>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/run/executor.hpp>
#include <bit>
#include <cstdint>
#include <limits>
#include <memory>
#include <new>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "matrix.hpp"
#include "methods.hpp"
#include "partition.hpp"
#include "run.hpp"
#include "stopping_rule.hpp"

// Schwarz's method: the minima of overlapping subdomains in turn.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

namespace {

using Points = Eigen::MatrixXd;

// Copies elements of a system's terms.
class Gatherer {
 public:
  explicit Gatherer(const System& from) : from_(&from) {
    for (int t = 0; t < from.term_count(); ++t) {
      const Term& term = from.term(t);
      std::unique_ptr<Term> empty = term.clone();
      empty->set_nodes(Eigen::MatrixXi(term.arity(), 0));
      for (const Column& column : term.columns()) {
        if (has_each(term, column)) empty->values(column.name).resize(column.values.rows(), 0);
      }
      empty_.push_back(std::move(empty));
    }
  }

  // A system of so many nodes of elements[t] of each term t; number[i] is what node i becomes.
  System operator()(int nodes, std::span<const std::vector<int>> elements, const Indexed<int>& number) const {
    System to(nodes, from_->dim());
    for (std::size_t t = 0; t < elements.size(); ++t) {
      if (!elements[t].empty()) to.add(gather(static_cast<int>(t), elements[t], number));
    }
    return to;
  }

  // Bytes of all elements.
  double bytes() const {
    double sum = 0;
    for (int t = 0; t < from_->term_count(); ++t) {
      const Term& term = from_->term(t);
      sum += sizeof(int) * static_cast<double>(term.nodes().size());
      for (const Column& column : term.columns()) {
        if (has_each(term, column)) sum += sizeof(double) * static_cast<double>(column.values.size());
      }
    }
    return sum;
  }

 private:
  // Whether a column has numbers for each element, not the same for all.
  static bool has_each(const Term& term, const Column& column) {
    return term.size() > 1 && column.values.cols() == term.size();
  }

  std::unique_ptr<Term> gather(int t, std::span<const int> elements, const Indexed<int>& number) const {
    const Term& term = from_->term(t);
    std::unique_ptr<Term> to = empty_[static_cast<std::size_t>(t)]->clone();
    const auto count = static_cast<Eigen::Index>(elements.size());
    Eigen::MatrixXi nodes(term.arity(), count);
    for (Eigen::Index k = 0; const int e : elements) {
      for (int a = 0; a < term.arity(); ++a) nodes(a, k) = number[term.nodes()(a, e)];
      ++k;
    }
    to->set_nodes(std::move(nodes));
    for (const Column& column : term.columns()) {
      if (!has_each(term, column)) continue;
      Eigen::MatrixXd& values = to->values(column.name);
      const Eigen::Index rows = column.values.rows();
      values.resize(rows, count);
      double* next = values.data();
      for (const int e : elements) next = std::copy_n(column.values.data() + rows * e, rows, next);
    }
    return to;
  }

  const System* from_;
  std::vector<std::unique_ptr<Term>> empty_;  // the terms without elements
};

// A system with its nodes renumbered subdomain by subdomain, so that nodes that are near each other in the
// constellation are near in memory, and the systems of the subdomains.
class Decomposition {
 public:
  Decomposition(const System& given, int size, int threads) : renumbered_(0, given.dim()) {
    incidence_ = Incidence(given);
    partition_ = Partition(incidence_, size);
    renumbered_ = renumber(given);
    incidence_ = Incidence(renumbered_);
    gatherer_ = std::make_unique<Gatherer>(renumbered_);
    workers_.resize(static_cast<std::size_t>(std::min(threads, std::max(1, count()))));
    for (Worker& worker : workers_)
      worker.number.assign(static_cast<std::size_t>(renumbered_.nodes()), kOutside);
    color();
    // With overlap, and the nodes' own memory.
    const double bytes = 3 * gatherer_->bytes() + 64.0 * renumbered_.nodes();
    if (count() < 2 || bytes > available_memory() / 2) return;
    std::vector<std::unique_ptr<Subdomain>> made(static_cast<std::size_t>(count()));
    for_each_task(static_cast<int>(workers_.size()), count(), [&](int w, int s) {
      made[static_cast<std::size_t>(s)] = std::make_unique<Subdomain>(make(s, worker(w)));
    });
    kept_ = std::move(made);
  }

  const System& system() const { return renumbered_; }
  int count() const { return partition_.count(); }
  Points renumbered(const Points& x) const {
    Points result(x.rows(), x.cols());
    for (int k = 0; const int i : partition_.order) result.col(k++) = x.col(i);
    return result;
  }
  template <typename Renumbered>
  Points restored(const Renumbered& renumbered) const {
    Points result(renumbered.rows(), renumbered.cols());
    for (int k = 0; const int i : partition_.order) result.col(i) = renumbered.col(k++);
    return result;
  }

  // Moves x, of system(), to a minimum over each subdomain in turn, with all other nodes held. Those of one
  // color do not read what the others write, so that several threads can solve them in any order.
  void sweep(const AlignedOptions& options, Points& x) {
    for (const std::vector<int>& subdomains : by_color_) {
      for_each_task(static_cast<int>(workers_.size()), static_cast<int>(subdomains.size()),
                    [&](int w, int task) {
                      const int s = subdomains[static_cast<std::size_t>(task)];
                      if (kept_.empty()) {
                        minimise(make(s, worker(w)), options, x);
                      } else {
                        minimise(*kept_[static_cast<std::size_t>(s)], options, x);
                      }
                    });
    }
  }

 private:
  static constexpr int kOutside = -1;

  struct Subdomain {
    System system;
    std::vector<int> nodes;  // those that move, then those that are held
    int moving;
  };

  struct Worker {
    void enter(int i) {
      number[i] = static_cast<int>(nodes.size());
      nodes.push_back(i);
    }
    void leave(std::size_t from = 0) {
      for (std::size_t k = from; k < nodes.size(); ++k) number[nodes[k]] = kOutside;
      nodes.resize(from);
    }

    Indexed<int> number;     // a node's number in the present subdomain
    std::vector<int> nodes;  // of the present subdomain
    std::vector<std::vector<int>> elements;
  };
  Worker& worker(int w) { return workers_[static_cast<std::size_t>(w)]; }

  static void minimise(const Subdomain& subdomain, const AlignedOptions& options, Points& x) {
    Points points(x.rows(), static_cast<Eigen::Index>(subdomain.nodes.size()));
    for (int k = 0; const int i : subdomain.nodes) points.col(k++) = x.col(i);
    const Summary summary = SystemNewtonCg{options}.solve(subdomain.system, points);
    if (summary.status == Status::OutOfMemory) raise(std::bad_alloc());
    for (int k = 0; k < subdomain.moving; ++k)
      x.col(subdomain.nodes[static_cast<std::size_t>(k)]) = points.col(k);
  }

  System renumber(const System& given) const {
    Indexed<int> number(static_cast<std::size_t>(given.nodes()));
    for (int k = 0; const int i : partition_.order) number[i] = k++;
    std::vector<std::vector<int>> elements(static_cast<std::size_t>(given.term_count()));
    for (const int i : partition_.order) add_elements(i, number, elements);
    System result = Gatherer(given)(given.nodes(), elements, number);
    for (int i = 0; i < given.nodes(); ++i) {
      if (given.is_fixed(i)) result.fix(number[i]);
    }
    return result;
  }

  // Adds the elements of a node that no node of a lower number has.
  void add_elements(int node, const Indexed<int>& number, std::vector<std::vector<int>>& elements) const {
    for (const Incidence::Element& element : incidence_.of(node)) {
      const std::span<const int> nodes = incidence_.nodes_of(element);
      if (std::any_of(nodes.begin(), nodes.end(), [&](int other) { return number[other] < number[node]; }))
        continue;
      std::vector<int>& of_term = elements[static_cast<std::size_t>(element.term)];
      if (of_term.empty() || of_term.back() != element.number) of_term.push_back(element.number);
    }
  }

  // The system of subdomain s: of all elements that have one of the nodes that move.
  Subdomain make(int s, Worker& worker) const {
    const int moving = enter(s, worker);
    worker.elements.resize(static_cast<std::size_t>(renumbered_.term_count()));
    for (std::vector<int>& of_term : worker.elements) of_term.clear();
    for (int k = 0; k < moving; ++k)
      add_elements(worker.nodes[static_cast<std::size_t>(k)], worker.number, worker.elements);
    Subdomain result{(*gatherer_)(static_cast<int>(worker.nodes.size()), worker.elements, worker.number),
                     worker.nodes, moving};
    worker.leave();
    for (int k = 0; const int i : result.nodes) {
      if (k >= moving || renumbered_.is_fixed(i)) result.system.fix(k);
      ++k;
    }
    return result;
  }

  // Enters the nodes of subdomain s, extended by one layer of neighbours where that does not double it, and
  // the nodes next to them. Returns how many of them move; these are the first. A neighbour with more
  // elements than the subdomain has nodes stays outside: its neighbours, too, would have to be gathered for
  // each subdomain that it is next to.
  int enter(int s, Worker& worker) const {
    worker.nodes.clear();
    for (int i = partition_.first[s]; i < partition_.first[s + 1]; ++i) worker.enter(i);
    const std::size_t core = worker.nodes.size();
    add_layer(core, core, worker);
    if (worker.nodes.size() > 2 * core) worker.leave(core);
    const std::size_t moving = worker.nodes.size();
    add_layer(moving, std::numeric_limits<std::size_t>::max(), worker);
    return static_cast<int>(moving);
  }

  // The neighbours of the first `count` nodes that have no more than `most` elements themselves.
  void add_layer(std::size_t count, std::size_t most, Worker& worker) const {
    for (std::size_t k = 0; k < count; ++k) {
      for (const Incidence::Element& element : incidence_.of(worker.nodes[k])) {
        for (const int node : incidence_.nodes_of(element)) {
          if (worker.number[node] == kOutside && incidence_.of(node).size() <= most) worker.enter(node);
        }
      }
    }
  }

  // Gives each subdomain the first color that none has which moves a node that it reads, or reads one that it
  // moves. Colors are bits; a subdomain for which no bit is left has a color of its own.
  void color() {
    constexpr int kBits = 32;
    Indexed<std::uint32_t> moved(static_cast<std::size_t>(renumbered_.nodes()), 0), read(moved);
    Worker& worker = workers_[0];
    int more = kBits;
    for (int s = 0; s < count(); ++s) {
      const int moving = enter(s, worker);
      std::uint32_t taken = 0;
      for (int k = 0; const int i : worker.nodes) taken |= k++ < moving ? moved[i] | read[i] : moved[i];
      int color = std::countr_one(taken);
      if (color == kBits) {
        color = more++;
      } else {
        for (int k = 0; const int i : worker.nodes)
          (k++ < moving ? moved : read)[i] |= std::uint32_t{1} << color;
      }
      worker.leave();
      if (static_cast<int>(by_color_.size()) <= color) by_color_.resize(static_cast<std::size_t>(color) + 1);
      by_color_[static_cast<std::size_t>(color)].push_back(s);
    }
  }

  Partition partition_;
  System renumbered_;
  Incidence incidence_;  // of the given system at first, then of renumbered_
  std::unique_ptr<Gatherer> gatherer_;
  std::vector<Worker> workers_;
  std::vector<std::vector<int>> by_color_;        // subdomains
  std::vector<std::unique_ptr<Subdomain>> kept_;  // none where memory does not suffice for all
};

// A method for all nodes, which finishes what sweeps began.
using Global = Summary (*)(const AlignedOptions& options, const System& system, Points& x);

class SchwarzSolve {
 public:
  SchwarzSolve(const ThreadedOptions& options, SystemRun& run)
      : options_(options),
        summary_(run.summary()),
        decomposition_(run.system(), kSubdomain, thread_count(options.threads)),
        x_(decomposition_.renumbered(run.x())) {
    local_.tolerance = 1e-2;
    local_.max_iterations = 100;
    local_.stop = options.stop;
    local_.align = false;
  }

  Status iterate(Global global) {
    constexpr int kFirstTurn = 4;                   // iterations of `global`; later turns are longer
    int told = 0;                                   // the last iterate that was reported: the start
    const auto report = [&](const Iteration& at) {  // `global` knows no numbers of nodes, and no sweeps
      const int number = summary_.iterations + at.number;
      if (number == told) return true;
      told = number;
      const Points given = decomposition_.restored(at.x);
      return options_.on_iteration(
          {number, at.energy, at.gradient_norm, {given.data(), given.rows(), given.cols()}});
    };
    AlignedOptions options = options_;
    if (options_.on_iteration) options.on_iteration = report;
    options.tolerance *= 0.9;       // so that it is also reached by the sums in the given order
    options.hold_floating = false;  // their nodes are fixed already
    for (int turn = kFirstTurn;; turn = std::min(2 * turn, 1 << 20)) {
      if (decomposition_.count() > 1) sweep();
      const int left = options_.max_iterations - summary_.iterations;
      if (left == 0) return Status::MaxIterations;
      if (options_.stopped()) return Status::Interrupted;
      options.max_iterations = std::min(turn, left);
      const Summary part = global(options, decomposition_.system(), x_);
      summary_.add_work(part);
      if (part.status == Status::OutOfMemory) raise(LackOfMemory(part.message));
      if (part.status != Status::MaxIterations) return part.status;
    }
  }

  Points x() const { return decomposition_.restored(x_); }

 private:
  static constexpr int kSubdomain = 300;  // nodes, without overlap

  // Sweeps until one gains little. What the next changes anyhow need not be exact, but in the end each
  // subdomain is solved to its minimum: where one is left near a saddle, all would have to wait for it.
  void sweep() {
    constexpr double kLittle = 0.02, kTighter = 1e-2;
    constexpr int kMaxSweeps = 8;  // in turn
    const System& system = decomposition_.system();
    const double least = std::max(options_.tolerance, 1e-7);
    double before = energy(system, x_);
    ++summary_.energy_evaluations;
    for (int i = 0; i < kMaxSweeps && summary_.iterations < options_.max_iterations && !options_.stopped();
         ++i) {
      decomposition_.sweep(local_, x_);
      ++summary_.iterations;
      const double after = energy(system, x_);
      ++summary_.energy_evaluations;
      const bool is_exact = local_.tolerance <= least;
      if (is_exact && !(before - after > kLittle * energy_scale(system, x_, before))) return;
      local_.tolerance = std::max(least, kTighter * local_.tolerance);
      before = after;
    }
  }

  const ThreadedOptions& options_;
  Summary& summary_;
  Decomposition decomposition_;
  Points x_;
  AlignedOptions local_;  // of the subdomains
};

// Whether the elements of a term share an unknown, which depends on all of them and leaves no subdomains.
bool is_coupled(const System& system) {
  for (int t = 0; t < system.term_count(); ++t) {
    if (system.term(t).size() > 0 && system.term(t).has_hidden()) return true;
  }
  return false;
}

Summary solve_schwarz(std::string_view name, const ThreadedOptions& options, const System& system, Points& x,
                      Global global) {
  if (const char* problem = options.problem()) return refused(name, problem);
  if (is_coupled(system)) {
    Summary whole = global(options, system, x);
    whole.solver = name;
    whole.positive_definite.reset();
    return whole;
  }
  AlignedOptions of_run = options;
  const auto report = [&options](const Iteration& at) {  // the start; later ones are those of `global`
    return at.number > 0 || options.on_iteration(at);
  };
  if (options.on_iteration) of_run.on_iteration = report;
  return SystemRun::solve(name, of_run, system, x, [&](SystemRun& run) {
    if (const std::string missing = missing_curvature(run.system(), Curvature::True); !missing.empty()) {
      run.summary().message = std::string_view("the method needs second derivatives: " + missing);
      return Status::InvalidInput;
    }
    if (run.is_over()) return run.end();
    SchwarzSolve solve(options, run);
    const Status status = solve.iterate(global);
    run.move_to(solve.x());
    // Whether the tolerance or the gap is reached is asked here once more.
    return run.is_over() && run.end() == Status::Converged ? run.end() : status;
  });
}

}  // namespace

template <typename Global>
Summary SystemSchwarz<Global>::solve(const System& system, Eigen::MatrixXd& x) const {
  return solve_schwarz(name(), options, system, x,
                       [](const AlignedOptions& of_global, const System& renumbered, Points& points) {
                         Global solver{of_global};
                         // After the sweeps, x is close to a minimum.
                         if constexpr (requires { solver.options.continuation; })
                           solver.options.continuation = false;
                         return solver.solve(renumbered, points);
                       });
}

template struct SystemSchwarz<SystemNewtonCg>;
template struct SystemSchwarz<SystemNewton>;

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
