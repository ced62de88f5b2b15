#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/linear/dense_cholesky.hpp>
#include <asterism/solver/method/descent.hpp>
#include <asterism/solver/method/policy_name.hpp>
#include <asterism/solver/run/compiled.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Limited memory BFGS (Nocedal & Wright, section 7.2) that starts from IDA's metric.
///
/// IDA's step -K_dyn^-1 g assumes that every spring is as stiff across as it is along itself. Here the last
/// four steps and gradient changes correct that: the inverse Hessian is approximated by gamma K_dyn^-1 plus
/// their update, in the compact form of Byrd, Nocedal and Schnabel (1994). An iteration costs as much as one
/// of IDA and some products of eight vectors, and far fewer are needed. The line search accepts only lower
/// energies; if the direction or the search fails, the memory is cleared and IDA's step is taken, which can
/// fail only by rounding.
///
/// `Metric` is SingleCholesky (default), DenseCholesky, SparseCholesky or CholmodCholesky of K_dyn, or
/// JacobiMetric, its diagonal. An object holds its workspace: reuse it to solve without allocation, one
/// thread at a time.
template <typename System, typename Metric = SingleCholesky<System>>
class Lbfgs {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  AlignedOptions options;

  Lbfgs() = default;
  /// For type deduction: Lbfgs(system).solve(system, x).
  explicit Lbfgs(const System&, const AlignedOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return detail::NameWithPolicy<kMethod, Metric>::value; }

  /// Moves x (Dim x N), the start, to a stationary point of the energy. Statuses as for Ida::solve.
  Summary solve(const System& given, Points& x) { return detail::Compiled::solve(*this, given, x); }

 private:
  friend detail::Compiled;

  Summary run(const System& given, Points& x);

  static constexpr std::string_view kMethod = "L-BFGS";
  static constexpr int kMemory = 4;
  // Least change of slope along a step, as a share of the slope, for its pair to be remembered.
  static constexpr Scalar kCurvature = Scalar(1e-3);
  static constexpr int kSize = detail::times<System::kNodes>(System::kDim);
  static constexpr int kMaxSize = detail::times<System::kMaxNodes>(System::kDim);
  using Vector = Eigen::Matrix<Scalar, kSize, 1, Eigen::ColMajor, kMaxSize, 1>;
  // A single coordinate makes a row vector of it, which Eigen wants in row-major order.
  static constexpr int kOrder = kMaxSize == 1 ? Eigen::RowMajor : Eigen::ColMajor;
  using History = Eigen::Matrix<Scalar, kSize, kMemory, kOrder, kMaxSize, kMemory>;
  // Coordinates at a time.
  static constexpr int kWidth =
      std::max<int>(2, static_cast<int>(EIGEN_MAX_STATIC_ALIGN_BYTES / sizeof(Scalar)));
  using Pack = Eigen::Array<Scalar, kWidth, 1>;
  using Row = Eigen::Map<Pack>;
  using ConstRow = Eigen::Map<const Pack>;
  using Small = Eigen::Matrix<Scalar, kMemory, kMemory, Eigen::ColMajor>;
  using SmallVector = Eigen::Matrix<Scalar, kMemory, 1>;

  static auto as_vector(Points& points) { return Eigen::Map<Vector>(points.data(), points.size()); }
  static auto as_vector(const Points& points) {
    return Eigen::Map<const Vector>(points.data(), points.size());
  }

  // IDA's step from the present x.
  void majorised_descent(Summary& summary) {
    descent_.setZero(System::kDim, state_.gradient().cols());
    metric_.descend(state_.gradient(), descent_);
    ++summary.linear_solves;
  }

  void forget(Eigen::Index size) {
    used_ = next_ = 0;
    steps_.setZero(size, kMemory);
    changes_.setZero(size, kMemory);
  }

  // The slot of the pair that is `age`-th oldest.
  int slot(int age) const {
    if (used_ < kMemory) return age;
    return next_ + age < kMemory ? next_ + age : next_ + age - kMemory;
  }

  // The products of all pairs with the gradient, those of slots that are not in use being zero.
  void times_gradient() {
    const Scalar* const g = state_.gradient().data();
    const Eigen::Index size = state_.gradient().size();
    Pack steps[kMemory];
    Pack changes[kMemory];
    for (int c = 0; c < kMemory; ++c) {
      steps[c].setZero();
      changes[c].setZero();
    }
    Eigen::Index i = 0;
    for (; i + kWidth <= size; i += kWidth) {
      const Pack at = ConstRow(g + i);
      for (int c = 0; c < kMemory; ++c) {
        steps[c] += ConstRow(&steps_(i, c)) * at;
        changes[c] += ConstRow(&changes_(i, c)) * at;
      }
    }
    for (int c = 0; c < kMemory; ++c) {
      steps_gradient_[c] = steps[c].sum();
      changes_gradient_[c] = changes[c].sum();
    }
    for (; i < size; ++i) {
      for (int c = 0; c < kMemory; ++c) {
        steps_gradient_[c] += steps_(i, c) * g[i];
        changes_gradient_[c] += changes_(i, c) * g[i];
      }
    }
  }

  // direction_ = gamma (descent_ + W u) - S top.
  void combine(const SmallVector& u, const SmallVector& top) {
    const Scalar* const descent = descent_.data();
    Scalar* const direction = direction_.data();
    const Eigen::Index size = descent_.size();
    const SmallVector scaled = gamma_ * u;
    Eigen::Index i = 0;
    for (; i + kWidth <= size; i += kWidth) {
      Pack sum = gamma_ * ConstRow(descent + i);
      for (int c = 0; c < kMemory; ++c) {
        sum += scaled[c] * ConstRow(&changes_(i, c));
        sum -= top[c] * ConstRow(&steps_(i, c));
      }
      Row(direction + i) = sum;
    }
    for (; i < size; ++i) {
      Scalar sum = gamma_ * descent[i];
      for (int c = 0; c < kMemory; ++c) sum += scaled[c] * changes_(i, c) - top[c] * steps_(i, c);
      direction[i] = sum;
    }
  }

  // direction_ = -H g with H = gamma K^-1 + [S, gamma W] [R^-T (D + gamma Y^T W) R^-1, -R^-T; -R^-1, 0]
  // [S, gamma W]^T, where S and Y have the steps and changes of the gradient as columns, W = K^-1 Y, R is the
  // upper triangle of S^T Y and D its diagonal.
  void quasi_newton_direction() {
    if (used_ == 0) {
      direction_ = descent_;
      return;
    }
    direction_.resizeLike(descent_);
    SmallVector u = SmallVector::Zero();
    SmallVector top = SmallVector::Zero();
    SmallVector changed;                    // Y^T W u
    for (int i = used_ - 1; i >= 0; --i) {  // u = R^-1 S^T g
      const int at = slot(i);
      Scalar rest = steps_gradient_[at];
      for (int j = i + 1; j < used_; ++j) rest -= steps_changes_(at, slot(j)) * u[slot(j)];
      u[at] = rest * inverse_curvatures_[at];
    }
    changed.head(used_).noalias() = changes_changes_.topLeftCorner(used_, used_).lazyProduct(u.head(used_));
    for (int i = 0; i < used_; ++i) {  // top = R^-T ((D + gamma Y^T W) u - gamma W^T g)
      const int at = slot(i);
      Scalar rest = steps_changes_(at, at) * u[at] + gamma_ * (changed[at] - changes_gradient_[at]);
      for (int j = 0; j < i; ++j) rest -= steps_changes_(slot(j), at) * top[slot(j)];
      top[at] = rest * inverse_curvatures_[at];
    }
    combine(u, top);
  }

  // Takes in the pair of the last step, unless the slope hardly changed along it or fell (no positive
  // curvature), and the products of all pairs with the new gradient.
  void remember(Scalar slope, Scalar step) {
    const SmallVector old_steps_gradient = steps_gradient_;
    const SmallVector old_changes_gradient = changes_gradient_;
    const Scalar curvature = step * (state_.slope() - slope);  // s . y
    const bool take = curvature > kCurvature * step * -slope;
    int newest = -1;
    Scalar newest_changes_gradient = 0;
    if (take) {
      newest = next_;
      steps_.col(newest) = step * as_vector(direction_);
      changes_.col(newest) = as_vector(previous_descent_) - as_vector(descent_);
      newest_changes_gradient = changes_.col(newest).dot(as_vector(state_.previous_gradient()));
      used_ = std::max(used_, newest + 1);
      next_ = (next_ + 1) % kMemory;
    }
    times_gradient();
    if (!take) return;
    for (int i = 0; i < used_; ++i) {
      if (i == newest) continue;
      steps_changes_(i, newest) = steps_gradient_[i] - old_steps_gradient[i];
      changes_changes_(i, newest) = changes_changes_(newest, i) =
          changes_gradient_[i] - old_changes_gradient[i];
    }
    steps_changes_(newest, newest) = curvature;
    inverse_curvatures_[newest] = 1 / curvature;
    const Scalar square = changes_gradient_[newest] - newest_changes_gradient;  // y . K^-1 y
    changes_changes_(newest, newest) = square;
    gamma_ = curvature / square;
    if (!(gamma_ > 0 && detail::is_finite(gamma_))) used_ = next_ = 0;
  }

  Session<System> session_;
  detail::DescentState<System> state_;
  Metric metric_;
  Points descent_;           // -K_dyn^-1 g
  Points previous_descent_;  // at the iterate before
  Points direction_;
  History steps_;    // S
  History changes_;  // W = K_dyn^-1 Y
  // Initialised for a new object to be moved into this one.
  Small steps_changes_ = Small::Zero();                   // S^T Y, upper triangle in order of age
  Small changes_changes_ = Small::Zero();                 // Y^T W
  SmallVector inverse_curvatures_ = SmallVector::Zero();  // of D
  SmallVector steps_gradient_ = SmallVector::Zero();
  SmallVector changes_gradient_ = SmallVector::Zero();  // W^T g
  Scalar gamma_ = 1;
  int used_ = 0;  // pairs remembered
  int next_ = 0;  // slot of the next
};

template <typename System, typename Metric>
Summary Lbfgs<System, Metric>::run(const System& given, Points& x) {
  return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
    ++summary.factorizations;
    if (!metric_.factorize(system)) {
      summary.message =
          "K_dyn is not positive definite: the anchors are too weak compared with the springs for this "
          "scalar";
      return Status::NumericalFailure;
    }
    state_.start(system, x, summary);
    forget(x.size());
    majorised_descent(summary);
    while (true) {
      const bool converged = session_.done(x, state_.gradient(), summary.iterations);
      if (converged || summary.iterations == options.max_iterations) {
        session_.adopt(x, state_.energy(), state_.gradient());
        return converged ? Status::Converged : Status::MaxIterations;
      }
      if (session_.stalls(x, state_.gradient(), summary.iterations)) return Status::NoProgress;

      quasi_newton_direction();
      Scalar slope = state_.gradient().cwiseProduct(direction_).sum();
      Scalar step = 1;
      while (!(slope < 0) || !state_.search(system, x, direction_, slope, step, summary)) {
        if (used_ == 0) return Status::NoProgress;
        forget(x.size());
        direction_ = descent_;
        slope = state_.gradient().cwiseProduct(direction_).sum();
        step = 1;
      }
      previous_descent_.swap(descent_);
      majorised_descent(summary);
      ++summary.iterations;
      remember(slope, step);
    }
  });
}

ASTERISM_COMPILED_SOLVER(Lbfgs)

}  // namespace ASTERISM_ABI
}  // namespace asterism
