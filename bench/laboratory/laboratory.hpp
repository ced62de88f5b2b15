#pragma once

// Problems and solvers by name, for the experiments.

#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/iteration.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/testing/random_system.hpp>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "measure.hpp"

namespace asterism::bench {

using System = SpringSystem<double, 2>;
using Points = System::Points;
using Problem = testing::RandomSystem<System>;

/// When a solver stops.
struct Limits {
  double tolerance = 1e-8;  ///< as SolverOptions::tolerance
  int iterations = 100000;
  IterationCallback on_iteration = {};
};

/// A solver at work, with its workspace.
class Runner {
 public:
  virtual ~Runner() = default;

  /// Takes the problem, in the types that the solver is compiled for; must be called first. Throws
  /// std::invalid_argument if a type of fixed size has no room for its links, more than the pairs of nodes.
  virtual void load(const Problem& problem) = 0;

  /// Moves x from the problem's start. The library itself computes energies and status, for any solver.
  virtual Summary solve(const Limits& limits, Points& x) = 0;

  /// CPU time of one such solve with its setup [s], the mean of `repeats`.
  virtual double seconds(const Limits& limits, int repeats) = 0;
};

/// A solver that can be chosen by name.
struct SolverEntry {
  std::string name;     ///< as in --solvers
  std::string title;    ///< the name that the solver itself states
  std::string package;  ///< the package that it comes from, with the version
  /// The most nodes with which the experiments run it, as more would take minutes: in fully connected
  /// systems, and in systems of local links.
  int dense_nodes = 0;
  int sparse_nodes = 0;
  /// Makes a solver compiled for systems of this many nodes if there is one, else for any number.
  std::function<std::unique_ptr<Runner>(int nodes)> make;

  bool reaches(const System& system) const {
    const bool is_dense = 6L * system.link_count() >= 1L * system.nodes() * (system.nodes() - 1);
    return system.nodes() <= (is_dense ? dense_nodes : sparse_nodes);
  }
};

/// All solvers, in the order of their names.
const std::vector<SolverEntry>& solvers();
/// Those of a list such as "ida,newton", or "all". Throws std::invalid_argument that names the nearest known
/// one.
std::vector<SolverEntry> solvers_named(const std::string& list);

/// Registers a solver: a static object of this type in a file of bench/laboratory/solvers/ adds it to every
/// experiment.
struct Registration {
  explicit Registration(SolverEntry entry);
};

/// The runner of a solver that is compiled for systems of type Native.
template <typename Native>
class RunnerOf final : public Runner {
 public:
  explicit RunnerOf(AnySolver<Native> solver) : solver_(std::move(solver)) {}

  void load(const Problem& problem) override;
  Summary solve(const Limits& limits, Points& x) override;
  double seconds(const Limits& limits, int repeats) override;

 private:
  void set(const Limits& limits);

  AnySolver<Native> solver_;
  std::optional<Native> system_;
  typename Native::Points start_;
  typename Native::Points x_;
};

/// Systems of four nodes, a number fixed at compile time.
using FourNodes = SpringSystem<double, 2, 4>;
extern template class RunnerOf<System>;
extern template class RunnerOf<FourNodes>;

/// Factory of a solver that is compiled for any number of nodes: a class with `options` and `solve` like the
/// library's solvers.
template <typename Solver>
std::unique_ptr<Runner> make_runner(int) {
  return std::make_unique<RunnerOf<System>>(AnySolver<System>(Solver()));
}

/// The cost for a solver to come close to a minimum.
struct ToGap {
  int iterations = 0;  ///< -1 if it does not reach it
  double seconds = 0;  ///< CPU time of these iterations, setup included
  double minimum = 0;  ///< the energy that the gap is measured from
};

/// For the runner's problem, the fewest iterations after which the energy is within the relative `gap` of the
/// minimum to which the solver itself converges, and their time.
ToGap to_gap(Runner& runner, double gap);

/// CPU time of one solve [s], repeated until it takes a millisecond in all.
double steady_seconds(Runner& runner, const Limits& limits);

}  // namespace asterism::bench
