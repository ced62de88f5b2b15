#pragma once

#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/export.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/system.hpp>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Moves x (dim x nodes), the start, to a minimum of the energy: by Newton's method, by Newton-CG for large
/// systems whose Hessian is hard to factor, by Schwarz's method for more than 1000 nodes with few elements
/// each, and by L-BFGS where a term has no second derivatives. Bad input
/// leaves x as it was and is named in the summary. It throws only what a function of the user's throws.
ASTERISM_API Summary solve(const System& system, Eigen::MatrixXd& x, const AlignedOptions& options = {});

/// The same by the method of a name, see system_methods: "auto", "newton", "newton-cg", "lbfgs", "ncg",
/// "ida", "schwarz", "schwarz-direct", "multi-start", "graduated". Throws std::invalid_argument that names
/// the nearest for an unknown one. For the options of one method alone, include
/// <asterism/solver/terms/registry.hpp>.
ASTERISM_API Summary solve(std::string_view method, const System& system, Eigen::MatrixXd& x,
                           const AlignedOptions& options = {});

/// The names of these methods.
ASTERISM_API std::vector<std::string_view> system_methods();

}  // namespace ASTERISM_ABI
}  // namespace asterism
