// The gradient method with momentum of Nesterov (1983), which starts afresh where the energy rises.
#include <algorithm>
#include <cmath>
#include <vector>

#include "solver_plugin.h"

static int minimise(const asterism_problem* problem, double* x) {
  const int n = problem->nodes;
  std::vector<double> stiffness(problem->anchor_stiffness, problem->anchor_stiffness + n);  // of each node
  for (int l = 0; l < problem->links; ++l)
    for (int end = 0; end < 2; ++end) stiffness[problem->ends[2 * l + end]] += 2 * problem->link_stiffness[l];

  std::vector<double> gradient(2 * n), at(x, x + 2 * n);
  double momentum = 1, last = INFINITY;
  for (int iteration = 0; iteration < problem->max_iterations; ++iteration) {
    const double energy = problem->evaluate(problem, at.data(), gradient.data());
    if (problem->iterated(problem)) break;
    if (energy > last) momentum = 1;
    last = energy;
    const double next = (1 + std::sqrt(1 + 4 * momentum * momentum)) / 2;
    for (int k = 0; k < 2 * n; ++k) {
      const double moved = stiffness[k / 2] > 0 ? at[k] - gradient[k] / stiffness[k / 2] : at[k];
      at[k] = moved + (momentum - 1) / next * (moved - x[k]);
      x[k] = moved;
    }
    momentum = next;
  }
  return 0;
}

const asterism_solver asterism_solver_plugin = {
    ASTERISM_SOLVER_VERSION, "nesterov", "gradient, Nesterov", 1000, 10000, minimise};
