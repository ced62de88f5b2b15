#pragma once

#include <Eigen/SparseCore>
#include <algorithm>
#include <asterism/solver/detail/compiled.hpp>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/definite_verdict.hpp>
#include <asterism/solver/detail/descent.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/detail/policy_name.hpp>
#include <asterism/solver/detail/saddle.hpp>
#include <asterism/solver/detail/sparse_blocks.hpp>
#include <asterism/solver/detail/sparse_factor.hpp>
#include <asterism/solver/energy/align.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/linear/jacobi_metric.hpp>
#include <asterism/solver/method/lbfgs.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <limits>
#include <memory>
#include <new>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// The lower triangle of the Hessian as a sparse matrix of `MatrixScalar`, (Dim N) x (Dim N). Its pattern is
/// made once for each topology; after that only its values are set.
template <typename System, typename MatrixScalar>
class SparseHessian {
 public:
  using Points = typename System::Points;
  static constexpr int kDim = System::kDim;

  /// Makes the pattern for the system's links and calls analyze(matrix), unless the pattern is for them.
  template <typename Analyze>
  void prepare(const System& system, Analyze&& analyze) {
    blocks_.prepare(system.nodes(), system.links(), analyze);
  }

  /// Fills in the Hessian at x. With `clamp`, no anchor or link has negative curvature, which makes the
  /// matrix positive semi-definite; with anchors, definite. A fixed node is coupled to none.
  void assemble(const System& system, const Points& x, bool clamp) {
    blocks_.set_zero();
    for_each_hessian_block(
        system, x, clamp, [this](int i, const Block& block) { blocks_.add(i, block); },
        [this](int l, const Link&, const Block& block) { blocks_.add_link(l, block); });
  }

  /// Adds factor * stiffness[i] to the diagonal of node i.
  void raise_diagonal(MatrixScalar factor, const typename System::NodeVector& stiffness) {
    for (int c = 0; c < matrix().cols(); ++c)
      *blocks_.diagonal(c) += factor * static_cast<MatrixScalar>(stiffness[c / kDim]);
  }

  /// Whether the block of a node alone shows that the matrix is not positive definite.
  bool has_indefinite_block() {
    for (int i = 0; i < matrix().cols() / kDim; ++i) {
      Block block;
      for (int c = 0; c < kDim; ++c) {
        for (int r = c; r < kDim; ++r) block(r, c) = static_cast<Scalar>(blocks_.at(i, r, c));
      }
      for (int c = 0; c < kDim; ++c) {  // elimination
        if (!(block(c, c) > 0)) return true;
        for (int k = c + 1; k < kDim; ++k) {
          for (int r = k; r < kDim; ++r) block(r, k) -= block(r, c) * block(k, c) / block(c, c);
        }
      }
    }
    return false;
  }

  const Eigen::SparseMatrix<MatrixScalar>& matrix() const { return blocks_.matrix(); }

 private:
  using Scalar = typename System::Scalar;
  using Block = Eigen::Matrix<Scalar, kDim, kDim, Eigen::ColMajor>;

  SparseBlocks<MatrixScalar, kDim> blocks_;
};

}  // namespace detail

/// Factorisation policy of SparseNewton: Eigen's SimplicialLDLT with AMD ordering. Uses the heap.
template <typename System>
class SparseLdlt {
 public:
  using Scalar = typename System::Scalar;
  using Matrix = Eigen::SparseMatrix<Scalar>;
  using Vector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;

  static constexpr std::string_view kName = "sparse LDL^T";

  /// Orders a new pattern, of a lower triangle.
  void analyze(const Matrix& lower) {
    ldlt_ = std::make_unique<Ldlt>();
    ldlt_->analyze(lower);
  }

  /// False where the matrix is not positive definite to the digits of the scalar.
  bool factorize(const Matrix& lower) {
    ldlt_->factorize(lower);
    if (ldlt_->info() != Eigen::Success) return false;
    constexpr Scalar kRounding = 8 * std::numeric_limits<Scalar>::epsilon();
    const Vector pivots = ldlt_->permutationPinv() * ldlt_->vectorD();
    for (Eigen::Index c = 0; c < pivots.size(); ++c) {
      if (!(pivots[c] > kRounding * lower.valuePtr()[lower.outerIndexPtr()[c]])) return false;
    }
    return true;
  }

  /// step = matrix^-1 gradient, both of the matrix's size.
  void solve(const Vector& gradient, Vector& step) { step = ldlt_->solve(gradient); }

 private:
  using Ldlt = detail::SparseFactor<Scalar>;
  std::unique_ptr<Ldlt> ldlt_;  // Eigen's cannot be moved
};

/// Options of SparseNewton.
struct SparseNewtonOptions : AlignedOptions {
  /// Continue from stationary points whose Hessian has a negative eigenvalue, or where linked nodes coincide.
  bool escape_saddles = true;

  /// Begin with strong anchors if they are weak and the start is far from a minimum.
  bool continuation = true;

  constexpr SparseNewtonOptions() = default;
  constexpr SparseNewtonOptions(const SolverOptions& options) : AlignedOptions(options) {}
  constexpr SparseNewtonOptions(const AlignedOptions& options) : AlignedOptions(options) {}
};

/// The names of these options, for an OptionVisitor.
inline void visit_options(OptionVisitor& visit, SparseNewtonOptions& options) {
  visit_options(visit, static_cast<AlignedOptions&>(options));
  visit("escape_saddles", options.escape_saddles);
  visit("continuation", options.continuation);
}

/// Newton's method with a sparse factorisation of the Hessian, for large constellations whose anchors are
/// weak compared with the links: the number of its iterations hardly depends on the anchors, while that of
/// methods without the Hessian grows as they weaken. In the plane a factorisation is about O(N^1.5) in time
/// and O(N log N) in memory for N nodes with local links (George 1973).
///
/// If the Hessian is not positive definite, negative curvature of links and anchors is replaced by 0, and if
/// that matrix is not definite to the scalar's digits (anchors weaker than its epsilon), the diagonal is
/// raised. The line search accepts only lower energies; if it fails, the gradient scaled by the diagonal of
/// K_dyn is tried, which can fail only by rounding.
///
/// If the Hessian at the start is not positive definite, weak anchors are made strong at first, and their
/// minimum is followed as they weaken a hundredfold at a time: while anchors pull the nodes along a curved
/// valley of the links' energy, steps are short, and the minimum hardly moves once anchors are far weaker
/// than links. (Continuation; a floppy cloth needs tens of steps instead of thousands.) The energy of the
/// given system may rise on the way; if the way ends above the start's energy, the solve begins again there.
///
/// Steps with a repaired Hessian, and those that the line search shortens, are short, because springs that
/// fold or buckle make the way down curved, and a factorisation is expensive for a short step. They alternate
/// with L-BFGS (from the diagonal of K_dyn), whose steps cost and count as a hundredth; the length of such a
/// run depends on the gain of those before.
///
/// Summary::positive_definite describes the Hessian at the x returned. `Factorization` is SparseLdlt or
/// CholmodLlt. The ordering is computed once per topology. An object holds its workspace, one thread at a
/// time.
template <typename System, typename Factorization = SparseLdlt<System>>
class SparseNewton {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  SparseNewtonOptions options;

  SparseNewton() = default;
  /// For type deduction: SparseNewton(system).solve(system, x).
  explicit SparseNewton(const System&, const SparseNewtonOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return detail::NameWithPolicy<kMethod, Factorization>::value; }

  /// Moves x (Dim x N), the start, to a local minimum of the energy, or to another stationary point if the
  /// Hessian is singular or the options do not ask to escape saddles. Statuses as for Newton::solve.
  Summary solve(const System& given, Points& x) { return detail::Compiled::solve(*this, given, x); }

 private:
  friend detail::Compiled;

  Summary run(const System& given, Points& x);

  // Moves x to a stationary point of `system`, to `tolerance` if that is more than the stopping rule's.
  Status descend(const System& system, Points& x, Scalar tolerance, Summary& summary);

  // How many times stronger the anchors are at first: so much that they store as much energy at x, where it
  // is `here` in all, as the links, but have no more than kStrongAnchors of the links' stiffness. 1 where the
  // Hessian at x is positive definite, for x is close to a minimum then.
  Scalar strengthening(const System& system, const Points& x, Scalar here, Summary& summary) {
    const Scalar anchors = system.anchor_stiffness.sum();
    const Scalar most = kStrongAnchors * system.link_stiffness.sum();
    if (!(anchors > 0 && most > anchors)) return 1;
    const Scalar held = detail::anchor_energy(system, x);
    const Scalar stretched = here - held;
    const Scalar factor =
        stretched * anchors < most * held ? stretched / held : most / anchors;  // held may be 0
    if (!(factor > 1)) return 1;
    return factorize_hessian(system, x, summary) ? Scalar(1) : factor;
  }

  // Follows the minimum of the system with strong anchors as they weaken to those of `system`.
  void continue_from_strong(const System& system, Points& x, Summary& summary) {
    const Scalar start_energy = energy(system, x);
    Scalar factor = strengthening(system, x, start_energy, summary);
    if (!(factor > 1)) return;
    start_ = x;
    System strong = system;
    for (; factor > 1; factor /= kWeaken) {
      strong.anchor_stiffness = factor * system.anchor_stiffness;
      const Scalar share = strong.anchor_stiffness.sum() / system.link_stiffness.sum();
      descend(strong, x, kRough * share, summary);
    }
    if (!(energy(system, x) <= start_energy)) x = start_;
  }

  static constexpr std::string_view kMethod = "Newton";
  static constexpr Scalar kStrongAnchors = Scalar(5e-3);
  static constexpr Scalar kWeaken = 100;
  static constexpr Scalar kRough = Scalar(1e-3);  // of the anchors' share of the links' stiffness
  static constexpr int kTurn = 100;  // iterations of L-BFGS at least, about a factorisation's cost
  static constexpr int kLongestTurn = 1 << 20;
  using Matrix = typename Factorization::Matrix;
  using MatrixScalar = typename Matrix::Scalar;
  using Vector = Eigen::Matrix<MatrixScalar, Eigen::Dynamic, 1>;

  bool factorize(Summary& summary) {
    ++summary.factorizations;
    return factorization_.factorize(hessian_.matrix());
  }

  // Factors the Hessian; false where it is not positive definite. The blocks of nodes mostly show that, and
  // leave the factorisation out.
  bool factorize_hessian(const System& system, const Points& x, Summary& summary) {
    hessian_.assemble(system, x, false);
    return !hessian_.has_indefinite_block() && factorize(summary);
  }

  // Factors a positive definite matrix in the Hessian's place; false where rounding leaves none. The diagonal
  // is raised by the nodes' stiffness, as its own entries may be 0.
  bool repair(const System& system, const Points& x, Summary& summary) {
    hessian_.assemble(system, x, true);
    for (MatrixScalar shift = 64 * std::numeric_limits<MatrixScalar>::epsilon(); !factorize(summary);
         shift *= 256) {
      if (!(shift < 1)) return false;
      hessian_.raise_diagonal(shift, session_.node_stiffness());
    }
    return true;
  }

  // direction_ = -matrix^-1 g; returns the slope along it.
  Scalar newton_direction(Summary& summary) {
    const Points& gradient = state_.gradient();
    right_hand_side_ = gradient.reshaped().template cast<MatrixScalar>();
    factorization_.solve(right_hand_side_, step_);
    ++summary.linear_solves;
    direction_ = -step_.template cast<Scalar>().reshaped(gradient.rows(), gradient.cols());
    return gradient.cwiseProduct(direction_).sum();
  }

  // Moves x by the direction, or less; taken_ says how much of it.
  bool search(const System& system, Points& x, Scalar slope, Summary& summary) {
    taken_ = 1;
    if (!(slope < 0) || !state_.search(system, x, direction_, slope, taken_, summary)) return false;
    ++summary.iterations;
    return true;
  }

  // A turn of L-BFGS, each kTurn of whose iterations count as one, for max_iterations to bound the work. The
  // next one is longer if this one has lowered the energy by more than the last step of Newton's method did.
  void take_turn(const System& system, Points& x, Scalar gain_of_step, Summary& summary) {
    lbfgs_.options = options;
    lbfgs_.options.align = lbfgs_.options.ground_components = false;
    lbfgs_.options.on_iteration = {};
    lbfgs_.options.gap = 0;
    const int left = options.max_iterations - summary.iterations;
    lbfgs_.options.max_iterations = left < turn_ / kTurn ? left * kTurn : turn_;
    const Scalar before = state_.energy();
    const Summary turn = lbfgs_.solve(system, x);
    if (turn.status == Status::OutOfMemory) detail::raise(std::bad_alloc());
    summary.iterations += 1 + std::max(0, turn.iterations - 1) / kTurn;
    if (!turn.usable()) return;
    summary.energy_evaluations += turn.energy_evaluations;
    summary.gradient_evaluations += turn.gradient_evaluations;
    state_.start(system, x, summary);
    turn_ = before - state_.energy() > gain_of_step ? std::min(2 * turn_, kLongestTurn)
                                                    : std::max(turn_ / 2, kTurn);
  }

  // Writes a direction of negative curvature into direction_ and returns its curvature or more; 0 if there is
  // none, or no memory for more factorisations. The policy's factors may have stopped at the first pivot
  // that is not positive; those of Eigen's L D L^T go on unless it is 0, as it often is where motions are
  // free; then the diagonal is raised by a small share of the nodes' stiffness.
  Scalar negative_curvature(const System& system, const Points& x, Summary& summary) {
    const MatrixScalar raise = std::sqrt(std::numeric_limits<MatrixScalar>::epsilon());
    MatrixScalar curvature = 0;
    detail::attempt<std::bad_alloc>(
        [&] {
          detail::SparseFactor<MatrixScalar> factor;
          hessian_.assemble(system, x, false);
          factor.analyze(hessian_.matrix());
          for (const MatrixScalar share : {MatrixScalar(0), raise}) {
            if (share > 0) hessian_.raise_diagonal(share, session_.node_stiffness());
            factor.factorize(hessian_.matrix());
            ++summary.factorizations;
            curvature = factor.negative_curvature(step_);
            if (curvature < 0) return;
          }
        },
        [&](const std::bad_alloc&) { curvature = 0; });
    if (curvature < 0) direction_ = step_.template cast<Scalar>().reshaped(x.rows(), x.cols());
    return static_cast<Scalar>(curvature);
  }

  // From a saddle or peak down.
  bool escape(const System& system, Points& x, Summary& summary) {
    Scalar curvature = detail::direction_off_peak(system, x, direction_);
    if (curvature == 0) curvature = negative_curvature(system, x, summary);
    if (!(curvature < 0)) return false;
    const Scalar t = detail::step_off_saddle(system, x, state_.energy(), session_.length(), curvature,
                                             direction_, next_x_, summary);
    if (t == 0) return false;
    x += t * direction_;
    state_.start(system, x, summary);
    ++summary.iterations;
    return true;
  }

  Session<System> session_;
  detail::DefiniteVerdict<System> verdict_;
  detail::DescentState<System> state_;
  detail::SparseHessian<System, MatrixScalar> hessian_;
  Factorization factorization_;
  Lbfgs<System, JacobiMetric<System>> lbfgs_;
  int turn_ = kTurn;
  Scalar taken_ = 1;
  Vector right_hand_side_;
  Vector step_;
  Points direction_;
  Points next_x_;
  Points start_;
};

template <typename System, typename Factorization>
Summary SparseNewton<System, Factorization>::run(const System& given, Points& x) {
  return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
    hessian_.prepare(system, [this](const auto& pattern) { factorization_.analyze(pattern); });
    if (options.continuation) continue_from_strong(system, x, summary);
    const Status reason = descend(system, x, 0, summary);
    verdict_.check(system, x, summary);
    return reason;
  });
}

template <typename System, typename Factorization>
Status SparseNewton<System, Factorization>::descend(const System& system, Points& x, Scalar tolerance,
                                                    Summary& summary) {
  const bool realign = options.align && detail::has_weak_anchors(system);
  state_.start(system, x, summary);
  turn_ = kTurn;
  bool turned = false;  // the last iteration was L-BFGS's
  Scalar gain = 0;      // of the last step of Newton's method
  while (true) {
    if (tolerance > 0) {  // the gradient is not that of the system that is solved
      session_.report(x, summary.iterations);
    } else {
      session_.report(x, state_.gradient(), summary.iterations);
    }
    const bool stationary = session_.stationary(state_.gradient(), tolerance);
    const bool last = summary.iterations == options.max_iterations || session_.stopped();
    if (last && !stationary) {
      summary.positive_definite = -1;
      return Status::MaxIterations;
    }
    if (!stationary && session_.stalls(x, state_.gradient(), summary.iterations)) {
      summary.positive_definite = -1;
      return Status::NoProgress;
    }
    bool definite = false;
    if (stationary || !turned) {
      if (stationary) {  // to escape needs the factors
        hessian_.assemble(system, x, false);
        definite = factorize(summary);
      } else {
        definite = factorize_hessian(system, x, summary);
      }
      summary.positive_definite = definite;
    }
    if (last) return Status::Converged;
    if (stationary && !(definite && detail::peaked_link(system, x) < 0)) {
      if (!(options.escape_saddles && escape(system, x, summary))) return Status::Converged;
      continue;
    }
    if (!definite && !turned) {
      take_turn(system, x, gain, summary);
      turned = true;
      continue;
    }
    const bool after_turn = turned;
    turned = false;
    const Scalar before = state_.energy();
    // Where forces are below the tolerance but, for weak anchors, the energy is not, goes on.
    const Scalar slope = definite || repair(system, x, summary) ? newton_direction(summary) : Scalar(0);
    if (stationary && !(-slope > 2 * session_.tolerance() * detail::energy_scale(system, x, state_.energy())))
      return Status::Converged;
    if (!search(system, x, slope, summary)) {
      if (stationary) return Status::Converged;
      if (after_turn) {  // which may have led to where the Hessian needs no repair
        definite = factorize_hessian(system, x, summary);
        summary.positive_definite = definite;
      }
      if (!(after_turn && definite && search(system, x, newton_direction(summary), summary))) {
        detail::scaled_descent(session_.node_stiffness(), state_.gradient(), direction_);
        const Scalar steepest = state_.gradient().cwiseProduct(direction_).sum();
        if (!search(system, x, steepest, summary)) return Status::NoProgress;
      }
    }
    // Weak anchors leave a narrow valley, curved as the constellation turns, that straight steps have to
    // follow.
    if (realign && detail::align(system, x, false)) state_.start(system, x, summary);
    gain = before - state_.energy();
    if (definite && taken_ < 1 && summary.iterations < options.max_iterations) {
      take_turn(system, x, gain, summary);
    }
  }
}

ASTERISM_COMPILED_SPARSE_SOLVER(SparseNewton)

}  // namespace ASTERISM_ABI
}  // namespace asterism
