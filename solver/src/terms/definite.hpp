#pragma once

#include <asterism/solver/terms/system.hpp>

#include "matrix.hpp"
#include "stopping_rule.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Whether the Hessian at x, of which `factor` was made, is definite beyond what rounding, and the forces
/// that are left of a solver's tolerance, make of a free motion.
bool is_surely_definite(const System& system, const Eigen::MatrixXd& x, const Eigen::MatrixXd& gradient,
                        const SystemRule& rule, const SystemMatrix& hessian, const SystemFactor& factor);

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
