#include <algorithm>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "definite.hpp"
#include "lbfgs.hpp"
#include "loss.hpp"
#include "matrix.hpp"
#include "methods.hpp"
#include "run.hpp"
#include "stopping_rule.hpp"

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

// Whether the block of a node alone shows that the matrix is not positive definite.
bool has_indefinite_block(const SystemMatrix& matrix, int nodes, int dim) {
  if (matrix.is_dense() || matrix.is_shared()) return false;
  Eigen::MatrixXd block(dim, dim);
  for (int i = 0; i < nodes; ++i) {
    block.setZero();
    for (int c = 0; c < dim; ++c) {
      for (SystemMatrix::Sparse::InnerIterator at(matrix.sparse(), dim * i + c); at; ++at) {
        if (at.row() >= dim * (i + 1)) break;
        block(at.row() - dim * i, c) = at.value();
      }
    }
    for (int c = 0; c < dim; ++c) {  // elimination
      if (!(block(c, c) > 0)) return true;
      for (int k = c + 1; k < dim; ++k) {
        for (int r = k; r < dim; ++r) block(r, k) -= block(r, c) * block(k, c) / block(c, c);
      }
    }
  }
  return false;
}

// What weak anchors and the other terms have in all.
struct Shares {
  double anchors = 0, others = 0;  // stiffness
  double held = 0;                 // energy of the anchors
};

bool is_anchor(const Term& term) {
  return term.size() > 0 && term.arity() == 1 && term.role(0) == Term::Role::Holds &&
         std::any_of(term.columns().begin(), term.columns().end(),
                     [](const Column& column) { return column.name == "stiffness"; });
}

Shares shares_at(const System& system, const Eigen::MatrixXd& x) {
  Shares result;
  const Scales scales = scales_of(system, x);
  for (int t = 0; t < system.term_count(); ++t) {
    if (is_anchor(system.term(t))) result.held += system.term(t).energy(x, nullptr);
  }
  for (const Scales::Place& place : scales.places) result.anchors += place.stiffness;
  result.others = (scales.stiffness.sum() - result.anchors) / 2;
  return result;
}

System with_anchors_times(const System& system, double factor) {
  System result = system;
  for (int t = 0; t < result.term_count(); ++t) {
    if (is_anchor(result.term(t))) result.term(t).values("stiffness") *= factor;
  }
  return result;
}

class NewtonSolve {
 public:
  NewtonSolve(SystemRun& run, const SystemNewton& method)
      : run_(run),
        method_(method),
        options_(method.options),
        is_large_(run.x().size() > kSmall),
        factor_(make_factorization()),
        clamped_factor_(make_factorization()) {}

  Status iterate() {
    int escapes = 0;
    bool is_start = true;
    bool has_turned = false;  // the last iteration was a turn
    double gain = 0;          // of the last step
    while (true) {
      const bool is_over = run_.is_over();
      if (is_over && run_.end() != Status::Converged) return run_.end();
      bool is_definite = false;
      if (is_over || !has_turned) {
        matrix_.assemble(run_.system(), run_.x(), Curvature::True);
        // To leave a saddle needs the factors.
        if (is_over || !has_indefinite_block(matrix_, run_.system().nodes(), run_.system().dim())) {
          ++run_.summary().factorizations;
          is_definite = factor_.factorize(matrix_);
        }
      }
      if (is_over) {
        run_.summary().positive_definite = is_definite;
        if (is_definite &&
            !is_surely_definite(run_.system(), run_.x(), run_.gradient(), run_.rule(), matrix_, factor_))
          run_.summary().positive_definite.reset();
        const bool goes_on =
            is_definite ? is_large_ && descend_further() : escapes++ < kMaxEscapes && escape();
        if (!goes_on) return run_.end();
        continue;
      }
      if (!is_definite && !has_turned && is_large_) {
        if (is_start && options_.continuation && continue_from_strong()) {
          is_start = false;
          continue;
        }
        is_start = false;
        if (turns_pay()) {
          take_turn(gain);
          has_turned = true;
          continue;
        }
      }
      is_start = has_turned = false;
      const double before = run_.energy();
      double taken = 0;
      if (is_definite) taken = newton_step();
      repaired_ = is_definite || is_large_ ? 0 : repaired_ + 1;
      if (repaired_ == kPatience) {
        repaired_ = 0;
        if (options_.escape_saddles && bend()) continue;
      }
      if (taken == 0 && !repaired_step()) return Status::NoProgress;
      if (turns_easily()) run_.align(false);
      gain = before - run_.energy();
      if (taken > 0 && taken < 1 && is_large_ && run_.summary().iterations < options_.max_iterations &&
          turns_pay())
        take_turn(gain);
    }
  }

 private:
  std::unique_ptr<SparseFactorization> make_factorization() const {
    return method_.make_factorization ? method_.make_factorization() : nullptr;
  }

  static constexpr int kSmall = 64;  // unknowns
  static constexpr int kMaxEscapes = 50;
  // Repaired steps before a direction of negative curvature is taken: they creep towards saddles. Chosen from
  // 4, 8, 16, 32 and none on 1440 collinear starts; on 2880 others it takes .4 times the iterations of none.
  static constexpr int kPatience = 4;
  static constexpr int kTurn = 100;  // iterations of a turn at least
  static constexpr int kLongestTurn = 1 << 20;

  // Whether anchors hold on to the nodes by less than a tenth of what the other terms hold: they leave a
  // narrow valley, curved as the constellation turns, that straight steps have to follow.
  bool turns_easily() {
    if (!options_.align || is_large_) return false;  // turns of L-BFGS follow it
    if (!has_weak_anchors_) {
      const Shares shares = shares_at(run_.system(), run_.x());
      has_weak_anchors_ = 10 * shares.anchors < shares.others;
    }
    return *has_weak_anchors_;
  }

  // From a saddle down; false where there is no way that rounding does not hide.
  bool escape() { return options_.escape_saddles && run_.rule().reached(run_.gradient()) && bend(); }

  // Down along a direction of negative curvature, also before a saddle is reached.
  bool bend() {
    Eigen::VectorXd v = factor_.negative_direction(matrix_);
    if (v.size() == 0) return false;
    const double curvature = bend_downwards(v);
    // What rounding may have made of a free motion is none.
    if (!(curvature < -1e-9)) return false;
    // Where linked nodes nearly coincide, the curvature has no limit, but holds over next to no distance.
    if (!leave_saddle(run_, v, std::max(curvature, -1.0))) return false;
    ++run_.summary().iterations;
    return true;
  }

  // Improves v, a direction of negative curvature, and returns its curvature. Each round minimises
  // v^T H v / v^T A v over the plane of v and the quotient's gradient; A has the nodes' stiffness. A pivot's
  // direction may bend stiff springs, of which its curvature hardly shows anything.
  double bend_downwards(Eigen::VectorXd& v) const {
    constexpr int kRounds = 20;
    Eigen::VectorXd A(matrix_.rows());
    for (int i = 0; i < A.size(); ++i) {
      A[i] = i < run_.x().size() ? run_.rule().node_stiffness()[i / run_.system().dim()]
                                 : std::abs(matrix_.diagonal(i));
    }
    const auto norm_of = [&A](const Eigen::VectorXd& w) { return std::sqrt(w.cwiseAbs2().dot(A)); };
    const double size = norm_of(v);
    if (!(size > 0)) return 0;
    v /= size;
    Eigen::VectorXd Hv = matrix_ * v;
    for (int round = 0; round < kRounds; ++round) {
      const double curvature = v.dot(Hv);
      Eigen::VectorXd w = (A.array() > 0).select(Hv.array() / A.array() - curvature * v.array(), 0.0);
      const double size_of_w = norm_of(w);
      if (!(size_of_w > 0)) break;
      w /= size_of_w;
      const Eigen::VectorXd Hw = matrix_ * w;
      const double mixed = w.dot(Hv), other = w.dot(Hw);
      // The lower eigenvector of [curvature mixed; mixed other].
      const double half = (other - curvature) / 2;
      const double lower = curvature + half - std::hypot(half, mixed);
      if (!(lower < curvature)) break;
      v = mixed * v + (lower - curvature) * w;
      const double size_of_v = norm_of(v);
      if (!(size_of_v > 0)) break;
      v /= size_of_v;
      Hv = (mixed / size_of_v) * Hv + ((lower - curvature) / size_of_v) * Hw;
    }
    return v.dot(matrix_ * v);
  }

  // Where forces are below the tolerance but, for weak anchors, the energy is not.
  bool descend_further() {
    if (!run_.rule().reached(run_.gradient()) || options_.gap > 0 || options_.stopped() ||
        run_.summary().iterations >= options_.max_iterations)
      return false;
    const Eigen::MatrixXd direction = -factor_.solve(run_.gradient());
    const double slope = run_.gradient().cwiseProduct(direction).sum();
    double step = 1;
    if (!(-slope > 2 * run_.rule().tolerance() * energy_scale(run_.system(), run_.x(), run_.energy())) ||
        !run_.search(direction, step))
      return false;
    ++run_.summary().iterations;
    return true;
  }

  // A step by the factored Hessian; returns how much of it was taken, 0 where it is not to be trusted.
  double newton_step() {
    ++run_.summary().linear_solves;
    const Eigen::MatrixXd direction = -factor_.solve(run_.gradient());
    double step = 1;
    if (run_.trusted_step(direction) < 1 || !run_.search(direction, step)) return 0;
    ++run_.summary().iterations;
    return step;
  }

  // A step by the matrix without the elements' negative curvature; false where rounding leaves none.
  bool repaired_step() {
    constexpr double kLeastShare = 1e-9, kMostShare = 1e3;
    bool has_moved = false, is_whole = false;
    while (!has_moved) {
      clamped_.assemble(run_.system(), run_.x(), Curvature::Clamped);
      clamped_.shift(run_.rule().node_stiffness(), share_);
      ++run_.summary().factorizations, ++run_.summary().linear_solves;
      if (clamped_factor_.factorize(clamped_)) {
        const Eigen::MatrixXd direction = -clamped_factor_.solve(run_.gradient());
        double step = run_.trusted_step(direction);
        const double first = step;
        has_moved = run_.search(direction, step);
        is_whole = has_moved && step == first;
      }
      // A step that was not cut short was trusted too little.
      share_ = std::max(is_whole ? share_ / 10 : share_ * 4, kLeastShare);
      if (!has_moved && share_ > kMostShare) return false;
    }
    share_ = std::min(share_, 1.0);
    ++run_.summary().iterations;
    return true;
  }

  // Beside a thin factor, a turn of L-BFGS costs some twenty factorisations.
  bool turns_pay() {
    if (!turns_pay_) turns_pay_ = !factor_.is_thin(matrix_);
    return *turns_pay_;
  }

  // A turn of L-BFGS from the nodes' stiffness, each kTurn of whose iterations count as one, for
  // max_iterations to bound the work. The next one is longer if this one has lowered the energy by more than
  // the last step did.
  void take_turn(double gain_of_step) {
    const Eigen::RowVectorXd inverse = run_.rule().node_stiffness().cwiseInverse().transpose();
    const auto descend = [&inverse](const Eigen::MatrixXd& v, Eigen::MatrixXd& result) {
      result.noalias() = v * (-inverse).asDiagonal();
    };
    const int left = options_.max_iterations - run_.summary().iterations;
    const int most = left < turn_ / kTurn ? left * kTurn : turn_;
    const double before = run_.energy();
    LbfgsSteps steps(run_, descend);
    int taken = 0;
    while (taken < most && !run_.rule().reached(run_.gradient()) && !options_.stopped() && steps.advance())
      ++taken;
    run_.summary().iterations += 1 + std::max(0, taken - 1) / kTurn;
    turn_ = before - run_.energy() > gain_of_step ? std::min(2 * turn_, kLongestTurn)
                                                  : std::max(turn_ / 2, kTurn);
  }

  // Follows the minimum of the system with strong anchors as they weaken to the given ones: at first so
  // strong that they store as much energy as the other terms, but with no more than kStrong of their
  // stiffness. False, with x as it was, where anchors are not weak, or the way ends above the start.
  bool continue_from_strong() {
    constexpr double kStrong = 5e-3, kWeaken = 100;
    constexpr double kRough = 1e-3;  // tolerance of the anchors' share of the stiffness
    const Shares shares = shares_at(run_.system(), run_.x());
    const double most = kStrong * shares.others;
    if (!(shares.anchors > 0 && most > shares.anchors)) return false;
    const double stretched = run_.energy() - shares.held;
    double factor = stretched * shares.anchors < most * shares.held ? stretched / shares.held
                                                                    : most / shares.anchors;  // held may be 0
    if (!(factor > 1)) return false;
    Eigen::MatrixXd x = run_.x(), gradient;
    Summary work;
    work.iterations = 0;
    bool is_stopped = false;
    auto report = [&](const Iteration& at) {  // of the given system
      if (at.number == 0) return true;
      const double here = energy_and_gradient(run_.system(), at.x, gradient);
      is_stopped = !run_.pass_on(
          {run_.summary().iterations + work.iterations + at.number, here, gradient.norm(), at.x});
      return !is_stopped;
    };
    for (; factor > 1 && !is_stopped && !options_.stopped(); factor /= kWeaken) {
      SystemNewton stage = method_;
      stage.options.continuation = stage.options.escape_saddles = stage.options.hold_floating = false;
      stage.options.on_iteration = {};
      if (options_.on_iteration) stage.options.on_iteration = report;
      stage.options.gap = 0;
      stage.options.tolerance =
          std::max(options_.tolerance, kRough * factor * shares.anchors / shares.others);
      const int left = options_.max_iterations - run_.summary().iterations - work.iterations;
      if (left <= 0) break;
      stage.options.max_iterations = left;
      const Summary part = stage.solve(with_anchors_times(run_.system(), factor), x);
      if (part.status == Status::OutOfMemory) raise(LackOfMemory(part.message));
      work.add_work(part);
    }
    if (!(energy(run_.system(), x) <= run_.energy())) x = run_.x();
    run_.summary().add_work(work);
    const double before = run_.energy();
    run_.move_to(x);
    return run_.energy() < before;
  }

  SystemRun& run_;
  const SystemNewton& method_;
  const SystemNewtonOptions& options_;
  bool is_large_;
  SystemMatrix matrix_{SystemMatrix::Storage::Best}, clamped_{SystemMatrix::Storage::Best};
  SystemFactor factor_, clamped_factor_;
  std::optional<bool> has_weak_anchors_, turns_pay_;
  int repaired_ = 0;     // steps one after the other
  double share_ = 1e-3;  // of the nodes' stiffness, in repaired steps
  int turn_ = kTurn;
};

}  // namespace

Summary SystemNewton::solve(const System& system, Eigen::MatrixXd& x) const {
  return SystemRun::solve(name(), options, system, x, [this](SystemRun& run) {
    return run.lacks_hessian() ? Status::InvalidInput : NewtonSolve(run, *this).iterate();
  });
}

}  // namespace detail

AnySolver<System> newton_by(std::string_view name,
                            std::function<std::unique_ptr<SparseFactorization>()> make) {
  return AnySolver<System>(detail::SystemNewton{{}, name, std::move(make)});
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
