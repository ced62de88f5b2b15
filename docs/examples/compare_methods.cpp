// Methods chosen by name and recorded iteration by iteration; one of them is defined here.
#include <asterism/solver.hpp>
#include <asterism/testing/random_system.hpp>
#include <cstdio>
#include <string>
#include <vector>

using System = asterism::SpringSystem<double, 2>;

/// Gradient descent, with a step that can never raise the energy.
struct Descent {
  using Points = System::Points;

  asterism::SolverOptions options;

  static constexpr std::string_view name() { return "gradient descent"; }

  asterism::Summary solve(const System& given, Points& x) {
    // The session checks the input, applies the common stopping rule and judges the result.
    return session_.run(name(), options, given, x, [&](const System& system, asterism::Summary& summary) {
      const double stiffest = node_stiffness(system).maxCoeff();
      while (true) {
        const Points g = gradient(system, x);
        ++summary.gradient_evaluations;
        if (session_.done(x, g, summary.iterations)) return asterism::Status::Converged;
        if (summary.iterations == options.max_iterations) return asterism::Status::MaxIterations;
        x -= g / (2 * stiffest);
        ++summary.iterations;
      }
    });
  }

 private:
  asterism::Session<System> session_;
};

int main() {
  asterism::testing::Rng rng(3);
  const auto problem = asterism::testing::random_system<System>(rng, asterism::Topology<>::full(6));

  auto solvers = asterism::solver_registry<System>();  // the library's own
  solvers.add<Descent>("descent");

  std::printf("%-8s  %10s  E after 0, 1, 2, 4, 8, 16 iterations\n", "method", "iterations");
  for (const std::string name : {"ida", "ncg", "lbfgs", "newton", "descent"}) {
    asterism::AnySolver<System> solver =
        solvers.make(name, {{"tolerance", 1e-6}, {"max_iterations", 100000}});
    std::vector<double> energies;
    auto record = [&](const asterism::Iteration& at) {
      energies.push_back(at.energy);
      return true;  // false ends the solve
    };
    solver.options().on_iteration = record;
    auto x = problem.start;
    const asterism::Summary summary = solver.solve(problem.system, x);
    std::printf("%-8s  %10d ", name.c_str(), summary.iterations);
    for (const std::size_t k : {0, 1, 2, 4, 8, 16}) {
      if (k < energies.size()) std::printf(" %8.2f", energies[k]);
    }
    std::printf("\n");
    if (!summary.usable()) return 1;
  }
}
