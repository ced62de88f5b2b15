#pragma once

#include <Eigen/LU>
#include <algorithm>
#include <asterism/solver/detail/compiled.hpp>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/descent.hpp>
#include <asterism/solver/detail/hessian_operator.hpp>
#include <asterism/solver/detail/policy_name.hpp>
#include <asterism/solver/detail/spring_chunks.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/executor.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Preconditioner of NewtonCg: the Dim x Dim diagonal blocks of the Hessian, in which negative curvature of a
/// spring is replaced by 0.
template <typename System>
class JacobiPreconditioner {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;
  static constexpr std::string_view kName = "Jacobi";
  static constexpr int kDim = System::kDim;

  /// At a new x, with the operator of the Hessian.
  void update(const System& system, const Points& x, detail::HessianOperator<System>& hessian,
              detail::SpringChunks<System>& chunks) {
    blocks_.resize(kDim, kDim * system.nodes());
    hessian.resize(system);
    chunks.template scatter<kDim, false>(
        system, blocks_,
        [&](int i, Scalar&) {
          const typename System::Point offset = detail::anchor_offset(system, i, x);
          hessian.set_anchor(system, i, offset);
          at(i) = detail::anchor_curvature(system, i, offset, true);
        },
        [&](int l, const Link& link, Scalar&) {
          const auto spring = detail::spring(system, link, detail::link_difference(system, l, link, x));
          auto force = detail::link_force(system, l, spring);
          hessian.set_link(l, force, spring);
          force = force.clamped();
          force.along = std::max(force.along, kFloor * system.link_stiffness[l]);
          return detail::link_curvature(force, spring);
        },
        [this](int i) {  // a node on parallel springs alone would have a singular block
          const Scalar trace = at(i).trace();
          if (!(trace > 0)) {  // fixed, and no spring at it has stiffness
            at(i).setIdentity();
            return;
          }
          const Block scaled = at(i) / trace + kFloor * Block::Identity();
          at(i) = scaled.inverse() / trace;
        });
  }

  /// z <- -M^-1 g, for `count` nodes from `first`.
  void descend(const Points& gradient, Points& z, int first, int count) const {
    for (int i = first; i < first + count; ++i) {
      z.col(i) = -(blocks_.template block<kDim, kDim>(0, kDim * i) * gradient.col(i));
    }
  }

 private:
  using Block = Eigen::Matrix<Scalar, kDim, kDim, Eigen::ColMajor>;
  static constexpr Scalar kFloor = Scalar(1e-3);

  auto at(int i) { return blocks_.template block<kDim, kDim>(0, kDim * i); }

  detail::NodeBlocks<System> blocks_;
};

/// Truncated Newton: conjugate gradients compute the Newton step, more accurately close to a solution.
///
/// The Hessian, a spring's curvature across it included (1 - mu_ij / r_ij), is applied spring by spring and
/// never assembled. The inner iteration stops at the forcing term of Eisenstat and Walker (1996, choice 2),
/// or at a direction without positive curvature, as in line search Newton-CG (Nocedal & Wright, algorithm
/// 7.1). Memory and an inner iteration are O(nodes + links): the method for large sparse systems.
///
/// ThreadedOptions::threads counts from 32,768 nodes on, where near nodes have near numbers and links come in
/// the order of their lower nodes: elsewhere threads would wait for memory.
///
/// `Preconditioner` is JacobiPreconditioner (default) or DenseCholesky, SparseCholesky or CholmodCholesky of
/// K_dyn. An object holds its workspace: reuse it to solve without allocation, one thread at a time.
template <typename System, typename Preconditioner = JacobiPreconditioner<System>>
class NewtonCg {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  ThreadedOptions options;

  NewtonCg() = default;
  /// For type deduction: NewtonCg(system).solve(system, x).
  explicit NewtonCg(const System&, const ThreadedOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return detail::NameWithPolicy<kMethod, Preconditioner>::value; }

  /// Moves x (Dim x N), the start, to a stationary point of the energy. An iteration is an update of x; a
  /// linear solve is an application of the preconditioner. Statuses as for Ida::solve.
  Summary solve(const System& given, Points& x) { return detail::Compiled::solve(*this, given, x); }

 private:
  friend detail::Compiled;

  Summary run(const System& given, Points& x);

  using Chunks = detail::SpringChunks<System>;

  static constexpr std::string_view kMethod = "Newton-CG";
  static constexpr bool kFactored = requires(Preconditioner p, const System& s) { p.factorize(s); };
  static constexpr Scalar kLargestForcing = Scalar(0.5);

  // preconditioned_ = -M^-1 r. Returns r^T M^-1 r.
  Scalar precondition(const Points& r, Summary& summary) {
    ++summary.linear_solves;
    if constexpr (kFactored) {
      preconditioned_.setZero(System::kDim, r.cols());
      preconditioner_.descend(r, preconditioned_);
      return -chunks_.dot(r, preconditioned_);
    } else {
      preconditioned_.resize(System::kDim, r.cols());
      return -chunks_.sum([&](int first, int count) { return precondition(r, first, count); });
    }
  }
  // The same for some nodes. Returns minus their part of the product.
  Scalar precondition(const Points& r, int first, int count) {
    preconditioner_.descend(r, preconditioned_, first, count);
    return Chunks::columns(r, first, count)
        .cwiseProduct(Chunks::columns(preconditioned_, first, count))
        .sum();
  }

  // direction_: H direction_ = -g to |residual| <= forcing |g| in the norm of M^-1. Expects preconditioned_.
  void newton_direction(const System& system, Scalar square, Scalar forcing, Summary& summary) {
    const Scalar target = forcing * forcing * square;
    const int most = 10 + 4 * System::kDim * system.nodes();
    direction_.setZero(System::kDim, system.nodes());
    residual_ = state_.gradient();
    conjugate_ = preconditioned_;
    Scalar length = square;  // of conjugate_, squared, in M
    for (int inner = 0; inner < most; ++inner) {
      hessian_.apply(system, conjugate_, product_, chunks_);
      const Scalar curvature = chunks_.dot(conjugate_, product_);
      if (!(curvature > kFlat * length)) {
        if (inner == 0) direction_ = conjugate_;
        return;
      }
      const Scalar step = square / curvature;
      const auto advance = [&](int first, int count) {
        Chunks::columns(direction_, first, count) += step * Chunks::columns(conjugate_, first, count);
        Chunks::columns(residual_, first, count) += step * Chunks::columns(product_, first, count);
      };
      Scalar next_square = 0;
      if constexpr (kFactored) {
        chunks_.for_each(advance);
        next_square = precondition(residual_, summary);
      } else {
        ++summary.linear_solves;
        next_square = -chunks_.sum([&](int first, int count) {
          advance(first, count);
          return precondition(residual_, first, count);
        });
      }
      if (!(next_square > target) || session_.stopped()) return;
      const Scalar beta = next_square / square;
      chunks_.for_each([&](int first, int count) {
        auto&& conjugate = Chunks::columns(conjugate_, first, count);
        conjugate = Chunks::columns(preconditioned_, first, count) + beta * conjugate;
      });
      length = next_square + beta * beta * length;
      square = next_square;
    }
  }

  static constexpr Scalar kFlat = 16 * std::numeric_limits<Scalar>::epsilon();

  Session<System> session_;
  detail::DescentState<System> state_;
  Chunks chunks_;
  detail::HessianOperator<System> hessian_;
  Preconditioner preconditioner_;
  Points direction_;
  Points residual_;
  Points conjugate_;
  Points product_;
  Points preconditioned_;
};

template <typename System, typename Preconditioner>
Summary NewtonCg<System, Preconditioner>::run(const System& given, Points& x) {
  return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
    if constexpr (kFactored) {
      ++summary.factorizations;
      if (!preconditioner_.factorize(system)) {
        summary.message =
            "K_dyn is not positive definite: the anchors are too weak compared with the springs for this "
            "scalar";
        return Status::NumericalFailure;
      }
    }
    chunks_.set(system, detail::thread_count(options.threads));
    const auto evaluate = [this](const System& of, const Points& at, Points& gradient) {
      return chunks_.energy_and_gradient(of, at, gradient);
    };
    state_.start(system, x, summary, evaluate);
    Scalar forcing = kLargestForcing;
    Scalar previous_square = 0;
    while (true) {
      if (session_.done(x, state_.gradient(), summary.iterations)) return Status::Converged;
      if (summary.iterations == options.max_iterations) return Status::MaxIterations;
      if (session_.stalls(x, state_.gradient(), summary.iterations)) return Status::NoProgress;

      if constexpr (kFactored) {
        hessian_.set(system, x);
      } else {
        preconditioner_.update(system, x, hessian_, chunks_);
      }
      const Scalar square = precondition(state_.gradient(), summary);  // |g|^2 in M^-1
      if (!(square > 0)) return Status::NoProgress;
      if (summary.iterations > 0) {
        // eta = 0.9 (|g| / |g before|)^2, and not much below the last one while that was large.
        const Scalar before = Scalar(0.9) * forcing * forcing;
        forcing = Scalar(0.9) * square / previous_square;
        if (before > Scalar(0.1)) forcing = std::max(forcing, before);
        forcing = std::min(forcing, kLargestForcing);
      }
      previous_square = square;
      newton_direction(system, square, forcing, summary);

      Scalar slope = chunks_.dot(state_.gradient(), direction_);
      Scalar step = 1;
      if (!(slope < 0) || !state_.search(system, x, direction_, slope, step, summary, evaluate)) {
        // The preconditioned gradient: fails for rounding alone.
        precondition(state_.gradient(), summary);
        slope = -square;
        step = 1;
        if (!state_.search(system, x, preconditioned_, slope, step, summary, evaluate))
          return Status::NoProgress;
      }
      ++summary.iterations;
    }
  });
}

ASTERISM_COMPILED_SOLVER(NewtonCg)

}  // namespace ASTERISM_ABI
}  // namespace asterism
