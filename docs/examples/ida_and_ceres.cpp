// Draws how fast IDA and Ceres lower the energy of one system: ida_and_ceres.svg.
#include <algorithm>
#include <asterism/solver.hpp>
#include <asterism/solver/reference/ceres.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <fstream>
#include <iostream>

using System = asterism::SpringSystem<double, 2>;

int main() {
  asterism::testing::Rng rng(1);
  const auto problem = asterism::testing::random_system<System>(rng, asterism::Topology<>::full(9));
  auto solvers = asterism::solver_registry<System>();
  asterism::reference::add_ceres(solvers);

  constexpr int kIterations = 30;
  std::ofstream svg("ida_and_ceres.svg");
  svg << "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 640 400' font-family='sans-serif'>"
         "<rect width='640' height='400' fill='white'/><path d='M40 20V360H620' fill='none' stroke='gray'/>"
         "<text x='45' y='30'>log E / E after the alignment</text><text x='540' y='380'>iterations</text>";
  int line = 0;
  for (const char* name : {"ida", "ceres-sparse", "ceres-lbfgs"}) {
    asterism::AnySolver<System> solver = solvers.make(name, {{"max_iterations", kIterations}});
    const char* color = line == 0 ? "black" : line == 1 ? "orangered" : "steelblue";
    svg << "<polyline fill='none' stroke='" << color << "' points='";
    double first = 0;
    auto draw = [&](const asterism::Iteration& at) {
      if (at.number == 0) first = at.energy;
      const double decades = std::log10(std::max(at.energy / first, 1e-4));
      svg << 40 + 580.0 * at.number / kIterations << ',' << 40 - 80 * decades << ' ';
      return true;
    };
    solver.options().on_iteration = draw;
    auto x = problem.start;
    std::cout << solver.solve(problem.system, x) << "\n";
    svg << "'/><text x='480' y='" << 60 + 20 * line++ << "' fill='" << color << "'>" << name << "</text>";
  }
  svg << "</svg>\n";
  return svg.good() ? 0 : 1;
}
