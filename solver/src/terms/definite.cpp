#include "definite.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

namespace {

// The largest rate at which an element turns, or grows, where the nodes at x have these velocities.
double turning_rate(const System& system, const Eigen::MatrixXd& x,
                    const Eigen::Ref<const Eigen::MatrixXd>& velocity) {
  double rate = 0;
  for (int t = 0; t < system.term_count(); ++t) {
    const auto& nodes = system.term(t).nodes();
    for (Eigen::Index e = 0; e < nodes.cols(); ++e) {
      for (Eigen::Index a = 0; a + 1 < nodes.rows(); ++a) {
        const int i = nodes(a, e), j = nodes(a + 1, e);
        const double speed = (velocity.col(i) - velocity.col(j)).norm();
        const double distance = (x.col(i) - x.col(j)).norm();
        if (distance > 0) rate = std::max(rate, speed / distance);
      }
    }
  }
  return rate;
}

}  // namespace

// By its least eigenvalue, from inverse iterations. The energy stays the same along a turn of rate w with
// velocities v = W x, so that v^T H v = -g . W v, which is at most w sum_i |g_i| |v_i|.
bool is_surely_definite(const System& system, const Eigen::MatrixXd& x, const Eigen::MatrixXd& gradient,
                        const SystemRule& rule, const SystemMatrix& hessian, const SystemFactor& factor) {
  constexpr double kRounding = 1e3 * std::numeric_limits<double>::epsilon();
  Eigen::VectorXd v(hessian.rows());
  for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = std::sin(static_cast<double>(i * i + 1));
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) v.segment(Eigen::Index{i} * system.dim(), system.dim()).setZero();
  }
  double least = 0;
  for (int iteration = 0; iteration < 2; ++iteration) {
    v.normalize();
    const Eigen::VectorXd next = factor.solve_all(v);
    least = 1 / v.dot(next);
    v = next;
  }
  v.normalize();
  // Where a spring is much shorter than at rest, the energy bends by more than its stiffness.
  double largest = rule.node_stiffness().maxCoeff();
  for (int i = 0; i < v.size(); ++i) largest = std::max(largest, std::abs(hessian.diagonal(i)));
  const Eigen::Map<const Eigen::MatrixXd> velocity(v.data(), system.dim(), system.nodes());
  const double forces = gradient.colwise().norm().dot(velocity.colwise().norm());
  // Parts that turn at other rates add what the nodes' velocities may not show.
  const double of_parts = rule.stationarity(gradient) * rule.node_stiffness().maxCoeff();
  return least > std::max({kRounding * largest, of_parts, 2 * turning_rate(system, x, velocity) * forces});
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
