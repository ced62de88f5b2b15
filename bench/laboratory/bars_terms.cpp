// Systems of terms against the same systems as templates.
#include <algorithm>
#include <asterism/solver.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/system.hpp>
#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "bars.hpp"
#include "measure.hpp"

namespace asterism::bench {

namespace {

using Springs = SpringSystem<double, 2>;
using Sample = testing::RandomSystem<Springs>;

// How many times as long the second function takes, by turns: the median of nine rounds of a hundredth of a
// second.
template <typename A, typename B>
double ratio(A&& a, B&& b) {
  const auto seconds = [](auto&& f, int calls) {
    const double begin = cpu_seconds();
    for (int call = 0; call < calls; ++call) f();
    return (cpu_seconds() - begin) / calls;
  };
  constexpr double kRound = 0.01;
  const auto calls = [&](auto&& f) {
    return std::max(1, static_cast<int>(kRound / std::max(seconds(f, 3), 1e-9)));
  };
  const int of_a = calls(a), of_b = calls(b);
  std::vector<double> ratios;
  for (int round = 0; round < 9; ++round) {
    const double first = seconds(a, of_a);
    ratios.push_back(seconds(b, of_b) / first);
  }
  return median(ratios);
}

double energy_ratio(const Sample& sample) {
  const System system = to_system(sample.system);
  const Eigen::MatrixXd y = sample.start;
  Springs::Points gradient = sample.start;
  Eigen::MatrixXd of_terms = y;
  return ratio([&] { energy_and_gradient(sample.system, sample.start, gradient); },
               [&] { energy_and_gradient(system, y, of_terms); });
}

template <typename Solver>
double solve_ratio(const Sample& sample, std::string_view method) {
  const System system = to_system(sample.system);
  Solver solver;
  Springs::Points x = sample.start;
  Eigen::MatrixXd y = x;
  return ratio([&] { solver.solve(sample.system, x = sample.start); },
               [&] { solve(method, system, y = sample.start); });
}

}  // namespace

void terms_bars(Bars& bars) {
  if (!bars.wanted("terms")) return;
  for (const int nodes : {4, 16, 64, 300}) {
    const Sample sample = samples<Springs>(1, Topology<>::full(nodes), testing::Kind::Lit).front();
    const std::string name = format("N=%d terms against springs, ", nodes);
    bars.at_most(name + "E and gradient", "%.2f x", energy_ratio(sample), 1.03, 1);
    if (nodes <= 64)
      bars.at_most(name + "Newton", "%.2f x", solve_ratio<Newton<Springs>>(sample, "newton"), 1.03, 1);
    bars.at_most(name + "L-BFGS", "%.2f x", solve_ratio<Lbfgs<Springs>>(sample, "lbfgs"), 1.03, 1);
  }
  for (const int nodes : {1000, 30000}) {
    if (bars.quick() && nodes > 1000) break;
    const Sample sample = testing::sparse_system<Springs>(1, nodes);
    const std::string name = format("n=%d sparse terms against springs, ", nodes);
    bars.at_most(name + "E and gradient", "%.2f x", energy_ratio(sample), 1.03, 1);
  }
}

}  // namespace asterism::bench
