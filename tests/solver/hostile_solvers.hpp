#pragma once

// Converts a problem to a type of system and solves it.

#include <asterism/solver.hpp>
#include <cstring>
#include <tuple>

#include "by_terms.hpp"
#include "hostile.hpp"

namespace asterism::hostile {

template <typename System>
System system_of(const Problem& problem) {
  using Scalar = typename System::Scalar;
  System system(System::TopologyType::from_links(problem.nodes(), problem.links));
  system.anchors = problem.anchors.template cast<Scalar>();
  system.anchor_stiffness = problem.anchor_stiffness.template cast<Scalar>();
  system.rest_length = problem.rest_length.template cast<Scalar>();
  system.link_stiffness = problem.link_stiffness.template cast<Scalar>();
  if (problem.rest_offset.size() > 0) system.rest_offset = problem.rest_offset.template cast<Scalar>();
  if (problem.loads.size() > 0) system.loads = problem.loads.template cast<Scalar>();
  if constexpr (System::kAnisotropic) system.anchor_shape = problem.shapes.template cast<Scalar>();
  if constexpr (requires { system.anchor_loss.scale; }) system.anchor_loss.scale = problem.scale;
  for (const int i : problem.fixed) system.fix(i);
  return system;
}

/// Appends the result of each solver of the tuple.
template <typename System, typename Solvers>
void solve_with(Solvers& solvers, const Problem& problem, std::vector<Attempt>& attempts) {
  using Points = typename System::Points;
  const System system = system_of<System>(problem);
  const Points start = problem.start.template cast<typename System::Scalar>();
  Points x = start;
  const auto call = [&](auto& solver) {
    solver.options.tolerance = kTolerance;
    solver.options.max_iterations = kIterations;
    solver.options.hold_floating = problem.hold_floating;
    if constexpr (requires { solver.options.align; }) solver.options.align = problem.align;
    if constexpr (requires { solver.options.starts; }) solver.options.starts = 3;
    x = start;
    const Summary summary = solver.solve(system, x);
    const auto bytes = sizeof(typename System::Scalar) * static_cast<std::size_t>(start.size());
    attempts.push_back({std::string(solver.name()), summary, x.template cast<double>(),
                        x.size() == start.size() && std::memcmp(x.data(), start.data(), bytes) == 0});
  };
  std::apply([&](auto&... solver) { (call(solver), ...); }, solvers);
}

/// The solvers that are instantiated for every type.
template <typename System>
using CommonSolvers =
    std::tuple<Ida<System>, Newton<System>, Lbfgs<System>, NonlinearCg<System>, Auto<System>>;
template <typename System>
using SparseSolvers = std::tuple<Ida<System, SparseCholesky<System>>, Lbfgs<System, JacobiMetric<System>>>;
/// Those for systems of terms, which are in double.
template <typename System>
using TermSolvers = std::tuple<testing::SparseNewton<System>, testing::NewtonCg<System>,
                               testing::Schwarz<System>, testing::DirectSchwarz<System>>;

}  // namespace asterism::hostile
