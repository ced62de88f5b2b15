#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/finite.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/detail/stopwatch.hpp>
#include <asterism/solver/energy/align.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/sparse_ida.hpp>
#include <asterism/solver/problem/model.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <limits>
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
/// If all links are springs without rest length and all anchors plain springs, the result is the global
/// minimum, whatever the start. For then the best x for a given T is x_0 + T y, with y the placement that the
/// offsets m_ij would have if all anchors were at the origin, and the energy of that x is, up to a constant,
/// 1/2 trace(T S T^T) - trace(C^T T) with Dim x Dim matrices S and C (variable projection, Golub & Pereyra
/// 1973). As trace(R S R^T) = trace(S) for every rotation R, the best T = s R is a Procrustes problem in
/// closed form.
///
/// For any other link or anchor the same step minimises IDA's quadratic, which lies above the energy, over x
/// and T together. `Solver` then minimises the energy for that T, and so on until neither moves; no turn
/// raises the energy, and the sequence of T is extrapolated (Anderson 1965; Walker & Ni 2011). The result is
/// a stationary point, as that of `Solver`.
///
/// An object holds its workspace; uses the heap; one thread at a time.
template <typename System, typename Solver>
class TurningOffsets {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;
  using Matrix = Eigen::Matrix<Scalar, System::kDim, System::kDim, Eigen::ColMajor>;

  TurningOptions<std::decay_t<decltype(std::declval<Solver&>().options)>> options;

  static constexpr std::string_view name() { return "turning offsets"; }

  /// Moves x (Dim x N) and transform() to a stationary point. The Summary is that of the last solve, except
  /// that iterations, evaluations, linear solves, factorisations and time are totals, the initial energy is
  /// that of the given x and the best T there, and stationarity is that of x or, if that is more, the largest
  /// distance that a step of T would move a node or change an offset by, in units of the
  /// characteristic_length. Statuses are those of `Solver`; InvalidInput also for the option gap, of which
  /// nothing would be known. Converged only if the stationarity is within the tolerance.
  /// Summary::positive_definite is of the energy's second derivatives by x and T: true only if all links are
  /// springs without rest length, all anchors plain springs, and no turn of the offsets leaves the energy
  /// unchanged; empty if not all of them are.
  Summary solve(const System& system, Points& x) {
    const detail::Stopwatch stopwatch(options.measure_seconds);
    if (options.gap > 0)
      return detail::refused(name(), "option gap: no lower bound is known for offsets that turn");
    if (detail::shares_memory(system, x.data(), x.size()))
      return detail::refused(name(), detail::kSharesMemory);
    if (const Defect defect = detail::validate_values(system, x)) return detail::refused(name(), defect);
    if (!system.has_offsets()) return detail::refused(name(), "the system's links have no offsets");
    Summary result;
    detail::attempt<std::bad_alloc>([&] { result = run(system, x); },
                                    [&result](const std::bad_alloc& error) {
                                      result.status = Status::OutOfMemory;
                                      result.message = detail::memory_message(error);
                                    });
    result.solver = name();
    result.seconds = stopwatch.seconds();
    return result;
  }

  /// T of the last solve, Dim x Dim.
  const Matrix& transform() const { return transform_; }

 private:
  static constexpr int kDim = System::kDim;
  static constexpr int kMemory = 5;  // steps that the extrapolation uses
  static constexpr int kMostTurns = 1000;
  using Plain = SpringSystem<double, kDim>;

  // A step of T.
  struct Step {
    Matrix to;        // the T it leads to
    Matrix target;    // M: among all T, that nearest to it minimises the quadratic
    Scalar rounding;  // of M
  };

  Summary run(const System& system, Points& x) {
    turned_.reset();
    turned_.emplace(system);
    solver_.options = options;
    transform_.setIdentity();
    // At first with x held, as the start is the user's.
    respond(system, false);
    set(system, step(system, x).to);
    const double initial = static_cast<double>(energy(*turned_, x));
    respond(system, true);
    changes_.resize(kDim * kDim, 0);
    targets_.resize(kDim * kDim, 0);
    Summary result = solver_.solve(*turned_, x);
    Scalar least_shift = std::numeric_limits<Scalar>::infinity();
    for (int turn = 0; turn < kMostTurns && result.usable() && result.status != Status::Interrupted; ++turn) {
      const Matrix next = step(system, x).to;
      const Scalar shift = this->shift(system, next);
      rule_.set(*turned_, x, options.tolerance);
      const bool is_stationary =
          rule_.reached(gradient(*turned_, x)) && shift <= rule_.tolerance() * rule_.length();
      result.status = is_stationary ? Status::Converged : Status::MaxIterations;
      result.message = is_stationary ? "stationary to the tolerance" : "not yet stationary";
      result.final_energy = static_cast<double>(energy(*turned_, x));
      if (is_stationary || result.iterations >= options.max_iterations) break;
      const double reached = result.final_energy;
      const bool moves = solve_with(system, extrapolated(next), reached, x, result) ||
                         solve_with(system, next, reached, x, result);
      if (!moves || !(result.final_energy < reached || shift < least_shift / 2)) {
        result.status = Status::NoProgress;
        result.message = "stopped short of the tolerance";
        break;
      }
      least_shift = std::min(least_shift, shift);
    }
    result.initial_energy = initial;
    if (result.usable()) judge(system, x, result);
    return result;
  }

  void judge(const System& system, const Points& x, Summary& result) {
    const Points slope = gradient(*turned_, x);
    const Step last = step(system, x);
    rule_.set(*turned_, x, options.tolerance);
    const Scalar length = rule_.length();
    const Scalar turn = length > 0 ? shift(system, last.to) / length : Scalar(0);
    result.final_energy = static_cast<double>(energy(*turned_, x));
    result.gradient_norm = slope.template cast<double>().norm();
    result.stationarity = static_cast<double>(std::max(rule_.stationarity(slope), turn));
    if (result.positive_definite == true)
      result.positive_definite = is_quadratic(system) ? std::optional(is_strict(last)) : std::nullopt;
  }

  // Whether the energy is quadratic in x and T.
  static bool is_quadratic(const System& system) {
    if (!System::kPlainAnchors || !std::is_same_v<typename System::Model::LinkPotential, Hooke>) return false;
    for (int l = 0; l < system.link_count(); ++l) {
      if (system.link_stiffness[l] > 0 && system.rest_length[l] > 0) return false;
    }
    return true;
  }

  // Whether the quadratic rises wherever T = s R turns: by s trace(W^T W P) for a rotation by exp(W), where
  // P = R^T M is symmetric; and, with `scale`, by trace(S) for a change of s.
  bool is_strict(const Step& last) const {
    if (!(curvature_.trace() > (options.scale ? last.rounding : Scalar(0)))) return false;
    if constexpr (kDim == 1) return true;
    const Scalar scale = last.to.col(0).norm();
    Matrix P = last.to.transpose() * last.target;
    P = (P + P.transpose()).eval() / 2;
    Matrix modes;
    detail::diagonalise<Scalar, kDim>(P, modes);
    Eigen::Array<Scalar, kDim, 1> values = P.diagonal();
    std::sort(values.begin(), values.end());
    return values[0] + values[kDim > 1 ? 1 : 0] > scale * last.rounding;
  }

  // One more solve with T, from x as T moves it. False, with x and T as they were, if its energy is not below
  // `reached`.
  bool solve_with(const System& system, const Matrix& T, double reached, Points& x, Summary& result) {
    const Matrix before = transform_;
    start_ = x;
    x += (T - before) * response_;
    set(system, T);
    solver_.options.max_iterations = std::max(1, options.max_iterations - result.iterations);
    const Summary done = std::exchange(result, solver_.solve(*turned_, x));
    result.add_work(done);
    if (result.usable() && result.final_energy <= reached) return true;
    x = start_;
    set(system, before);
    return false;
  }

  void set(const System& system, const Matrix& T) {
    transform_ = T;
    turned_->rest_offset.noalias() = T * system.rest_offset;
  }

  // How far nodes move, or offsets change, as T goes to `next`.
  Scalar shift(const System& system, const Matrix& next) const {
    const Matrix change = next - transform_;
    Scalar farthest = (change * response_).colwise().norm().maxCoeff();
    for (int l = 0; l < system.link_count(); ++l) {
      if (system.link_stiffness[l] > 0)
        farthest = std::max(farthest, Scalar((change * system.rest_offset.col(l)).norm()));
    }
    return farthest;
  }

  // Sets the response y of x to T, in the quadratic above the energy, and the quadratic's curvature S; with
  // x held, y = 0. It is IDA's solution for the offsets as they are and all anchors at the origin. One that
  // is not exact only makes the quadratic steeper.
  void respond(const System& system, bool moves) {
    Plain plain(Topology<>::from_links(system.nodes(), system.links()));
    plain.anchors.setZero();
    plain.rest_length.setZero();
    plain.anchor_stiffness = system.anchor_stiffness.template cast<double>();
    plain.link_stiffness = system.link_stiffness.template cast<double>();
    plain.rest_offset.setZero(kDim, system.link_count());
    for (int l = 0; l < system.link_count(); ++l) {
      if (system.link_stiffness[l] > 0)
        plain.rest_offset.col(l) = system.rest_offset.col(l).template cast<double>();
    }
    for (int i = 0; i < system.nodes(); ++i) {
      if (system.is_fixed(i)) plain.fix(i);
    }
    typename Plain::Points y = Plain::Points::Zero(kDim, system.nodes());
    if (moves) {
      SparseIda<Plain> ida;
      ida.options.tolerance = 0;
      ida.options.hold_floating = true;
      ida.options.max_iterations = 10;  // the second one corrects rounding
      if (ida.solve(plain, y).status == Status::OutOfMemory) detail::raise(std::bad_alloc());
    }
    Eigen::Matrix<double, kDim, kDim, Eigen::ColMajor> S;
    S.setZero();
    for (int i = 0; i < system.nodes(); ++i) S += plain.anchor_stiffness[i] * y.col(i) * y.col(i).transpose();
    double size = 0;
    int l = 0;
    left_.resize(kDim, system.link_count());
    for (const Link& link : system.links()) {
      const Eigen::Matrix<double, kDim, 1> left = plain.rest_offset.col(l) - (y.col(link.i) - y.col(link.j));
      S += plain.link_stiffness[l] * left * left.transpose();
      const double terms = plain.rest_offset.col(l).norm() + y.col(link.i).norm() + y.col(link.j).norm();
      size += plain.link_stiffness[l] * terms * terms;
      left_.col(l++) = left.template cast<Scalar>();
    }
    response_ = y.template cast<Scalar>();
    // Where nothing but links resists T, S is what the rounding of y leaves.
    constexpr double kRounding = 64 * std::numeric_limits<double>::epsilon();
    if (!(S.trace() > kRounding * kRounding * size)) S.setZero();
    curvature_ = S.template cast<Scalar>();
  }

  // To the T that minimises, with the x best for it, the quadratic that touches the energy at x and the
  // present T.
  Step step(const System& system, const Points& x) const {
    Matrix M = transform_ * curvature_;
    Scalar size = M.norm();
    detail::for_each_spring(
        *turned_, x,
        [&](int i, const auto& offset) {
          if (system.is_fixed(i)) return;
          const auto force = detail::node_force(system, i, x, offset).gradient;
          M -= force * response_.col(i).transpose();
          const Scalar terms = force.norm() + system.anchor_stiffness[i] * x.col(i).norm();
          size += terms * response_.col(i).norm();
        },
        [&](int l, const Link&, const auto& force, const auto& spring) {
          if (!(system.link_stiffness[l] > 0)) return;
          M += (force.tension * spring.direction) * left_.col(l).transpose();
          size += std::abs(force.tension) * left_.col(l).norm();
        });
    constexpr Scalar kRounding = 64 * std::numeric_limits<Scalar>::epsilon();
    const Scalar rounding = kRounding * size;
    const Scalar stiffness = curvature_.trace();
    if (!(stiffness > 0 && detail::all_finite(M))) return {transform_, M, rounding};
    // Where no turn is better than another, T keeps its own.
    const bool turns = M.norm() > rounding;
    return {nearest(turns ? M : transform_, M, stiffness), M, rounding};
  }

  // The similarity or rotation T = s R with the R nearest to `turn` and the s that minimises |M / size - T|.
  Matrix nearest(const Matrix& turn, const Matrix& M, Scalar size) const {
    Matrix R = Matrix::Identity();
    if constexpr (kDim > 1) R = detail::nearest_rotation<Scalar, kDim>(turn, false);
    if (!options.scale) return R;
    return std::max(R.cwiseProduct(M).sum() / size, Scalar(0)) * R;
  }

  // Where the sequence of T leads, as the next step is to `next`.
  Matrix extrapolated(const Matrix& next) {
    constexpr int kSize = kDim * kDim;
    const Vector to = next.reshaped(), change = to - Vector(transform_.reshaped());
    if (changes_.cols() == kMemory) {  // forgets the oldest
      targets_ = targets_.rightCols(kMemory - 1).eval();
      changes_ = changes_.rightCols(kMemory - 1).eval();
    }
    targets_.conservativeResize(kSize, targets_.cols() + 1);
    changes_.conservativeResize(kSize, changes_.cols() + 1);
    targets_.rightCols(1) = to;
    changes_.rightCols(1) = change;
    const auto count = changes_.cols() - 1;
    if (count == 0) return next;
    const History more_changes = changes_.rightCols(count) - changes_.leftCols(count);
    const History more_targets = targets_.rightCols(count) - targets_.leftCols(count);
    const Vector at = to - more_targets * more_changes.completeOrthogonalDecomposition().solve(change);
    if (!detail::all_finite(at)) return next;
    const Matrix M = at.template reshaped<Eigen::ColMajor>(kDim, kDim);
    return nearest(M, M, Scalar(kDim));
  }

  using Vector = Eigen::Matrix<Scalar, kDim * kDim, 1>;
  using History = Eigen::Matrix<Scalar, kDim * kDim, Eigen::Dynamic>;

  Solver solver_;
  std::optional<System> turned_;
  Matrix transform_ = Matrix::Identity();
  detail::StoppingRule<System> rule_;
  Points response_;                   // y
  typename System::LinkPoints left_;  // m_ij - (y_i - y_j), the part of an offset that y leaves to the link
  Matrix curvature_;                  // S, of the energy by T with x that follows it
  History targets_, changes_;         // T's of the last steps, and the changes that led to them
  Points start_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
