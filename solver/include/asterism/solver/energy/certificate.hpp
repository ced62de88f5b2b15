#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/scratch.hpp>
#include <asterism/solver/energy/certifier_reference.hpp>
#include <asterism/solver/energy/dense_bound.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/minoriser.hpp>
#include <asterism/solver/energy/proof.hpp>
#include <asterism/solver/energy/sparse_bound.hpp>
#include <asterism/solver/matrix/sparse_factor.hpp>
#include <asterism/solver/problem/compiled_types.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <cmath>
#include <limits>
#include <memory>
#include <new>
#include <optional>
#include <ostream>
#include <string_view>
#include <type_traits>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// Certifies systems in double, whose values are valid.
template <typename System, typename SparseFactor>
class Prover {
 public:
  using Points = typename System::Points;

  /// See asterism::certify, for the tolerance `gap`.
  void certify(const System& system, const Points& x, double gap, Certificate& result);

 private:
  using Lower = Minoriser<System>;
  static constexpr double kStrainless = 1e-10;
  static constexpr bool kRobust = !std::is_same_v<typename System::Model::AnchorLoss, Quadratic>;

  // Fixes the first node of every component that nothing holds; returns whether there is one.
  bool hold(const System& system) {
    bool floats = false;
    held_.setConstant(system.nodes(), false);
    for_each_floating_component(system, scratch_, [&](int i) { held_[i] = floats = true; });
    return floats;
  }

  void set(const System& system, const Points& x, bool clamp) {
    floor_ = system.has_loads() ? -std::numeric_limits<double>::infinity() : 0;
    quadratic_.set(system, x, clamp, [this](int i) { return held_[i]; });
  }

  // A lower bound of all energies, by the minoriser.
  double lowest(const MinoriserBound& bound) const {
    return std::max(floor_, quadratic_.energy - bound.excess - Lower::kEpsilon * quadratic_.energy_rounding);
  }

  MinoriserBound factor(const System& system, bool is_clamped = false) {
    if constexpr (System::kMaxNodes == Eigen::Dynamic) {
      if (is_large_and_sparse(system)) return sparse_.bound(system, quadratic_, is_clamped);
    }
    return dense_.bound(system, quadratic_);
  }

  struct Nothing {};

  double floor_ = 0;  // no energy is lower
  Lower quadratic_;
  DenseBound<times<System::kNodes>(Lower::kBlock), times<System::kMaxNodes>(Lower::kBlock)> dense_;
  [[no_unique_address]] std::conditional_t<System::kMaxNodes == Eigen::Dynamic,
                                           SparseBound<SparseFactor, Lower::kBlock>, Nothing>
      sparse_;
  ComponentScratch<System> scratch_;
  Eigen::Array<bool, System::kNodes, 1, Eigen::ColMajor, System::kMaxNodes, 1> held_;
};

template <typename System, typename SparseFactor>
void Prover<System, SparseFactor>::certify(const System& system, const Points& x, double gap,
                                           Certificate& result) {
  if (const int i = first_floating_load(system, scratch_); i >= 0) {
    result.reason = Defect{"node", i, "has a load and is in a connected component that nothing holds"};
    result.lower_bound = -std::numeric_limits<double>::infinity();  // the energy falls without end
    return;
  }
  const bool floats = hold(system);
  set(system, x, false);
  result.lower_bound = floor_;
  result.energy = kRobust ? asterism::energy(system, x) : quadratic_.energy;
  if (!is_finite(quadratic_.energy_rounding) || !all_finite(quadratic_.gradient) ||
      !all_finite(quadratic_.scale) || !all_finite(quadratic_.gradient_scale) || !is_finite(result.energy)) {
    result.reason = "energy, gradient or curvature leave the range of the scalar";
    return;
  }
  const double energy = quadratic_.energy;
  const double rounding = Lower::kEpsilon * quadratic_.energy_rounding;
  result.proof = Proof::NotCertified;
  MinoriserBound bound;
  if (quadratic_.peaked_link >= 0) {
    result.reason = Defect{"link", quadratic_.peaked_link, "has ends that coincide: x is not a minimum"};
  } else {
    bound = factor(system);
    result.least_eigenvalue = bound.least_eigenvalue;
  }
  const double lowest = this->lowest(bound);
  const double negligible = gap * std::max(quadratic_.energy_scale(), kStrainless * quadratic_.stored) +
                            quadratic_.coordinate_rounding + rounding;
  if (bound.is_definite) {
    if (!kRobust) result.lower_bound = lowest;
    // Global minima and x are within sqrt(2 excess) of the minoriser's minimum, by the norm of W.
    if (!kRobust && !floats)
      result.distance = std::sqrt(8 * (bound.excess + 2 * rounding) / bound.least_eigenvalue);
    if (energy - lowest > negligible) {
      result.reason = "the gap is above the tolerance: x is not stationary enough, or rounding is too large";
    } else if (kRobust) {
      result.proof = Proof::ReweightedMinimum;
    } else if (!floats && quadratic_.stays_definite(result.distance, bound.least_eigenvalue)) {
      result.proof = Proof::UniqueGlobalMinimum;
    } else {
      result.proof = Proof::GlobalMinimum;
    }
    return;
  }
  if (energy - floor_ <= negligible) {
    result.proof = kRobust ? Proof::ReweightedMinimum : Proof::GlobalMinimum;
    result.reason.clear();
    return;
  }
  if (result.reason.empty()) {
    result.reason = bound.least_eigenvalue < 0 ? "W has a negative eigenvalue: there may be a lower minimum"
                                               : "rounding errors hide whether W is positive definite";
  }
  if (kRobust) return;
  set(system, x, true);
  bound = factor(system, true);
  if (bound.is_definite) result.lower_bound = this->lowest(bound);
}

}  // namespace detail

/// Certifies placements, with a workspace: reuse it to certify without allocation, one thread at a time.
/// `SparseFactor` is Eigen's or, from <asterism/solver/method/cholmod.hpp>, CholmodProof; it serves systems
/// of many nodes with few links each. See certify.
template <typename System, typename SparseFactor = detail::SparseFactor<double>>
class Certifier {
 public:
  using Points = typename System::Points;

  CertifyOptions options;

  Certifier() = default;
  /// For type deduction: Certifier(system).certify(system, x).
  explicit Certifier(const System&, const CertifyOptions& o = {}) : options(o) {}

  /// See asterism::certify.
  Certificate certify(const System& system, const Points& x) {
    Certificate result;
    const auto work = [&] {
      if (const char* problem = options.problem()) {
        result.reason = problem;
        return;
      }
      if (const Defect defect = detail::validate_values(system, x)) {
        result.reason = defect;
        return;
      }
      if constexpr (!detail::has_minoriser<typename System::Model::LinkPotential>()) {
        result.reason = "the links' potential is not declared to be convex in the square of the length";
      } else if constexpr (std::is_same_v<typename System::Scalar, double>) {
        prover(system).certify(system, x, options.gap, result);
      } else {
        prover(system).certify(system.template cast<double>(), x.template cast<double>(), options.gap,
                               result);
      }
    };
    detail::attempt<std::bad_alloc>(work, [&result](const std::bad_alloc& error) {
      result = Certificate();
      result.reason = detail::memory_message(error);
    });
    return result;
  }

  /// The bounds that are proven of x for a solver, if any, to this gap instead of the option. See
  /// CertifierReference.
  std::optional<EnergyBounds> bounds(const System& system, const Points& x, double gap) {
    const double own = std::exchange(options.gap, gap);
    const Certificate certificate = certify(system, x);
    options.gap = own;
    if (certificate.proof == Proof::NotApplicable) return std::nullopt;
    return EnergyBounds{certificate.energy, certificate.lower_bound};
  }

 private:
  using Double =
      SpringSystem<double, System::kDim, System::kNodes, System::kMaxNodes, typename System::Model>;

  detail::Prover<Double, SparseFactor>& prover(const System& system) {
    if (nodes_ == system.nodes() && links_ == system.link_count()) return prover_.get();
    nodes_ = system.nodes();
    links_ = system.link_count();
    return prover_.recreate();
  }

  int nodes_ = -1;  // of the last system
  int links_ = -1;
  detail::Scratch<detail::Prover<Double, SparseFactor>> prover_;
};

/// Whether x (Dim x N) is proven to be a global minimum of E, and a lower bound of E.
///
/// For any length r^ > 0 a link's energy is no less than that of a spring without rest length, (r - mu)^2 >=
/// (1 - mu / r^) r^2 + mu^2 - mu r^, with equality at r = r^. So with w_ij = k_ij (1 - mu_ij / r_ij) there is
/// a quadratic q below E that touches it at x, whose Hessian is, for each dimension,
///   W(x) = diag(k_i) + sum_ij w_ij (e_i - e_j) (e_i - e_j)^T       (N x N).
/// Where W is positive definite, no energy is below E(x) - 1/2 sum_d g_d^T W^-1 g_d, whether x is stationary
/// or not, and if that gap is nothing, x is the one global minimum (with a gap, it is close to the only one
/// if W stays positive definite as far as the gap allows a minimum to be). IDA's quadratic lies above E and
/// touches it at the same point. Where W is not positive definite, the lower bound is that of the same
/// quadratic without the links that push. docs/theory.md has more.
///
/// x need not come from a solver. All is computed in double, whatever the scalar, and rounding errors are
/// bounded: none can lead to a false certificate. O(N^3), or one sparse Cholesky factorisation
/// of K_dyn's pattern; a fixed or bounded number of nodes uses no heap.
///
/// Fixed nodes stay where x has them. A component that nothing holds is held by its first node, which costs
/// no energy, and its minimum is not unique. For anchors with an information matrix, W has one row for each
/// coordinate. For robust anchors, the reweighted system is certified, which proves nothing about the system
/// itself. Loads only move q's minimum. For links of another potential see LinkPotential. For bad input, lack
/// of memory, or numbers that leave the range of the scalar, the result is NotApplicable, with the reason.
template <typename System>
Certificate certify(const System& system, const typename System::Points& x,
                    const CertifyOptions& options = {}) {
  return Certifier<System>(system, options).certify(system, x);
}

ASTERISM_COMPILED_PROVER

/// A source of a Certifier that is made at the first call and kept.
template <typename System>
CertifierSource kept_certifier() {
  return [kept = std::shared_ptr<Certifier<System>>()]() mutable -> CertifierReference {
    if (!kept) kept = std::make_shared<Certifier<System>>();
    return *kept;
  };
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
