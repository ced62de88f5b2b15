#pragma once

#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/base/scratch.hpp>
#include <asterism/solver/energy/compiled_four_nodes.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/free_motion.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/energy/newton_matrix.hpp>
#include <asterism/solver/energy/sparse_blocks.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/matrix/dense_factor.hpp>
#include <asterism/solver/matrix/sparse_factor.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/problem/model.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <new>
#include <ostream>
#include <string_view>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Whether derivatives of a solution were computed, or why not.
enum class SensitivityStatus {
  Computed,             ///< the only one with derivatives
  NotStationary,        ///< x is not a stationary point to the tolerance of the options
  NotPositiveDefinite,  ///< x is not a strict local minimum: it does not follow the parameters, or not alone
  CoincidentNodes,      ///< linked nodes coincide, and the link's force there has no derivative, as that of a
                        ///< spring that pushes them apart
  NumericalFailure,     ///< a number leaves the range of the scalar
  InvalidInput,         ///< the message names the offending value
  OutOfMemory,
};

constexpr std::string_view to_string(SensitivityStatus status) {
  switch (status) {
    case SensitivityStatus::Computed:
      return "computed";
    case SensitivityStatus::NotStationary:
      return "not stationary";
    case SensitivityStatus::NotPositiveDefinite:
      return "not positive definite";
    case SensitivityStatus::CoincidentNodes:
      return "coincident nodes";
    case SensitivityStatus::NumericalFailure:
      return "numerical failure";
    case SensitivityStatus::InvalidInput:
      return "invalid input";
    case SensitivityStatus::OutOfMemory:
      return "out of memory";
  }
  return "unknown status";
}

inline std::ostream& operator<<(std::ostream& out, SensitivityStatus status) {
  return out << to_string(status);
}

/// Options of Sensitivity.
struct SensitivityOptions {
  /// x is refused where stationarity(system, x) is above this, unless all that is left of the gradient is
  /// rounding. The relative error of the derivatives is about the stationarity of x times the condition
  /// number of the Hessian. A solver's default tolerance is 1e-8. At least 64 epsilons of the scalar.
  double stationarity = 1e-6;

  /// The first problem of the options, or nullptr if there is none.
  constexpr const char* problem() const {
    return stationarity >= 0 && detail::is_finite(stationarity)
               ? nullptr
               : "option stationarity is negative or not finite";
  }
};

namespace detail {

/// The number of parameters by which a loss or potential can be differentiated.
template <typename Function>
constexpr std::size_t parameter_count() {
  if constexpr (std::is_same_v<Function, Huber> || std::is_same_v<Function, GemanMcClure>) return 1;
  if constexpr (requires { Function::kParameters; }) return static_cast<std::size_t>(Function::kParameters);
  return 0;
}

template <typename Function, typename Scalar>
using ParameterArray = std::array<Scalar, parameter_count<Function>()>;

/// d rho' / d parameters at s.
template <typename Loss, typename Scalar>
ParameterArray<Loss, Scalar> first_by_parameters(const Loss& loss, Scalar s) {
  if constexpr (std::is_same_v<Loss, Huber>) {  // rho' = c / sqrt(s) beyond c
    const auto c = static_cast<Scalar>(loss.scale);
    return {s <= c * c ? Scalar(0) : 1 / std::sqrt(s)};
  } else if constexpr (std::is_same_v<Loss, GemanMcClure>) {  // rho' = (1 + s / c^2)^-2
    const auto c = static_cast<Scalar>(loss.scale);
    const Scalar ratio = s / (c * c);
    const Scalar share = 1 / (1 + ratio);
    return {4 * ratio * share * share * share / c};
  } else if constexpr (parameter_count<Loss>() > 0) {
    return loss.first_by_parameters(s);
  } else {
    return {};
  }
}

/// d phi' / d parameters at length r and rest length mu.
template <typename Potential, typename Scalar>
ParameterArray<Potential, Scalar> first_by_parameters(const Potential& potential, Scalar r, Scalar mu) {
  if constexpr (parameter_count<Potential>() > 0) {
    return potential.first_by_parameters(r, mu);
  } else {
    return {};
  }
}

/// Whether a potential is a function of r - mu.
template <typename Potential>
inline constexpr bool kOfStretch = std::is_same_v<Potential, Hooke> || std::is_same_v<Potential, Rope> ||
                                   std::is_same_v<Potential, Repulsion>;
template <typename Loss>
inline constexpr bool kOfStretch<RobustHooke<Loss>> = true;

/// Whether d phi' / d mu is known.
template <typename Potential>
constexpr bool has_rest_length_derivative() {
  return kOfStretch<Potential> || requires(const Potential potential, double r) {
    potential.first_by_rest_length(r, r);
  };
}

template <typename Potential, typename Scalar>
Scalar first_by_rest_length(const Potential& potential, Scalar r, Scalar mu) {
  if constexpr (kOfStretch<Potential>) {
    return -potential(r, mu).second;
  } else if constexpr (has_rest_length_derivative<Potential>()) {
    return potential.first_by_rest_length(r, mu);
  } else {
    return std::numeric_limits<Scalar>::quiet_NaN();
  }
}

}  // namespace detail

/// One number for each value of a system: the derivative of a function by it, or its own derivative by a
/// parameter, such as one of the law that stiffness follows.
template <typename System>
struct SystemTangent {
  using Scalar = typename System::Scalar;
  /// One number for each parameter of the anchors' loss.
  using LossParameters = detail::ParameterArray<typename System::Model::AnchorLoss, Scalar>;
  /// One number for each parameter of the links' potential.
  using PotentialParameters = detail::ParameterArray<typename System::Model::LinkPotential, Scalar>;

  typename System::Points anchors;               ///< Dim x N
  typename System::NodeVector anchor_stiffness;  ///< N; anisotropic anchors keep their shape
  typename System::LinkVector rest_length;       ///< one for each link, in the order of links()
  typename System::LinkVector link_stiffness;    ///< one for each link
  typename System::LinkPoints rest_offset;       ///< Dim x L; no columns where the system's links have none
  typename System::Loads loads;                  ///< Dim x N; no columns where the system has none
  /// Only for anisotropic anchors: Dim x (Dim N), a symmetric matrix for each node, at constant k_i.
  decltype(System::anchor_shape) anchor_shape;
  LossParameters anchor_loss{};          ///< of the loss: Huber's and GemanMcClure's scale, or a user's
  PotentialParameters link_potential{};  ///< of the links' potential, a user's

  SystemTangent() = default;
  /// Zeros, for that system.
  explicit SystemTangent(const System& system) { set_zero(system); }

  /// Takes the system's size; all numbers become zero.
  void set_zero(const System& system) {
    anchors.setZero(System::kDim, system.nodes());
    anchor_stiffness.setZero(system.nodes());
    rest_length.setZero(system.link_count());
    link_stiffness.setZero(system.link_count());
    rest_offset.setZero(System::kDim, system.rest_offset.cols());
    loads.setZero(System::kDim, system.loads.cols());
    if constexpr (System::kAnisotropic) anchor_shape.setZero(System::kDim, System::kDim * system.nodes());
    anchor_loss.fill(0);
    link_potential.fill(0);
  }

  /// The sum of products with another one of the same size. Of dL/d(values) and d(values)/d(theta) it is the
  /// chain rule: dL/d(theta), for any scalar theta that the values depend on.
  Scalar dot(const SystemTangent& other) const {
    Scalar sum = anchors.cwiseProduct(other.anchors).sum() + anchor_stiffness.dot(other.anchor_stiffness) +
                 rest_length.dot(other.rest_length) + link_stiffness.dot(other.link_stiffness) +
                 rest_offset.cwiseProduct(other.rest_offset).sum() + loads.cwiseProduct(other.loads).sum();
    if constexpr (System::kAnisotropic) sum += anchor_shape.cwiseProduct(other.anchor_shape).sum();
    for (std::size_t p = 0; p < anchor_loss.size(); ++p) sum += anchor_loss[p] * other.anchor_loss[p];
    for (std::size_t p = 0; p < link_potential.size(); ++p)
      sum += link_potential[p] * other.link_potential[p];
    return sum;
  }
};

/// dL/d(values of the system), or the reason why it was not computed: then every vector is empty, or NaN
/// where its size is fixed.
template <typename System>
struct SystemGradient : SystemTangent<System> {
  SensitivityStatus status = SensitivityStatus::InvalidInput;  ///< whether there is one
  Message message;                                             ///< what is wrong, where there is none

  /// dL/d(information matrix of node i's anchor), symmetric; k_i, which is a unit of a loss other than
  /// Quadratic, is held constant. NaN where k_i = 0.
  auto anchor_information(const System& system, int i) const requires(System::kAnisotropic) {
    using Block = Eigen::Matrix<typename System::Scalar, System::kDim, System::kDim, Eigen::ColMajor>;
    return Block(this->anchor_shape.template block<System::kDim, System::kDim>(0, System::kDim * i) /
                 system.anchor_stiffness[i]);
  }
  /// Whether it was computed.
  explicit operator bool() const { return status == SensitivityStatus::Computed; }
};

/// The motion of the solution with the values, or the reason why it was not computed.
template <typename System>
struct SolutionTangent {
  SensitivityStatus status = SensitivityStatus::InvalidInput;  ///< whether there is one
  Message message;                                             ///< what is wrong, where there is none
  typename System::Points x;  ///< Dim x N; a fixed node's column is 0. NaN or empty where refused

  /// Whether it was computed.
  explicit operator bool() const { return status == SensitivityStatus::Computed; }
};

namespace detail {

/// A factored Hessian at a strict local minimum x of a system.
template <typename System>
class ImplicitSolver {
 public:
  using Scalar = typename System::Scalar;
  using Point = typename System::Point;
  using Points = typename System::Points;

  /// Scratch of the caller, of the system's size.
  ComponentScratch<System> components;
  Points right;
  Points lambda;

  /// Tests that derivatives of the solution x exist, and factors the Hessian there; of valid input.
  SensitivityStatus factorize(const System& system, const Points& x, double tolerance, Message& message) {
    if (!rule_.set(system, x, tolerance) || !assemble(system, x) || !all_finite(gradient_)) {
      message = "gradient or curvature leave the range of the scalar";
      return SensitivityStatus::NumericalFailure;
    }
    if (const int l = peaked_link(system, x); l >= 0) {
      message = Defect{"link", l, "has ends that coincide: its force has no derivative there"};
      return SensitivityStatus::CoincidentNodes;
    }
    // Springs that all want one point give no length that a solver's last step could be judged by.
    if (!rule_.reached(gradient_) && !rule_.is_rounding(x, gradient_, rule_.kLeastTolerance)) {
      message = "x is not a stationary point to the option stationarity: solve the system from it first";
      return SensitivityStatus::NotStationary;
    }
    if (!decompose()) {
      message =
          "the Hessian is not positive definite to the digits of the scalar: x is not a strict local minimum";
      return SensitivityStatus::NotPositiveDefinite;
    }
    if (const FreeMotion motion = free_motions_.find(system, x)) [[unlikely]] {
      message = "the Hessian is not positive definite: ";
      message.append(motion.message());
      return SensitivityStatus::NotPositiveDefinite;
    }
    return SensitivityStatus::Computed;
  }

  /// What of `backward` the compiled library has in vectors: the derivatives by `values` for dL/dx = `by_x`,
  /// of valid input. False if it does not serve, or one of the tests of `factorize` is not clearly passed.
  bool differentiate_compiled(const System& system, const Points& x, const Points& by_x, double tolerance,
                              SystemTangent<System>& values) {
    if constexpr (kHasFourNodes<System>) {
      return is_four_nodes(system) && rule_.set(system, x, tolerance) &&
             lanes_v0_1::differentiate_four_nodes(
                 four_nodes(system, rule_),
                 {x.data(), by_x.data(), values.anchors.data(), values.anchor_stiffness.data(),
                  values.link_stiffness.data(), values.rest_length.data()});
    }
    return false;
  }

  /// Whether d of link_difference, at the x of factorize, has a direction that is more than rounding.
  bool has_direction(const Point& d) const {
    const Scalar square = d.squaredNorm();
    return square > kRounding * kRounding * extent_ && square > kLeastSquare<Scalar>;
  }

  /// result = H^-1 b, where b is 0 at fixed nodes, and so is the result.
  void solve(const Points& b, Points& result) {
    if constexpr (kUnbounded) {
      if (large_.kind == Kind::Sparse) {
        large_.right = Eigen::Map<const typename Large::Vector>(b.data(), b.size());
        large_.vector = large_.ldlt->solve(large_.right);
        result = Eigen::Map<const Points>(large_.vector.data(), kDim, b.cols());
        return;
      }
      if (large_.kind == Kind::Dense) {
        result = b;
        DenseFactor<Scalar>::solve(large_.dense.data(), large_.vector.data(), b.size(), result.data(), 1);
        return;
      }
    }
    matrix_.solve(b, result);
  }

 private:
  static constexpr int kDim = System::kDim;
  static constexpr bool kUnbounded = System::kMaxNodes == Eigen::Dynamic;
  static constexpr int kSmall = 64;  // nodes; for more, Eigen's factorisation by blocks is faster
  static constexpr Scalar kRounding = 8 * std::numeric_limits<Scalar>::epsilon();

  enum class Kind { Small, Dense, Sparse };

  // For many nodes.
  struct Large {
    using Vector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;

    Kind kind = Kind::Small;
    DenseHessian<System> dense;
    SparseBlocks<Scalar, kDim> blocks;
    std::unique_ptr<SparseFactor<Scalar>> ldlt;  // Eigen's cannot be moved
    Vector right;
    Vector vector;
  };
  struct Nothing {};

  // The Hessian, false where it is not finite, and the gradient.
  bool assemble(const System& system, const Points& x) {
    if constexpr (kUnbounded) {
      large_.kind = is_large_and_sparse(system) ? Kind::Sparse
                    : system.nodes() > kSmall   ? Kind::Dense
                                                : Kind::Small;
      if (large_.kind != Kind::Small) evaluate<false>(system, x, gradient_);
      if (large_.kind == Kind::Dense) {
        large_.dense = hessian(system, x);
        return all_finite(large_.dense);
      }
      if (large_.kind == Kind::Sparse) {
        auto& blocks = large_.blocks;
        blocks.prepare(system.nodes(), system.links(), [this](const auto& pattern) {
          large_.ldlt = std::make_unique<SparseFactor<Scalar>>();
          large_.ldlt->analyze(pattern);
        });
        blocks.set_zero();
        for_each_hessian_block(
            system, x, false, [&blocks](int i, const auto& block) { blocks.add(i, block); },
            [&blocks](int l, const Link&, const auto& block) { blocks.add_link(l, block); });
        return all_finite(blocks.matrix().coeffs());
      }
    }
    matrix_.reset(rule_.node_stiffness());
    matrix_.assemble(system, x, false, gradient_);
    return true;  // a pivot that is not finite is not positive
  }

  // Whether the Hessian is positive definite to the digits of the scalar.
  bool decompose() {
    if constexpr (kUnbounded) {
      auto& pivots = large_.vector;
      if (large_.kind == Kind::Dense) {
        pivots = large_.dense.diagonal();
        if (!DenseFactor<Scalar>::factorize(large_.dense.data(), large_.dense.rows())) return false;
        for (int c = 0; c < pivots.size(); ++c) {
          if (!(large_.dense(c, c) * large_.dense(c, c) > kRounding * pivots[c])) return false;
        }
        large_.vector = large_.dense.diagonal().cwiseInverse();  // for solve
        return true;
      }
      if (large_.kind == Kind::Sparse) {
        large_.ldlt->factorize(large_.blocks.matrix());
        if (large_.ldlt->info() != Eigen::Success) return false;
        pivots = large_.ldlt->permutationPinv() * large_.ldlt->vectorD();
        for (int c = 0; c < pivots.size(); ++c) {
          if (!(pivots[c] > kRounding * *large_.blocks.diagonal(c))) return false;
        }
        return true;
      }
    }
    return matrix_.factorize();
  }

  // A link between nodes in one place whose force has no derivative there, or -1.
  int peaked_link(const System& system, const Points& x) {
    Scalar farthest = 0;
    for (int i = 0; i < system.nodes(); ++i) farthest = std::max(farthest, x.col(i).squaredNorm());
    extent_ = rule_.length() * rule_.length() + 2 * farthest;
    int l = 0;
    for (const Link& link : system.links()) {
      const Point d = link_difference(system, l, link, x);
      if (!has_direction(d) && !(system.is_fixed(link.i) && system.is_fixed(link.j)) &&
          !is_round(system, l, link, d)) [[unlikely]]
        return l;
      ++l;
    }
    return -1;
  }

  // Whether the energy of a link is smooth where its ends meet: the link is as stiff across its direction as
  // along it, like a spring of rest length 0, a slack cable, or a link of stiffness 0.
  static bool is_round(const System& system, int l, const Link& link, const Point& d) {
    const auto spring = detail::spring(system, link, d);
    const auto force = link_force(system, l, spring);
    const Scalar stiffness =
        std::max({system.link_stiffness[l], std::abs(force.along), std::abs(force.across)});
    return (spring.length > 0 || force.tension == 0) &&
           std::abs(force.along - force.across) <= std::sqrt(kRounding) * stiffness;
  }

  StoppingRule<System> rule_;
  NewtonMatrix<System> matrix_;
  FreeMotions<System> free_motions_;
  Scalar extent_ = 0;  // square of the lengths that rounding is a share of
  Points gradient_;
  [[no_unique_address]] std::conditional_t<kUnbounded, Large, Nothing> large_;
};

}  // namespace detail

/// Derivatives of solutions by the values of their systems, with a workspace: reuse it to compute without
/// allocation and, for large sparse systems of one topology, with one ordering; one thread at a time.
///
/// At a strict local minimum x of E the gradient g(x, p) is zero, whatever the values p are. Therefore x
/// moves with p by dx/dp = -H^-1 dg/dp, H = d2E/dx2 (the implicit function theorem). docs/theory.md has the
/// formulas.
///
/// Derivatives that do not exist are refused, with a message: x is to be stationary, H to be positive
/// definite to the digits of the scalar, no rigid motion may be free, and no link may push apart nodes that
/// coincide (unless both are fixed). Bad input is refused as by a solver. A fixed node does not move. For
/// values at the end of their range (a stiffness of 0), the derivative is the one into the range. At a kink
/// of a second derivative (a cable that is just taut, Huber's loss at its scale) it is that on one side. A
/// link between nodes in one place, of rest length 0 or stiffness 0, has no direction: the derivatives by its
/// rest length and its stiffness, which would be opposite for opposite directions, are their mean, 0.
///
/// asterism::solver_compiled computes those of four linked nodes in the plane, in double and by reverse mode,
/// in vectors of AVX-512 where the processor has them; they may differ in their last digits.
///
/// A loss or potential of a user has derivatives by its own parameters if it declares
///   static constexpr int kParameters = P;
///   std::array<Scalar, P> first_by_parameters(Scalar s) const;             // loss: d rho'(s) / d parameters
///   std::array<Scalar, P> first_by_parameters(Scalar r, Scalar mu) const;  // potential: d phi' / d
///   parameters
/// and a potential has one by the rest length if it declares
///   Scalar first_by_rest_length(Scalar r, Scalar mu) const;                // d phi' / d mu, Hooke's is -1
/// each as a template or for the system's scalar. Where that is not declared, rest_length is NaN.
template <typename System>
class Sensitivity {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;
  /// The result of forward mode.
  using Tangent = SystemTangent<System>;

  SensitivityOptions options;

  Sensitivity() = default;
  /// For type deduction: Sensitivity(system).backward(system, x, grad_x).
  explicit Sensitivity(const System&, const SensitivityOptions& o = {}) : options(o) {}

  /// Reverse mode: dL/d(values) for dL/dx (Dim x N) of any function L of the solution x. With lambda =
  /// H^-1 dL/dx, by one factorisation and one solve. Columns of dL/dx at fixed nodes do not count.
  SystemGradient<System> backward(const System& system, const Points& x, const Points& grad_x) {
    SystemGradient<System> result;
    const auto compute = [&](detail::ImplicitSolver<System>& solver) {
      if (grad_x.cols() != system.nodes())
        return refuse(result, Defect{"grad_x", Defect::kNoIndex, "must have one column for each node"});
      if (const int i = detail::first_column_not_finite(grad_x); i >= 0)
        return refuse(result, Defect{"grad_x of node", i, "is not finite"});
      result.set_zero(system);
      if (solver.differentiate_compiled(system, x, grad_x, options.stationarity, result)) {
        result.status = SensitivityStatus::Computed;
        return;
      }
      result.status = solver.factorize(system, x, options.stationarity, result.message);
      if (!result) return;
      solver.right = grad_x;
      detail::clear_fixed(system, solver.right);
      solver.solve(solver.right, solver.lambda);
      differentiate(solver, system, x, result);
      if (!is_finite(result)) out_of_range(result);
    };
    run(system, x, result, compute);
    if (!result) unset(result);
    return result;
  }

  /// Forward mode: dx/d(theta) for d(values)/d(theta) of any scalar theta.
  SolutionTangent<System> forward(const System& system, const Points& x, const Tangent& tangent) {
    SolutionTangent<System> result;
    const auto compute = [&](detail::ImplicitSolver<System>& solver) {
      if (const Defect defect = tangent_defect(system, tangent)) return refuse(result, defect);
      result.status = solver.factorize(system, x, options.stationarity, result.message);
      if (!result) return;
      push(solver, system, x, tangent);
      detail::clear_fixed(system, solver.right);
      solver.solve(solver.right, result.x);
      if (!detail::all_finite(result.x)) out_of_range(result);
    };
    run(system, x, result, compute);
    if (!result) detail::clear_numbers(result.x);
    return result;
  }

 private:
  using Point = typename System::Point;
  using Block = Eigen::Matrix<Scalar, System::kDim, System::kDim, Eigen::ColMajor>;
  using Potential = typename System::Model::LinkPotential;

  template <typename Result>
  static void refuse(Result& result, const Defect& defect) {
    result.status = SensitivityStatus::InvalidInput;
    result.message = defect;
  }
  template <typename Result>
  static void out_of_range(Result& result) {
    result.status = SensitivityStatus::NumericalFailure;
    result.message = "a derivative leaves the range of the scalar";
  }

  template <typename Result, typename Compute>
  void run(const System& system, const Points& x, Result& result, Compute&& compute) {
    const auto work = [&] {
      if (const char* problem = options.problem()) {
        result.message = problem;
        return;
      }
      if (const Defect defect = detail::validate_values(system, x)) return refuse(result, defect);
      auto& solver = this->solver(system);
      if (const Defect defect = detail::validate_components(system, solver.components))
        return refuse(result, defect);
      compute(solver);
    };
    detail::attempt<std::bad_alloc>(work, [&result](const std::bad_alloc& error) {
      result.status = SensitivityStatus::OutOfMemory;
      result.message = detail::memory_message(error);
    });
  }

  detail::ImplicitSolver<System>& solver(const System& system) {
    if (nodes_ == system.nodes() && links_ == system.link_count()) return solver_.get();
    nodes_ = system.nodes();
    links_ = system.link_count();
    return solver_.recreate();
  }

  // The anchor's force on node i at its own stiffness of 1, of its offset d: rho' S d, and the loss.
  struct Pull {
    Point offset;
    Point shaped;                // S d
    Scalar square = 0;           // d^T S d
    Derivatives<Scalar> loss{};  // at that
  };
  static Pull pull(const System& system, int i, const Points& x) {
    Pull result;
    result.offset = x.col(i) - system.anchors.col(i);
    result.shaped = detail::anchor_shaped(system, i, result.offset);
    if constexpr (System::kPlainAnchors) {
      result.loss.first = 1;
    } else {
      result.square = result.offset.dot(result.shaped);
      result.loss = system.anchor_loss(result.square);
    }
    return result;
  }

  // -lambda^T dg/d(values) into `to`, which is zero.
  static void differentiate(const detail::ImplicitSolver<System>& solver, const System& system,
                            const Points& x, Tangent& to) {
    const Points& lambdas = solver.lambda;
    for (int i = 0; i < system.nodes(); ++i) {
      const Scalar k = system.anchor_stiffness[i];
      const Point lambda = lambdas.col(i);
      if (system.is_fixed(i)) continue;
      if (system.has_loads()) to.loads.col(i) = lambda;
      const Pull anchor = pull(system, i, x);
      const Scalar work = lambda.dot(anchor.shaped);
      to.anchor_stiffness[i] = -anchor.loss.first * work;
      if constexpr (System::kPlainAnchors) {
        to.anchors.col(i) = k * lambda;
      } else {
        if (!(k > 0)) continue;
        to.anchors.col(i) = detail::anchor_curvature(system, i, anchor.offset, false) * lambda;
        if constexpr (System::kAnisotropic) {
          const Block outer = (k * anchor.loss.first) * lambda * anchor.offset.transpose();
          to.anchor_shape.template block<System::kDim, System::kDim>(0, System::kDim * i) =
              Scalar(-0.5) * (outer + outer.transpose()) -
              (k * anchor.loss.second * work) * anchor.offset * anchor.offset.transpose();
        }
        const auto first = detail::first_by_parameters(system.anchor_loss, anchor.square);
        for (std::size_t p = 0; p < first.size(); ++p) to.anchor_loss[p] -= k * first[p] * work;
      }
    }
    int l = -1;
    for (const Link& link : system.links()) {
      ++l;
      if (system.is_fixed(link.i) && system.is_fixed(link.j)) continue;
      const Scalar k = system.link_stiffness[l];
      const Scalar mu = system.rest_length[l];
      const Point d = detail::link_difference(system, l, link, x);
      const Scalar r = d.norm();
      const Point apart = lambdas.col(link.i) - lambdas.col(link.j);
      const Scalar delta = solver.has_direction(d) ? d.dot(apart) / r : Scalar(0);
      to.link_stiffness[l] = -system.link_potential(r, mu).first * delta;
      if (!(k > 0)) continue;
      if (system.has_offsets()) {
        to.rest_offset.col(l) = detail::product(link_curvature(system, l, link, d), apart);
      }
      to.rest_length[l] = -k * detail::first_by_rest_length(system.link_potential, r, mu) * delta;
      const auto first = detail::first_by_parameters(system.link_potential, r, mu);
      for (std::size_t p = 0; p < first.size(); ++p) to.link_potential[p] -= k * first[p] * delta;
    }
  }

  // The second derivative of link l's energy by d of link_difference.
  static Block link_curvature(const System& system, int l, const Link& link, const Point& d) {
    const auto spring = detail::spring(system, link, d);
    return detail::link_curvature(detail::link_force(system, l, spring), spring);
  }

  // -dg/d(values) tangent into solver.right.
  static void push(detail::ImplicitSolver<System>& solver, const System& system, const Points& x,
                   const Tangent& tangent) {
    Points& right = solver.right;
    right.setZero(System::kDim, system.nodes());
    for (int i = 0; i < system.nodes(); ++i) {
      if (system.is_fixed(i)) continue;
      const Scalar k = system.anchor_stiffness[i];
      const Pull anchor = pull(system, i, x);
      Point force = -(tangent.anchor_stiffness[i] * anchor.loss.first) * anchor.shaped;
      if constexpr (System::kPlainAnchors) {
        force += k * tangent.anchors.col(i);
      } else if (k > 0) {
        force += detail::anchor_curvature(system, i, anchor.offset, false) * tangent.anchors.col(i);
        if constexpr (System::kAnisotropic) {
          const Point turned =
              tangent.anchor_shape.template block<System::kDim, System::kDim>(0, System::kDim * i) *
              anchor.offset;
          force -= k * anchor.loss.first * turned +
                   (k * anchor.loss.second * anchor.offset.dot(turned)) * anchor.shaped;
        }
        const auto first = detail::first_by_parameters(system.anchor_loss, anchor.square);
        for (std::size_t p = 0; p < first.size(); ++p)
          force -= (k * first[p] * tangent.anchor_loss[p]) * anchor.shaped;
      }
      if (system.has_loads()) force += tangent.loads.col(i);
      right.col(i) += force;
    }
    int l = -1;
    for (const Link& link : system.links()) {
      ++l;
      if (system.is_fixed(link.i) && system.is_fixed(link.j)) continue;
      const Scalar k = system.link_stiffness[l];
      const Scalar mu = system.rest_length[l];
      const Point d = detail::link_difference(system, l, link, x);
      const Scalar r = d.norm();
      Scalar tension = system.link_potential(r, mu).first * tangent.link_stiffness[l];
      if (k > 0) {
        if (tangent.rest_length[l] != 0)
          tension += k * detail::first_by_rest_length(system.link_potential, r, mu) * tangent.rest_length[l];
        const auto first = detail::first_by_parameters(system.link_potential, r, mu);
        for (std::size_t p = 0; p < first.size(); ++p) tension += k * first[p] * tangent.link_potential[p];
      }
      Point force = Point::Zero();
      if (solver.has_direction(d)) force = (tension / r) * d;
      if (system.has_offsets())
        force -= detail::product(link_curvature(system, l, link, d), Point(tangent.rest_offset.col(l)));
      right.col(link.i) -= force;
      right.col(link.j) += force;
    }
  }

  static Defect tangent_defect(const System& system, const Tangent& tangent) {
    const auto has_size = [&](const auto& values, Eigen::Index size) {
      return values.size() == size && detail::all_finite(values);
    };
    constexpr auto kProblem = "has not one finite number for each value of the system";
    const Eigen::Index coordinates = Eigen::Index{System::kDim} * system.nodes();
    if (!has_size(tangent.anchors, coordinates)) return {"tangent of anchors", Defect::kNoIndex, kProblem};
    if (!has_size(tangent.anchor_stiffness, system.nodes()))
      return {"tangent of anchor stiffness", Defect::kNoIndex, kProblem};
    if (!has_size(tangent.rest_offset, system.rest_offset.size()))
      return {"tangent of rest offset", Defect::kNoIndex, kProblem};
    if (!has_size(tangent.loads, system.loads.size()))
      return {"tangent of loads", Defect::kNoIndex, kProblem};
    if (!has_size(tangent.rest_length, system.link_count()))
      return {"tangent of rest length", Defect::kNoIndex, kProblem};
    if (!has_size(tangent.link_stiffness, system.link_count()))
      return {"tangent of link stiffness", Defect::kNoIndex, kProblem};
    if constexpr (System::kAnisotropic) {
      if (!has_size(tangent.anchor_shape, System::kDim * coordinates))
        return {"tangent of anchor shape", Defect::kNoIndex, kProblem};
    }
    for (const Scalar value : tangent.anchor_loss) {
      if (!detail::is_finite(value)) return {"tangent of anchor loss", Defect::kNoIndex, "is not finite"};
    }
    for (const Scalar value : tangent.link_potential) {
      if (!detail::is_finite(value)) return {"tangent of link potential", Defect::kNoIndex, "is not finite"};
    }
    if constexpr (!detail::has_rest_length_derivative<Potential>()) {
      if (!detail::is_zero(tangent.rest_length))
        return {"tangent of rest length", Defect::kNoIndex,
                "is not zero, and the potential declares no first_by_rest_length"};
    }
    return {};
  }

  static bool is_finite(const Tangent& values) {
    bool finite = detail::all_finite(values.anchors) && detail::all_finite(values.anchor_stiffness) &&
                  detail::all_finite(values.link_stiffness) && detail::all_finite(values.rest_offset) &&
                  detail::all_finite(values.loads);
    if constexpr (detail::has_rest_length_derivative<Potential>())
      finite = finite && detail::all_finite(values.rest_length);
    if constexpr (System::kAnisotropic) finite = finite && detail::all_finite(values.anchor_shape);
    for (const Scalar value : values.anchor_loss) finite = finite && detail::is_finite(value);
    for (const Scalar value : values.link_potential) finite = finite && detail::is_finite(value);
    return finite;
  }

  static void unset(Tangent& values) {
    detail::clear_numbers(values.anchors);
    detail::clear_numbers(values.anchor_stiffness);
    detail::clear_numbers(values.rest_length);
    detail::clear_numbers(values.link_stiffness);
    detail::clear_numbers(values.rest_offset);
    detail::clear_numbers(values.loads);
    if constexpr (System::kAnisotropic) detail::clear_numbers(values.anchor_shape);
    constexpr Scalar kNone = std::numeric_limits<Scalar>::quiet_NaN();
    values.anchor_loss.fill(kNone);
    values.link_potential.fill(kNone);
  }

  int nodes_ = -1;  // of the last system
  int links_ = -1;
  detail::Scratch<detail::ImplicitSolver<System>> solver_;
};

/// dL/d(values of the system) at its solution x for dL/dx (Dim x N), see Sensitivity: how a function of the
/// solution changes with anchors, stiffness and rest lengths.
template <typename System>
SystemGradient<System> sensitivity(const System& system, const typename System::Points& x,
                                   const typename System::Points& grad_x,
                                   const SensitivityOptions& options = {}) {
  return Sensitivity<System>(system, options).backward(system, x, grad_x);
}

/// dx/d(theta) at the solution x for d(values)/d(theta), see Sensitivity: how the solution moves with them.
template <typename System>
SolutionTangent<System> solution_tangent(const System& system, const typename System::Points& x,
                                         const SystemTangent<System>& tangent,
                                         const SensitivityOptions& options = {}) {
  return Sensitivity<System>(system, options).forward(system, x, tangent);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
