#include <Eigen/LU>
#include <algorithm>
#include <asterism/solver/detail/finite.hpp>
#include <cmath>
#include <limits>

#include "matrix.hpp"
#include "methods.hpp"
#include "run.hpp"

// Methods that need second derivatives.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

namespace {

bool lacks_hessian(SystemRun& run) {
  const std::string missing = missing_curvature(run.system(), Curvature::True);
  if (missing.empty()) return false;
  run.summary().message = std::string_view("the method needs second derivatives: " + missing);
  return true;
}

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

// The step along a direction up to which a quadratic model is trusted: as far as the nodes are from where
// their springs pull them, or the characteristic length. A robust loss may have little curvature, and beyond
// it none and no force.
double trusted_step(const SystemRun& run, const Eigen::MatrixXd& direction) {
  constexpr double kTrusted = 4;
  const double reach = run.rule().stationarity(run.gradient()) * run.rule().length();
  return std::min(1.0,
                  kTrusted * std::max(run.rule().length(), reach) / direction.colwise().norm().maxCoeff());
}

}  // namespace

Summary SystemNewton::solve(const System& system, Eigen::MatrixXd& x) const {
  return SystemRun::solve(name(), options, system, x, [](SystemRun& run) {
    if (lacks_hessian(run)) return Status::InvalidInput;
    constexpr double kLeastShare = 1e-9, kMostShare = 1e3;
    constexpr int kMaxEscapes = 50;
    SystemMatrix matrix, clamped;
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
        const Eigen::VectorXd v = factor.negative_direction();
        if (v.size() == 0) return run.end();
        const double curvature = v.dot(matrix.matrix().selfadjointView<Eigen::Lower>() * v);
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
        if (trusted_step(run, direction) == 1 && run.search(direction, step)) {
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
          const double first = step = trusted_step(run, direction);
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

namespace {

// The inverses of the nodes' diagonal blocks of a positive semi-definite matrix, and of hidden unknowns.
class BlockDiagonal {
 public:
  BlockDiagonal(const SystemMatrix& matrix, int nodes, int dim) : dim_(dim), nodes_(nodes) {
    const auto& entries = matrix.matrix();
    blocks_.setZero(dim, dim * nodes);
    const Eigen::Index points = dim * nodes;
    hidden_.resize(entries.rows() - points);
    for (Eigen::Index c = 0; c < entries.outerSize(); ++c) {
      for (Eigen::SparseMatrix<double>::InnerIterator at(entries, c); at; ++at) {
        if (c >= points) {
          if (at.row() == c) hidden_[c - points] = at.value();
        } else if (at.row() / dim == c / dim) {
          blocks_(at.row() % dim, c) = at.value();
          blocks_(c % dim, dim * (c / dim) + at.row() % dim) = at.value();
        }
      }
    }
    for (int i = 0; i < nodes; ++i) {
      auto block = blocks_.middleCols(dim * i, dim);
      const Eigen::MatrixXd inverse = block.inverse();
      block = inverse;
    }
  }

  Eigen::VectorXd operator()(const Eigen::VectorXd& v) const {
    Eigen::VectorXd result(v.size());
    for (int i = 0; i < nodes_; ++i)
      result.segment(dim_ * i, dim_) = blocks_.middleCols(dim_ * i, dim_) * v.segment(dim_ * i, dim_);
    result.tail(hidden_.size()) = v.tail(hidden_.size()).cwiseQuotient(hidden_);
    return result;
  }

 private:
  int dim_, nodes_;
  Eigen::MatrixXd blocks_;
  Eigen::VectorXd hidden_;
};

}  // namespace

Summary SystemNewtonCg::solve(const System& system, Eigen::MatrixXd& x) const {
  return SystemRun::solve(name(), options, system, x, [](SystemRun& run) {
    if (lacks_hessian(run)) return Status::InvalidInput;
    SystemMatrix matrix, clamped;
    double previous_norm = 0, forcing = 0.5;
    while (!run.is_over()) {
      matrix.assemble(run.system(), run.x(), Curvature::True);
      clamped.assemble(run.system(), run.x(), Curvature::Clamped);
      clamped.shift(run.rule().node_stiffness(), 1e-3);
      const BlockDiagonal precondition(clamped, run.system().nodes(), run.system().dim());
      const auto hessian = matrix.matrix().selfadjointView<Eigen::Lower>();

      const double norm = run.gradient().norm();
      if (previous_norm > 0) {
        const double ratio = norm / previous_norm, safe = 0.9 * forcing * forcing;
        forcing = std::clamp(std::max(0.9 * ratio * ratio, safe > 0.1 ? safe : 0.0), 1e-6, 0.5);
      }
      previous_norm = norm;

      const Eigen::Index points = run.x().size();
      Eigen::VectorXd residual = Eigen::VectorXd::Zero(matrix.matrix().rows());
      residual.head(points) = -run.gradient().reshaped();
      Eigen::VectorXd step = Eigen::VectorXd::Zero(residual.size());
      Eigen::VectorXd z = precondition(residual), direction = z;
      double product = residual.dot(z);
      const double target = forcing * forcing * product;
      const auto most = 10 + 2 * residual.size();
      bool is_definite = true;  // as far as the directions tell
      for (Eigen::Index inner = 0; inner < most; ++inner) {
        const Eigen::VectorXd image = hessian * direction;
        const double curvature = direction.dot(image);
        if (!(curvature > 0)) {
          is_definite = false;
          if (inner == 0) step = direction;
          break;
        }
        const double length = product / curvature;
        step += length * direction;
        residual -= length * image;
        z = precondition(residual);
        const double next = residual.dot(z);
        if (!(next > target)) break;
        direction = z + (next / product) * direction;
        product = next;
        ++run.summary().linear_solves;
      }
      const Eigen::MatrixXd newton = step.head(points).reshaped(run.x().rows(), run.x().cols());
      double length = is_definite ? 1.0 : trusted_step(run, newton);
      if (!run.search(newton, length)) {
        length = 1;
        const Eigen::MatrixXd descent =
            -run.gradient() * run.rule().node_stiffness().cwiseInverse().asDiagonal();
        if (!run.search(descent, length)) return Status::NoProgress;
      }
      ++run.summary().iterations;
    }
    return run.end();
  });
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
