#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/problem/model.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/solver/terms/solve.hpp>
#include <asterism/solver/terms/system.hpp>
#include <concepts>
#include <cstddef>
#include <initializer_list>
#include <new>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

// The loss of a model as that of a term.

template <typename L>
Eigen::VectorXd parameters(const L& loss, double L::*parameter) {
  return Eigen::VectorXd::Constant(1, loss.*parameter);
}
template <typename L>
void set_loss(Term& term, const L& loss) {
  if constexpr (std::same_as<L, Huber>) {
    term.set_loss(Loss::Huber, parameters(loss, &Huber::scale));
  } else if constexpr (std::same_as<L, GemanMcClure>) {
    term.set_loss(Loss::GemanMcClure, parameters(loss, &GemanMcClure::scale));
  } else if constexpr (std::same_as<L, Truncated>) {
    term.set_loss(Loss::Truncated, parameters(loss, &Truncated::scale),
                  parameters(loss, &Truncated::sharpness));
  } else {
    static_assert(std::same_as<L, Quadratic>, "a loss of one's own is not one that a term can have");
  }
}

template <typename L>
constexpr bool has_known_loss() {
  return std::same_as<L, Quadratic> || std::same_as<L, Huber> || std::same_as<L, GemanMcClure> ||
         std::same_as<L, Truncated>;
}

template <typename Potential>
constexpr bool kIsRobustHooke = false;
template <typename L>
constexpr bool kIsRobustHooke<RobustHooke<L>> = has_known_loss<L>();

template <typename P>
void set_law(Links& links, const P& potential) {
  if constexpr (kIsRobustHooke<P>) {
    set_loss(links, potential.loss);
  } else if constexpr (std::same_as<P, Rope>) {
    links.set_law(LinkLaw::Rope);
  } else if constexpr (std::same_as<P, Repulsion>) {
    links.set_law(LinkLaw::Repulsion);
  } else if constexpr (!std::same_as<P, Hooke>) {
    bool is_convex = false;
    if constexpr (requires { P::kConvexInSquare; }) is_convex = P::kConvexInSquare;
    links.set_function(
        [potential](std::size_t count, const double* length, const double* rest, double* value, double* first,
                    double* second) {
          for (std::size_t l = 0; l < count; ++l) {
            const auto phi = potential(length[l], rest[l]);
            value[l] = phi.value, first[l] = phi.first, second[l] = phi.second;
          }
        },
        is_convex);
  }
}

/// Whether to_system takes systems of this type.
template <typename Springs>
constexpr bool has_terms() {
  return has_known_loss<typename Springs::Model::AnchorLoss>();
}

/// `matrices`, Dim x (Dim count) side by side, as columns.
template <typename Matrices>
Eigen::MatrixXd as_columns(const Matrices& matrices, Eigen::Index count) {
  return matrices.template cast<double>().reshaped(matrices.rows() * matrices.rows(), count);
}

}  // namespace detail

/// Types of springs that to_system takes.
template <typename Springs>
concept HasTerms = requires {
  Springs::kPlainAnchors;
}
&&detail::has_terms<Springs>();

/// The same system as one of terms: anchors, links and loads, in this order, as far as it has them. Its model
/// may have any links, and the library's losses.
template <HasTerms Springs>
System to_system(const Springs& springs) {
  const int n = springs.nodes();
  System system(n, Springs::kDim);
  Anchors& anchors = system.add_anchors(springs.anchors.template cast<double>(),
                                        springs.anchor_stiffness.template cast<double>());
  if constexpr (Springs::kAnisotropic)
    anchors.values("information") = detail::as_columns(springs.anchor_shape, n);
  detail::set_loss(anchors, springs.anchor_loss);
  Eigen::Matrix2Xi pairs(2, springs.link_count());
  for (int l = 0; const Link& link : springs.links()) pairs.col(l++) << link.i, link.j;
  Links& links = system.add_links(pairs, springs.rest_length.template cast<double>(),
                                  springs.link_stiffness.template cast<double>());
  if (springs.has_offsets()) links.values("offset") = springs.rest_offset.template cast<double>();
  detail::set_law(links, springs.link_potential);
  if (springs.has_loads())
    system.add_loads(Eigen::RowVectorXi::LinSpaced(n, 0, n - 1), springs.loads.template cast<double>());
  for (int i = 0; i < n; ++i) {
    if (springs.is_fixed(i)) system.fix(i);
  }
  return system;
}

namespace detail {

/// Makes a solver of springs from a solver of System.
template <typename Springs>
struct FromSprings {
  Message problem(const Springs& springs, const typename Springs::Points& x) const {
    if (shares_memory(springs, x.data(), x.size())) return kSharesMemory;
    return validate_values(springs, x);
  }
  System operator()(const Springs& springs) const { return to_system(springs); }
};

}  // namespace detail

/// solve_staircase of a System for springs: moves x (Dim x N).
template <HasTerms Springs>
Summary solve_staircase(const Springs& springs, typename Springs::Points& x,
                        const StaircaseOptions& options = {}) {
  return detail::solve_converted("staircase", detail::FromSprings<Springs>(), springs, x,
                                 [&](const System& system, Eigen::MatrixXd& points) {
                                   return solve_staircase(system, points, options);
                                 });
}

/// A method for a System, see system_solvers, for springs: system_solver<Springs>("schwarz"). Throws as
/// SolverRegistry::make.
template <HasTerms Springs>
AnySolver<Springs> system_solver(std::string_view method, const std::vector<NamedOption>& options = {}) {
  return AnySolver<Springs>(system_solvers().make(method, options), detail::FromSprings<Springs>());
}

namespace detail {

/// One solve by a method for a System, with the options that all methods have and some of its own. To make
/// the solver may lack memory, too.
template <HasTerms Springs>
Summary solve_by_terms(std::string_view method, std::initializer_list<NamedOption> own,
                       const AlignedOptions& options, const Springs& springs, typename Springs::Points& x) {
  Summary summary;
  const auto work = [&] {
    AnySolver<Springs> solver = system_solver<Springs>(method, own);
    static_cast<AlignedOptions&>(solver.options()) = options;
    summary = solver.solve(springs, x);
  };
  attempt<std::bad_alloc>(work, [&](const std::bad_alloc& error) {
    summary.solver = method;
    summary.status = Status::OutOfMemory;
    summary.message = memory_message(error);
  });
  return summary;
}

}  // namespace detail

/// Adds the methods for a System, see system_solvers, whose names `registry` does not have yet.
template <HasTerms Springs>
void add_system_solvers(SolverRegistry<Springs>& registry) {
  const std::vector<std::string> known = registry.names();
  for (const std::string_view name : system_methods()) {
    if (std::find(known.begin(), known.end(), name) != known.end()) continue;
    registry.add(std::string(name), [name] { return system_solver<Springs>(name); });
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
