#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/finite.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/energy/align.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <chrono>
#include <new>
#include <optional>
#include <string_view>
#include <type_traits>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of TurningOffsets, in addition to those of its method.
template <typename Options>
struct TurningOptions : Options {
  /// The offsets also grow and shrink with the constellation; otherwise they only turn.
  bool scale = true;
};

/// The names of these options, for an OptionVisitor.
template <typename Options>
void visit_options(OptionVisitor& visit, TurningOptions<Options>& options) {
  visit_options(visit, static_cast<Options&>(options));
  visit("scale", options.scale);
}

/// Offsets that turn and scale with the constellation: minimises the energy in which link (i, j) prefers T
/// m_ij in place of its offset m_ij, over the placement x and one rotation T, with `scale` one similarity
/// (without reflection), for all links. Like the lengths of springs, the shape of a pictorial structure is
/// then the same however the object is turned.
///
/// T and x are minimised in turns: for given x the best T is a weighted Procrustes problem, in closed form
/// (for links other than springs without length, of the majoriser that LinkPotential promises), and for given
/// T `Solver` minimises the energy. No turn raises it. As T follows x slowly where anchors are weak, the
/// sequence of T is extrapolated (Anderson 1965; Walker & Ni 2011), and a step that raises the energy is
/// taken back. In the plane, with `scale`, and if all links and anchors are plain springs without rest
/// length, the energy is convex in x and T together, so the result is the global minimum.
///
/// An object holds its workspace; uses the heap; one thread at a time.
template <typename System, typename Solver>
class TurningOffsets {
  static_assert(!System::kAnisotropicLinks, "information matrices of links do not turn with the offsets");

 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;
  using Matrix = Eigen::Matrix<Scalar, System::kDim, System::kDim, Eigen::ColMajor>;

  TurningOptions<std::decay_t<decltype(std::declval<Solver&>().options)>> options;

  static constexpr std::string_view name() { return "turning offsets"; }

  /// Moves x (Dim x N) to a stationary point, at which transform() is the best T. The Summary is that of the
  /// last solve, except that iterations, evaluations, linear solves, factorisations and time are totals, and
  /// the initial energy is that of the given x and the best T there. Statuses are those of `Solver`;
  /// InvalidInput also for the option gap, of which nothing would be known, and Converged only if x is
  /// stationary for the best T.
  Summary solve(const System& system, Points& x) {
    const auto begin = std::chrono::steady_clock::now();
    Summary result;
    result.status = Status::InvalidInput;
    if (options.gap > 0) {
      result.message = "option gap: no lower bound is known for offsets that turn";
    } else if (detail::shares_memory(system, x.data(), x.size())) {
      result.message = detail::kSharesMemory;
    } else if (const Defect defect = detail::validate_values(system, x)) {
      result.message = defect;
    } else if (!system.has_offsets()) {
      result.message = "the system's links have no offsets";
    } else {
      detail::attempt<std::bad_alloc>([&] { result = run(system, x); },
                                      [&result](const std::bad_alloc& error) {
                                        result.status = Status::OutOfMemory;
                                        result.message = detail::memory_message(error);
                                      });
    }
    result.solver = name();
    result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return result;
  }

  /// T of the last solve, Dim x Dim.
  const Matrix& transform() const { return transform_; }

 private:
  static constexpr int kDim = System::kDim;
  static constexpr int kMemory = 5;  // steps that the extrapolation uses
  static constexpr int kMostTurns = 1000;

  Summary run(const System& system, Points& x) {
    turned_.reset();
    turned_.emplace(system);
    solver_.options = options;
    transform_.setIdentity();
    set(system, best(system, x));
    steps_.resize(kDim * kDim, 0);
    residuals_.resize(kDim * kDim, 0);
    const double initial = static_cast<double>(energy(*turned_, x));
    Summary result = solver_.solve(*turned_, x);
    for (int turn = 0; turn < kMostTurns && result.usable() && result.status != Status::Interrupted; ++turn) {
      const Matrix before = transform_;
      const Matrix next = best(system, x);
      set(system, next);
      rule_.set(*turned_, x, options.tolerance);
      const bool is_stationary = rule_.reached(gradient(*turned_, x));
      result.status = is_stationary ? Status::Converged : Status::MaxIterations;
      result.message = is_stationary ? "stationary to the tolerance" : "not yet stationary";
      result.final_energy = static_cast<double>(energy(*turned_, x));
      if (is_stationary || result.iterations >= options.max_iterations) break;
      const double reached = result.final_energy;
      if (!solve_with(system, extrapolated(before, next), reached, x, result) &&
          !solve_with(system, next, reached, x, result)) {
        set(system, next);
        result.status = Status::NoProgress;
        result.message = "stopped short of the tolerance";
        break;
      }
    }
    result.initial_energy = initial;
    if (result.usable()) {
      const Points slope = gradient(*turned_, x);
      result.final_energy = static_cast<double>(energy(*turned_, x));
      result.gradient_norm = slope.template cast<double>().norm();
      result.stationarity = stationarity(*turned_, x);
    }
    return result;
  }

  // One more solve with T, from x. False, with x as it was, if its energy is not below `reached`.
  bool solve_with(const System& system, const Matrix& T, double reached, Points& x, Summary& result) {
    set(system, T);
    start_ = x;
    solver_.options.max_iterations = std::max(1, options.max_iterations - result.iterations);
    const Summary done = std::exchange(result, solver_.solve(*turned_, x));
    result.add_work(done);
    if (result.usable() && result.final_energy <= reached) return true;
    x = start_;
    return false;
  }

  void set(const System& system, const Matrix& T) {
    transform_ = T;
    turned_->rest_offset.noalias() = T * system.rest_offset;
  }

  // The T that is best at x, given the present one.
  Matrix best(const System& system, const Points& x) const {
    Matrix M = Matrix::Zero();
    Scalar size = 0;
    detail::for_each_spring(
        *turned_, x, [](int, const auto&) {},
        [&](int l, const Link&, const auto& force, const auto& spring) {
          const Scalar k = system.link_stiffness[l];
          if (!(k > 0)) return;
          const typename System::Point m = system.rest_offset.col(l);
          // What T m would be if the link were slack: here its force is k times the distance from that.
          M += (k * (transform_ * m) + force.tension * spring.direction) * m.transpose();
          size += k * m.squaredNorm();
        });
    return nearest(M, size);
  }

  // The similarity or rotation R, s that minimises |M / size - s R|.
  Matrix nearest(const Matrix& M, Scalar size) const {
    Matrix R = Matrix::Identity();
    if constexpr (kDim > 1) R = detail::nearest_rotation<Scalar, kDim>(M, false);
    if (!options.scale) return R;
    const Scalar scale = size > 0 ? R.cwiseProduct(M).sum() / size : Scalar(1);
    return std::max(scale, Scalar(0)) * R;
  }

  // Where the sequence of T leads, after it went from `before` to `next`.
  Matrix extrapolated(const Matrix& before, const Matrix& next) {
    constexpr int kSize = kDim * kDim;
    const Vector to = next.reshaped(), residual = to - Vector(before.reshaped());
    if (residuals_.cols() == kMemory) {  // forgets the oldest
      steps_ = steps_.rightCols(kMemory - 1).eval();
      residuals_ = residuals_.rightCols(kMemory - 1).eval();
    }
    steps_.conservativeResize(kSize, steps_.cols() + 1);
    residuals_.conservativeResize(kSize, residuals_.cols() + 1);
    steps_.rightCols(1) = to;
    residuals_.rightCols(1) = residual;
    const auto count = residuals_.cols() - 1;
    if (count == 0) return next;
    const History residual_changes = residuals_.rightCols(count) - residuals_.leftCols(count);
    const History step_changes = steps_.rightCols(count) - steps_.leftCols(count);
    const Vector at = to - step_changes * residual_changes.completeOrthogonalDecomposition().solve(residual);
    if (!detail::all_finite(at)) return next;
    return nearest(at.template reshaped<Eigen::ColMajor>(kDim, kDim), Scalar(kDim));
  }

  using Vector = Eigen::Matrix<Scalar, kDim * kDim, 1>;
  using History = Eigen::Matrix<Scalar, kDim * kDim, Eigen::Dynamic>;

  Solver solver_;
  std::optional<System> turned_;
  Matrix transform_ = Matrix::Identity();
  detail::StoppingRule<System> rule_;
  History steps_, residuals_;  // G(T) and G(T) - T of the last turns
  Points start_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
