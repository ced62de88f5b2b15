// Gradients through the solution: four nodes of a fixed size, batches of these, and many nodes with few
// links.
#include <algorithm>
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/batch_sensitivity.hpp>
#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <cstddef>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include "bars.hpp"

namespace asterism::bench {

namespace {

// A gradient of each system against its solve from its start, in turns.
void four_nodes(Bars& bars, testing::Kind kind) {
  using System = SpringSystem<double, 2, 4>;
  const auto systems = samples<System>(256, System::TopologyType::full(4), kind);
  std::vector<System::Points> minima;
  Newton<System> newton;
  Sensitivity<System> sensitivity;
  for (const auto& [system, start] : systems) {
    minima.push_back(start);
    newton.solve(system, minima.back());
  }
  const System::Points grad_x = System::Points::Ones(2, 4);
  std::vector<double> solves, gradients;
  double sum = 0;  // so that nothing is left out
  int refused = 0;
  for (int round = 0; round < (bars.quick() ? 11 : 101); ++round) {
    double begin = cpu_seconds();
    for (const auto& [system, start] : systems) {
      System::Points x = start;
      sum += newton.solve(system, x).final_energy;
    }
    solves.push_back((cpu_seconds() - begin) / static_cast<double>(systems.size()));
    begin = cpu_seconds();
    refused = 0;
    for (std::size_t s = 0; s < systems.size(); ++s) {
      const auto gradient = sensitivity.backward(systems[s].system, minima[s], grad_x);
      if (gradient) {
        sum += gradient.link_stiffness[0];
      } else {
        ++refused;
      }
    }
    gradients.push_back((cpu_seconds() - begin) / static_cast<double>(systems.size()));
  }
  const std::string name = kind == testing::Kind::Lit ? "N=4 LIT" : "N=4 TRACK";
  bars.at_most(name + ", gradient over Newton's solve", "%.3f",
               sum == sum ? median(gradients) / median(solves) : std::numeric_limits<double>::infinity(),
               1 / 3.0, 0.25);
  bars.line(name + ", gradient", format("%.0f ns", 1e9 * median(gradients)), "-", "-", true, true);
  bars.line(name + ", gradients refused", format("%d of %zu", refused, systems.size()), "-", "-", true, true);
}

// The gradients of a batch against its solve from the starts, in turns, on one thread.
template <typename Scalar>
void batch(Bars& bars, testing::Kind kind) {
  using Reference = SpringSystem<double, 2, 4>;
  using Batch = SpringBatch<Scalar, 2, 4>;
  const auto systems = samples<Reference>(bars.quick() ? 10000 : 100000, Topology<4>::full(), kind);
  Batch given(Topology<4>::full(), static_cast<int>(systems.size()));
  for (int s = 0; s < given.size(); ++s) {
    const auto& [system, start] = systems[static_cast<std::size_t>(s)];
    given.set(s, system, start);
  }
  BatchGradient<Batch> gradient(given);
  for (int i = 0; i < gradient.nodes(); ++i) {
    for (int axis = 0; axis < 2; ++axis) gradient.grad_x(i, axis).setOnes();
  }
  for (const Simd simd : available_simd()) {
    BatchNewton<Batch> solver;
    BatchSensitivity<Batch> sensitivity;
    solver.simd = sensitivity.simd = simd;
    BatchGradientSummary summary;
    std::vector<double> solves, gradients;
    for (int round = 0; round < 11; ++round) {
      Batch solved = given;
      double begin = cpu_seconds();
      solver.solve(solved);
      solves.push_back((cpu_seconds() - begin) / given.size());
      begin = cpu_seconds();
      summary = sensitivity.backward(solved, gradient);
      gradients.push_back((cpu_seconds() - begin) / given.size());
    }
    const std::string name = std::string("N=4 ") + (kind == testing::Kind::Lit ? "LIT" : "TRACK") +
                             " batch, " + std::string(to_string(simd)) +
                             (std::is_same_v<Scalar, double> ? ", double" : ", float");
    const double nanoseconds = 1e9 * median(gradients);
    if (simd == Simd::Avx512) {
      bars.at_most(name + ", gradient", "%.3g ns a system", nanoseconds, 60, 40);
    } else {
      bars.line(name + ", gradient", format("%.3g ns a system", nanoseconds), "-", "-", true, true);
    }
    bars.at_most("  over the batch's solve", "%.3f", median(gradients) / median(solves), 1 / 3.0, 0.25);
    bars.line("  scalar, refused",
              format("%d, %d of %d", summary.by_scalar, given.size() - summary.computed, given.size()), "-",
              "-", true, true);
  }
}

// With the ordering of the nodes known, as in an iteration.
void many_nodes(Bars& bars) {
  using System = SpringSystem<double, 2>;
  const int nodes = bars.quick() ? 10000 : 100000;
  auto [system, start] = testing::sparse_system<System>(1, nodes);
  AnySolver<System> newton = system_solver<System>("newton");
  Sensitivity<System> sensitivity;
  System::Points x = start;
  newton.solve(system, x);
  const System::Points grad_x = System::Points::Ones(2, nodes);
  sensitivity.backward(system, x, grad_x);
  std::vector<double> iterations, gradients;
  for (int round = 0; round < 3; ++round) {
    System::Points again = start;
    double begin = cpu_seconds();
    const int count = newton.solve(system, again).iterations;
    iterations.push_back((cpu_seconds() - begin) / std::max(1, count));
    begin = cpu_seconds();
    const bool computed = bool(sensitivity.backward(system, x, grad_x));
    gradients.push_back(computed ? cpu_seconds() - begin : std::numeric_limits<double>::infinity());
  }
  bars.at_most(format("N=%d sparse, gradient over an iteration of Newton's method", nodes), "%.2f",
               median(gradients) / median(iterations), 1, 0.8);
  bars.line(format("N=%d sparse, gradient", nodes), format("%.3g s", median(gradients)), "-", "-", true,
            true);
}

}  // namespace

void gradient_bars(Bars& bars) {
  if (!bars.wanted("gradient")) return;
  for (const testing::Kind kind : {testing::Kind::Lit, testing::Kind::Track}) four_nodes(bars, kind);
  for (const testing::Kind kind : {testing::Kind::Lit, testing::Kind::Track}) {
    batch<double>(bars, kind);
    batch<float>(bars, kind);
  }
  many_nodes(bars);
}

}  // namespace asterism::bench
