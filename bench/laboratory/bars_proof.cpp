// Proofs of the global minimum: four nodes of a fixed size, in the plane and in space, and many nodes with
// few links.
#include <algorithm>
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/linear/sparse_cholesky.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/branch_and_bound.hpp>
#include <asterism/solver/method/make_solver.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "bars.hpp"

namespace asterism::bench {

namespace {

/// Solves a system from its start, its anchors and further starts displaced by up to half its characteristic
/// length, and calls found(x) with each result.
template <typename System, typename Found>
void search(const System& system, const typename System::Points& start, int starts, std::uint64_t seed,
            Found&& found) {
  testing::Rng rng(seed);
  Newton<System> newton;
  const double length = static_cast<double>(characteristic_length(system, start));
  for (int i = 0; i < starts; ++i) {
    typename System::Points x = i == 1 ? system.anchors : start;
    for (auto& coordinate : x.reshaped()) {
      if (i > 1) coordinate += static_cast<typename System::Scalar>(length * rng.uniform(-0.5, 0.5));
    }
    if (newton.solve(system, x).usable()) found(x);
  }
}

struct Counts {
  int systems = 0;
  int certified = 0;        // systems whose lowest minimum found is certified
  int first_certified = 0;  // systems whose result from their own start is certified
  int points = 0;           // minima, and points displaced from them, that were checked
  int false_certificates = 0;
  int violated_bounds = 0;
};

template <typename System>
void count_proofs(testing::Kind kind, int systems, Counts& counts) {
  using Points = typename System::Points;
  constexpr int kStarts = 30;
  constexpr double kClose = 1e-6;
  Certifier<System> certifier;
  for (int index = 0; index < systems; ++index) {
    const auto problem = testing::numbered_system<System>(kind, System::TopologyType::full(),
                                                          static_cast<std::uint64_t>(index));
    const System& system = problem.system;
    const Points& start = problem.start;
    std::vector<Points> minima;
    search(system, start, kStarts, static_cast<std::uint64_t>(index),
           [&](const Points& x) { minima.push_back(x); });
    if (minima.empty()) continue;
    ++counts.systems;
    counts.first_certified += certifier.certify(system, minima[0]).certified() ? 1 : 0;
    const auto exact = system.template cast<double>();
    const auto energy_of = [&exact](const Points& x) { return energy(exact, x.template cast<double>()); };
    const Points lowest =
        *std::min_element(minima.begin(), minima.end(),
                          [&](const Points& a, const Points& b) { return energy_of(a) < energy_of(b); });
    counts.certified += certifier.certify(system, lowest).certified() ? 1 : 0;
    const double least = energy_of(lowest);
    testing::Rng rng(~static_cast<std::uint64_t>(index));
    const double length = static_cast<double>(characteristic_length(system, start));
    const auto check = [&](const Points& x) {
      const Certificate certificate = certifier.certify(system, x);
      ++counts.points;
      counts.false_certificates += certificate.certified() && certificate.energy > (1 + kClose) * least;
      counts.violated_bounds += certificate.lower_bound > (1 + 1e-12) * least;
    };
    for (std::size_t i = 0; i < minima.size(); i += 6) {
      check(minima[i]);
      Points moved = minima[i];
      const double share = rng.uniform(0, 0.3);
      for (auto& coordinate : moved.reshaped())
        coordinate += static_cast<typename System::Scalar>(share * length * rng.uniform(-1, 1));
      check(moved);
    }
  }
}

void speed(Bars& bars, testing::Kind kind, const std::string& name) {
  using System = SpringSystem<double, 2, 4>;
  auto systems = samples<System>(1000, Topology<4>::full(), kind);
  const auto starts = systems;
  Newton<System> newton;
  Certifier<System> certifier;
  double solve = std::numeric_limits<double>::infinity(), certify = solve;
  int certified = 0;
  for (int round = 0; round < 20; ++round) {
    for (std::size_t i = 0; i < systems.size(); ++i) systems[i].start = starts[i].start;
    const double begin = cpu_seconds();
    for (auto& [system, x] : systems) newton.solve(system, x);
    const double solved = cpu_seconds();
    for (auto& [system, x] : systems) certified += certifier.certify(system, x).certified() ? 1 : 0;
    const double end = cpu_seconds();
    const auto count = static_cast<double>(systems.size());
    solve = std::min(solve, (solved - begin) / count);
    certify = std::min(certify, (end - solved) / count);
  }
  bars.at_most(name + " certify, mean", "%.3g us", certified > 0 ? 1e6 * certify : -1, 0.2, 0.1);
  bars.times_faster(name + " certify against Newton's solve, mean", certify, solve, 3, 6);
}

/// The staircase and several starts against the lowest minimum that 200 starts find.
void search_bars(Bars& bars, testing::Kind kind, const std::string& name) {
  using System = SpringSystem<double, 2, 4>;
  constexpr int kStarts = 200;
  constexpr double kClose = 1e-6;
  AnySolver<System> staircase = make_solver<System>("staircase");
  AnySolver<System> starts = make_solver<System>("multi-start");
  const int systems = bars.quick() ? 500 : 5000;
  int staircase_lowest = 0, starts_lowest = 0, false_bounds = 0;
  double staircase_seconds = 0, starts_seconds = 0;
  for (int index = 0; index < systems; ++index) {
    const auto [system, start] =
        testing::numbered_system<System>(kind, Topology<4>::full(), static_cast<std::uint64_t>(index));
    System::Points x = start, y = start;
    double begin = cpu_seconds();
    const Summary up = staircase.solve(system, x);
    staircase_seconds += cpu_seconds() - begin;
    begin = cpu_seconds();
    const Summary several = starts.solve(system, y);
    starts_seconds += cpu_seconds() - begin;
    double lowest = std::min(up.final_energy, several.final_energy);
    search(system, start, kStarts, static_cast<std::uint64_t>(index),
           [&, &s = system](const System::Points& z) { lowest = std::min(lowest, energy(s, z)); });
    staircase_lowest += up.final_energy <= (1 + kClose) * lowest ? 1 : 0;
    starts_lowest += several.final_energy <= (1 + kClose) * lowest ? 1 : 0;
    false_bounds += up.lower_bound > (1 + 1e-12) * lowest ? 1 : 0;
  }
  const auto share = [systems](int count) { return 100.0 * count / systems; };
  bars.at_least(name + ", staircase ends in the lowest of 200 starts", "%.2f %%", share(staircase_lowest),
                99.5, 100);
  bars.line(name + ", multi-start of 8", format("%.2f %%", share(starts_lowest)), "-", "-", true, true);
  bars.times_faster(name + " staircase against multi-start of 8", staircase_seconds, starts_seconds, 1, 2);
  bars.at_most(name + ", intervals of the staircase that are wrong", "%.0f", false_bounds, 0, 0);
}

/// Branch and bound on systems of four nodes, to a gap, in 10 ms each.
void interval_bars(Bars& bars, testing::Kind kind, const std::string& name, double gap) {
  using System = SpringSystem<double, 2, 4>;
  BranchAndBound<System> solver;
  solver.options.gap = gap;
  solver.options.max_nodes = std::numeric_limits<int>::max();
  solver.options.max_seconds = 0.01;
  AnySolver<System> staircase = make_solver<System>("staircase");
  const int systems = bars.quick() ? 500 : 5000;
  int open = 0, narrowed = 0;
  std::vector<double> seconds, nodes;
  for (int index = 0; index < systems; ++index) {
    const auto [system, start] =
        testing::numbered_system<System>(kind, Topology<4>::full(), static_cast<std::uint64_t>(index));
    System::Points x = start;
    if (staircase.solve(system, x).is_within(gap)) continue;
    ++open;
    x = start;
    const double begin = cpu_seconds();
    const Summary summary = solver.solve(system, x);
    seconds.push_back(cpu_seconds() - begin);
    nodes.push_back(summary.iterations);
    narrowed += summary.is_within(gap) ? 1 : 0;
  }
  bars.at_least(name + format(", within %g by staircase or branch and bound", gap), "%.2f %%",
                100.0 * (systems - open + narrowed) / systems, 99, 100);
  bars.line(name + format(", %d systems for branch and bound, median", open),
            format("%.0f nodes, %.2g ms", median(nodes), 1e3 * median(seconds)), "-", "-", true, true);
}

/// The intervals of the staircase for many parts, all of which are linked; its settings were chosen on
/// systems with lower numbers.
void many_part_bars(Bars& bars, int parts, double anchors, const std::string& name) {
  using System = SpringSystem<double, 2>;
  constexpr double kGap = 1e-3;
  constexpr std::uint64_t kFirst = 1000;
  constexpr double kSeconds = 0.05;
  AnySolver<System> staircase = make_solver<System>("staircase");
  staircase.options().gap = kGap;
  const int systems = bars.quick() ? 10 : 100;
  int narrow = 0, in_time = 0;
  std::vector<double> seconds;
  for (int index = 0; index < systems; ++index) {
    auto [system, x] = testing::numbered_system<System>(testing::Kind::Track, Topology<>::full(parts),
                                                        kFirst + static_cast<std::uint64_t>(index));
    system.anchor_stiffness *= anchors;
    const double begin = cpu_seconds();
    const bool is_narrow = staircase.solve(system, x).is_within(kGap);
    seconds.push_back(cpu_seconds() - begin);
    narrow += is_narrow ? 1 : 0;
    in_time += is_narrow && seconds.back() <= kSeconds ? 1 : 0;
  }
  bars.at_least(name + format(", within %g by the staircase", kGap), "%.0f %%", 100.0 * narrow / systems, 90,
                100);
  bars.information(name + ", of these in 50 ms of CPU time", format("%.0f %%", 100.0 * in_time / systems));
  bars.information(name + ", the staircase's time, median", format("%.1f ms", 1e3 * median(seconds)));
}

/// The intervals of the staircase for many nodes with local links; its settings were chosen on systems with
/// lower seeds.
void sparse_interval_bars(Bars& bars, double anchors, const std::string& name) {
  using System = SpringSystem<double, 2>;
  constexpr std::uint64_t kFirst = 11;
  AnySolver<System> staircase = make_solver<System>("staircase");
  double widest = 0, longest = 0;
  for (std::uint64_t seed = kFirst; seed < kFirst + (bars.quick() ? 1 : 6); ++seed) {
    auto [system, x] = testing::sparse_system<System>(seed, 10000);
    system.anchor_stiffness *= anchors;
    const double begin = cpu_seconds();
    const Summary summary = staircase.solve(system, x);
    longest = std::max(longest, cpu_seconds() - begin);
    widest = std::max(widest, 1 - summary.lower_bound / summary.final_energy);
  }
  bars.at_most(name + ", widest interval of the staircase", "%.2g", widest, 0.05, 0.01);
  bars.at_most(name + ", the staircase's longest CPU time", "%.1f s", longest, 10, 5);
}

/// What a proof in the lanes adds to the solve of a batch.
void batch_bars(Bars& bars, testing::Kind kind, const std::string& name) {
  using Batch = SpringBatch<double, 2, 4>;
  const auto systems = samples<Batch::System>(20000, Topology<4>::full(), kind);
  const double count = static_cast<double>(systems.size());
  double seconds[2] = {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  Batch batch(Topology<4>::full(), static_cast<int>(systems.size()));
  BatchNewton<Batch> newton;
  for (int round = 0; round < 20; ++round) {
    for (const bool prove : {false, true}) {
      for (int s = 0; s < batch.size(); ++s) {
        const auto& [system, start] = systems[static_cast<std::size_t>(s)];
        batch.set(s, system, start);
      }
      newton.options.gap = prove ? 1e-6 : 0;
      const double begin = cpu_seconds();
      newton.solve(batch);
      seconds[prove] = std::min(seconds[prove], cpu_seconds() - begin);
    }
  }
  const double proof = 1e9 * (seconds[1] - seconds[0]) / count;
  const std::string title = name + " proof in lanes of " + std::string(to_string(widest_simd()));
  if (widest_simd() == Simd::Avx512) {
    bars.at_most(title, "%.3g ns", proof, 25, 12);
  } else {
    bars.line(title, format("%.3g ns", proof), "-", "-", true, true);
  }
}

/// A certificate for many nodes with six links each, beside two factorisations of IDA's matrix. The ordering
/// is computed each time.
void sparse_bar(Bars& bars) {
  using System = SpringSystem<double, 2>;
  const int nodes = bars.large() ? 1000000 : 100000;
  auto [system, x] = testing::sparse_system<System>(1, nodes);
  Auto<System>().solve(system, x);
  double factor = std::numeric_limits<double>::infinity(), certify = factor;
  bool is_factored = true;
  Certificate certificate;
  for (int round = 0; round < 3; ++round) {
    const double begin = cpu_seconds();
    {
      SparseCholesky<System> cholesky;
      is_factored &= cholesky.factorize(system);
    }
    const double factored = cpu_seconds();
    certificate = Certifier<System>().certify(system, x);
    certify = std::min(certify, cpu_seconds() - factored);
    factor = std::min(factor, factored - begin);
  }
  const std::string name = format("%d nodes, six nearest: ", nodes);
  bars.times_faster(name + "certify against two factorisations of IDA", certify,
                    is_factored && certificate.lower_bound > 0 ? 2 * factor : 0, 1, 2);
  bars.line(name + "gap that it leaves", format("%.2g", certificate.gap()), "-", "-", true, true);
}

}  // namespace

void proof_bars(Bars& bars) {
  if (!bars.wanted("proof")) return;
  speed(bars, testing::Kind::Lit, "N=4 LIT");
  speed(bars, testing::Kind::Track, "N=4 TRACK");
  batch_bars(bars, testing::Kind::Lit, "N=4 LIT");
  batch_bars(bars, testing::Kind::Track, "N=4 TRACK");
  search_bars(bars, testing::Kind::Lit, "N=4 LIT");
  search_bars(bars, testing::Kind::Track, "N=4 TRACK");
  interval_bars(bars, testing::Kind::Lit, "N=4 LIT", 1e-2);
  interval_bars(bars, testing::Kind::Lit, "N=4 LIT", 1e-6);
  interval_bars(bars, testing::Kind::Track, "N=4 TRACK", 1e-3);
  interval_bars(bars, testing::Kind::Track, "N=4 TRACK", 1e-6);
  many_part_bars(bars, 100, 1, "N=100 TRACK");
  many_part_bars(bars, 100, 0.01, "N=100 TRACK, anchors x 0.01");
  sparse_interval_bars(bars, 1, "10000 nodes, six nearest");
  sparse_interval_bars(bars, 0.01, "10000 nodes, six nearest, anchors x 0.01");
  sparse_bar(bars);
  const int systems = bars.quick() ? 500 : 100000;
  Counts all;
  for (const testing::Kind kind : testing::kKinds) {
    Counts counts;
    count_proofs<SpringSystem<double, 2, 4>>(kind, systems, counts);
    const bool is_track = kind == testing::Kind::Track;
    const std::string name = "N=4 " + std::string(to_string(kind));
    const double share = 100.0 * counts.certified / counts.systems;
    const double first = 100.0 * counts.first_certified / counts.systems;
    if (is_track || kind == testing::Kind::Lit) {
      bars.at_least(name + ", lowest of 30 starts certified", "%.1f %%", share, is_track ? 95 : 83, 100);
    } else {
      bars.line(name + ", lowest of 30 starts certified", format("%.1f %%", share), "-", "-", true, true);
    }
    bars.line(name + ", the start's own minimum certified", format("%.1f %%", first), "-", "-", true, true);
    count_proofs<SpringSystem<float, 2, 4>>(kind, systems / 10, counts);
    Counts space;
    count_proofs<SpringSystem<double, 3, 4>>(kind, systems / 10, space);
    bars.line(name + " in space, lowest of 30 starts certified",
              format("%.1f %%", 100.0 * space.certified / space.systems), "-", "-", true, true);
    all.points += space.points;
    all.false_certificates += space.false_certificates;
    all.violated_bounds += space.violated_bounds;
    all.points += counts.points;
    all.false_certificates += counts.false_certificates;
    all.violated_bounds += counts.violated_bounds;
  }
  const std::string of = format("%d points: ", all.points);
  bars.at_most(of + "false certificates", "%.0f", all.false_certificates, 0, 0);
  bars.at_most(of + "lower bounds above an energy found", "%.0f", all.violated_bounds, 0, 0);
}

}  // namespace asterism::bench
