#include "laboratory.hpp"

#include <algorithm>
#include <asterism/solver/io/json.hpp>
#include <sstream>
#include <stdexcept>

namespace asterism::bench {

namespace {

std::vector<SolverEntry>& entries() {
  static std::vector<SolverEntry> all;  // filled by static objects of other files
  return all;
}

// Topology::full() if the links are its own, as some solvers are faster with it.
template <typename Topology>
Topology native_topology(const System& system) {
  const int n = system.nodes();
  if (system.link_count() == n * (n - 1) / 2) {
    Topology full = Topology::full(n);
    if (std::equal(full.links().begin(), full.links().end(), system.links().begin())) return full;
  }
  return Topology::from_links(n, system.links());
}

}  // namespace

template <typename Native>
void RunnerOf<Native>::load(const Problem& problem) {
  const System& system = problem.system;
  Native& native = system_.emplace(native_topology<typename Native::TopologyType>(system));
  if (native.link_count() != system.link_count())
    throw std::invalid_argument("more links than pairs of nodes, which this solver's type has no room for");
  native.anchors = system.anchors;
  native.anchor_stiffness = system.anchor_stiffness;
  native.rest_length = system.rest_length;
  native.link_stiffness = system.link_stiffness;
  native.rest_offset = system.rest_offset;
  native.loads = system.loads;
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) native.fix(i);
  }
  start_ = problem.start;
}

template <typename Native>
Summary RunnerOf<Native>::solve(const Limits& limits, Points& x) {
  set(limits);
  solver_.options().measure_seconds = true;
  x_ = start_;
  const Summary summary = solver_.solve(*system_, x_);
  x = x_;
  return summary;
}

template <typename Native>
double RunnerOf<Native>::seconds(const Limits& limits, int repeats) {
  set(limits);
  const double before = cpu_seconds();
  for (int r = 0; r < repeats; ++r) {
    x_ = start_;
    solver_.solve(*system_, x_);
  }
  return (cpu_seconds() - before) / repeats;
}

template <typename Native>
void RunnerOf<Native>::set(const Limits& limits) {
  SolverOptions& options = solver_.options();
  options.measure_seconds = false;
  options.tolerance = limits.tolerance;
  options.max_iterations = limits.iterations;
  options.on_iteration = limits.on_iteration;
}

template class RunnerOf<System>;
template class RunnerOf<FourNodes>;

Registration::Registration(SolverEntry entry) {
  auto& all = entries();
  const auto at = std::find_if(all.begin(), all.end(),
                               [&](const SolverEntry& other) { return other.name >= entry.name; });
  if (at != all.end() && at->name == entry.name) throw std::logic_error("two solvers named " + entry.name);
  all.insert(at, std::move(entry));
}

const std::vector<SolverEntry>& solvers() { return entries(); }

std::vector<SolverEntry> solvers_named(const std::string& list) {
  if (list == "all") return solvers();
  std::vector<SolverEntry> result;
  std::istringstream names(list);
  for (std::string name; std::getline(names, name, ',');) {
    const auto& all = solvers();
    const auto at =
        std::find_if(all.begin(), all.end(), [&](const SolverEntry& entry) { return entry.name == name; });
    if (at == all.end()) {
      std::vector<std::string> known;
      for (const SolverEntry& entry : all) known.push_back(entry.name);
      throw std::invalid_argument("unknown solver '" + name + "'" + detail::near_name(name, known) +
                                  detail::known_names(known));
    }
    result.push_back(*at);
  }
  if (result.empty()) throw std::invalid_argument("the list of solvers is empty");
  return result;
}

ToGap to_gap(Runner& runner, double gap) {
  constexpr int kMost = 100000;
  Points x;
  const auto energy_after = [&](int iterations, double tolerance) {
    return runner.solve({tolerance, iterations}, x).final_energy;
  };
  ToGap result;
  result.minimum = energy_after(kMost, 1e-10);
  const double target = (1 + gap) * result.minimum;
  int enough = 0, too_few = -1;
  while (energy_after(enough, 0) > target) {
    if (enough >= kMost) {
      result.iterations = -1;
      return result;
    }
    too_few = enough;
    enough = std::max(1, 2 * enough);
  }
  while (enough - too_few > 1) {
    const int middle = too_few + (enough - too_few) / 2;
    (energy_after(middle, 0) > target ? too_few : enough) = middle;
  }
  result.iterations = enough;
  result.seconds = steady_seconds(runner, {0, enough});
  return result;
}

double steady_seconds(Runner& runner, const Limits& limits) {
  int repeats = 1;
  while (true) {
    const double seconds = runner.seconds(limits, repeats);
    if (seconds * repeats >= 1e-3 || repeats > 1000000) return seconds;
    repeats = std::max(2 * repeats, static_cast<int>(1.2e-3 / std::max(seconds, 1e-9)));
  }
}

}  // namespace asterism::bench
