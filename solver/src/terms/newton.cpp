#include <algorithm>
#include <asterism/solver/detail/finite.hpp>
#include <cmath>
#include <limits>

#include "loss.hpp"
#include "matrix.hpp"
#include "methods.hpp"
#include "run.hpp"

// Newton's method with a factored Hessian.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

namespace {

// Moves x down from a saddle along v, of negative curvature, over all unknowns: to the first of ever shorter
// steps to either side that lowers the energy by a tenth of what the curvature promises. False if none does.
bool leave_saddle(SystemRun& run, const Eigen::VectorXd& v, double curvature) {
  Eigen::MatrixXd direction = v.head(run.x().size()).reshaped(run.x().rows(), run.x().cols());
  const double scale = run.rule().length() / direction.colwise().norm().maxCoeff();
  if (!is_finite(scale)) return false;
  direction *= scale;
  curvature *= scale * scale;
  constexpr int kMaxHalvings = 40;
  double t = 0.5;
  for (int halving = 0; halving < kMaxHalvings; ++halving, t /= 2) {
    const Eigen::MatrixXd ahead = run.x() + t * direction, behind = run.x() - t * direction;
    const double energy_ahead = energy(run.system(), ahead), energy_behind = energy(run.system(), behind);
    run.summary().energy_evaluations += 2;
    const double lowest = std::min(energy_ahead, energy_behind);
    if (!(lowest < run.energy() + t * t * curvature / 20) || !is_finite(lowest)) continue;
    if (!(lowest < run.energy() - 4 * std::numeric_limits<double>::epsilon() * std::abs(run.energy())))
      return false;
    run.move_to(energy_ahead <= energy_behind ? ahead : behind);
    return true;
  }
  return false;
}

}  // namespace

Summary SystemNewton::solve(const System& system, Eigen::MatrixXd& x) const {
  return SystemRun::solve(name(), options, system, x, [](SystemRun& run) {
    if (run.lacks_hessian()) return Status::InvalidInput;
    constexpr double kLeastShare = 1e-9, kMostShare = 1e3;
    constexpr int kMaxEscapes = 50;
    SystemMatrix matrix(SystemMatrix::Storage::Best), clamped(SystemMatrix::Storage::Best);
    SystemFactor factor, clamped_factor;
    double share = 1e-3;  // of the nodes' stiffness
    int escapes = 0;
    while (true) {
      const bool is_over = run.is_over();
      if (is_over && run.end() != Status::Converged) return run.end();
      matrix.assemble(run.system(), run.x(), Curvature::True);
      ++run.summary().factorizations;
      const bool is_definite = factor.factorize(matrix);
      if (is_over) {
        run.summary().positive_definite = is_definite ? 1 : 0;
        if (is_definite || !run.rule().reached(run.gradient()) || escapes == kMaxEscapes) return run.end();
        const Eigen::VectorXd v = factor.negative_direction(matrix);
        if (v.size() == 0) return run.end();
        const double curvature = v.dot(matrix * v);
        // What rounding may have made of a free motion is none.
        const double scale =
            v.cwiseAbs2().head(run.x().size()).sum() * run.rule().node_stiffness().maxCoeff();
        if (!(curvature < -1e-9 * scale) || !leave_saddle(run, v, curvature)) return run.end();
        ++escapes;
        ++run.summary().iterations;
        continue;
      }
      double step = 1;
      ++run.summary().linear_solves;
      if (is_definite) {
        const Eigen::MatrixXd direction = -factor.solve(run.gradient());
        if (run.trusted_step(direction) == 1 && run.search(direction, step)) {
          ++run.summary().iterations;
          continue;
        }
      }
      bool has_moved = false, is_whole = false;
      while (!has_moved) {
        clamped.assemble(run.system(), run.x(), Curvature::Clamped);
        clamped.shift(run.rule().node_stiffness(), share);
        ++run.summary().factorizations, ++run.summary().linear_solves;
        if (clamped_factor.factorize(clamped)) {
          const Eigen::MatrixXd direction = -clamped_factor.solve(run.gradient());
          const double first = step = run.trusted_step(direction);
          has_moved = run.search(direction, step);
          is_whole = has_moved && step == first;
        }
        // A step that was not cut short was trusted too little.
        share = std::max(is_whole ? share / 10 : share * 4, kLeastShare);
        if (!has_moved && share > kMostShare) return Status::NoProgress;
      }
      share = std::min(share, 1.0);
      ++run.summary().iterations;
    }
  });
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
