#pragma once

#include <asterism/trackers/constellation/spring_solvers.hpp>
#include <memory>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

template <typename Solvers>
SolverWorkspace<Solvers>::SolverWorkspace() : solvers_(std::make_unique<Solvers>()) {}
template <typename Solvers>
SolverWorkspace<Solvers>::SolverWorkspace(const SolverWorkspace&) : SolverWorkspace() {}
template <typename Solvers>
SolverWorkspace<Solvers>::~SolverWorkspace() = default;

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
