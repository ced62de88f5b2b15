// Barzilai and Borwein's gradient method: the length of a step fits the last change of the gradient.
#include <Eigen/Core>

#include "objective.hpp"

namespace asterism::bench {
namespace {

struct BarzilaiBorwein {
  static constexpr std::string_view name() { return "gradient, Barzilai-Borwein"; }

  static Status minimise(Objective& objective, const Points& start, int max_iterations, Summary& summary) {
    Eigen::VectorXd x(objective.size()), gradient(x.size()), last_x, last_gradient;
    objective.write(start, x.data());
    objective(x.data(), gradient.data());
    double step = 1;  // to the stiffest node's own minimum, as the objective is scaled
    while (!objective.done() && summary.iterations < max_iterations) {
      last_x = x;
      last_gradient = gradient;
      x -= step * gradient;
      objective(x.data(), gradient.data());
      objective.iterated();
      const double curvature = (x - last_x).dot(gradient - last_gradient);
      step = curvature > 0 ? (x - last_x).squaredNorm() / curvature : 1;
    }
    return Status::MaxIterations;
  }
};

using Solver = PeerSolver<BarzilaiBorwein>;
const Registration kEntry({"spectral", std::string(Solver::name()), "my own 1.0", 1000, 10000,
                           make_runner<Solver>});

}  // namespace
}  // namespace asterism::bench
