#include <algorithm>
#include <asterism/solver/detail/finite.hpp>
#include <cmath>
#include <limits>

#include "lbfgs_pairs.hpp"
#include "matrix.hpp"
#include "methods.hpp"
#include "run.hpp"

// Methods that need the gradient alone, and a matrix that stays as it is: IDA, L-BFGS and nonlinear CG.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

namespace {

// -A^-1 v for the nodes' stiffness A.
Eigen::MatrixXd scaled(const SystemRun& run, const Eigen::MatrixXd& v) {
  return -v * run.rule().node_stiffness().cwiseInverse().asDiagonal();
}

// The inverse of IDA's matrix, or of what stands for it.
class Metric {
 public:
  explicit Metric(SystemRun& run) : run_(run) {
    const System& system = run.system();
    if (!missing_curvature(system, Curvature::True).empty()) return;
    const bool is_majoriser = missing_curvature(system, Curvature::Majorising).empty();
    matrix_.assemble(system, run.x(), is_majoriser ? Curvature::Majorising : Curvature::Clamped);
    if (!is_majoriser) matrix_.shift(run.rule().node_stiffness(), kShare);
    ++run.summary().factorizations;
    is_factored_ = factor_.factorize(matrix_);
  }

  Eigen::MatrixXd descent(const Eigen::MatrixXd& gradient) const {
    if (!is_factored_) return scaled(run_, gradient);
    ++run_.summary().linear_solves;
    return -factor_.solve(gradient);
  }

 private:
  static constexpr double kShare = 1e-3;

  SystemRun& run_;
  SystemMatrix matrix_{SystemMatrix::Storage::Best};
  SystemFactor factor_;
  bool is_factored_ = false;
};

double dot(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) { return a.cwiseProduct(b).sum(); }

}  // namespace

Summary SystemIda::solve(const System& system, Eigen::MatrixXd& x) const {
  return SystemRun::solve(name(), options, system, x, [](SystemRun& run) {
    if (const std::string missing = missing_curvature(run.system(), Curvature::Majorising);
        !missing.empty()) {
      run.summary().message = std::string_view("the method needs a majoriser: " + missing);
      return Status::InvalidInput;
    }
    SystemMatrix matrix(SystemMatrix::Storage::Best);
    SystemFactor factor;
    matrix.assemble(run.system(), run.x(), Curvature::Majorising);
    ++run.summary().factorizations;
    if (!factor.factorize(matrix)) {
      run.summary().message =
          "K_dyn is not positive definite: the anchors are too weak compared with the springs";
      return Status::NumericalFailure;
    }
    while (!run.is_over()) {
      const Eigen::MatrixXd step = -factor.solve(run.gradient());  // Eq. (9) of the paper
      ++run.summary().linear_solves;
      run.move_to(run.x() + step);
      ++run.summary().iterations;
    }
    return run.end();
  });
}

Summary SystemLbfgs::solve(const System& system, Eigen::MatrixXd& x) const {
  return SystemRun::solve(name(), options, system, x, [](SystemRun& run) {
    LbfgsPairs pairs;
    const Metric metric(run);
    const auto descent = [&metric](const Eigen::MatrixXd& v) { return metric.descent(v); };
    while (!run.is_over()) {
      const Eigen::MatrixXd direction = pairs.direction(run.gradient(), descent);
      const double slope = dot(run.gradient(), direction);
      double step = 1;
      if (!(slope < 0) || !run.search(direction, step)) {
        if (pairs.empty()) return Status::NoProgress;
        pairs.clear();
        continue;
      }
      ++run.summary().iterations;
      pairs.add(step * direction, run.gradient() - run.previous_gradient(), step * slope);
    }
    return run.end();
  });
}

Summary SystemCg::solve(const System& system, Eigen::MatrixXd& x) const {
  return SystemRun::solve(name(), options, system, x, [](SystemRun& run) {
    Eigen::MatrixXd descent = scaled(run, run.gradient()), direction = descent;
    double step = 1, slope = dot(run.gradient(), direction);
    bool is_restart = true;
    while (!run.is_over()) {
      if (!run.search(direction, step)) {
        if (is_restart) return Status::NoProgress;
        is_restart = true;
        direction = descent;
        slope = dot(run.gradient(), direction);
        step = 1;
        continue;
      }
      ++run.summary().iterations;
      const Eigen::MatrixXd next = scaled(run, run.gradient());
      // max(0, g_new A^-1 (g_new - g) / g A^-1 g)
      const double beta =
          std::max(0.0, dot(run.gradient(), next - descent) / dot(run.previous_gradient(), descent));
      descent = next;
      direction = descent + beta * direction;
      const double previous_slope = slope;
      slope = dot(run.gradient(), direction);
      is_restart = !(slope < 0);
      if (is_restart) {
        direction = descent;
        slope = dot(run.gradient(), direction);
      }
      step = std::min(2 * step * previous_slope / slope, 10.0);  // twice the first-order decrease before
      if (!(step > 0) || !is_finite(step)) step = 1;
    }
    return run.end();
  });
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
