#pragma once

#include <Eigen/SparseCore>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/terms/system.hpp>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The methods for a System by name, with their options by name, as for every other type of systems:
/// system_solvers().make("multi-start", {{"starts", 50}}). Solvers of one's own can be added.
ASTERISM_API SolverRegistry<System> system_solvers();

/// What to use for a method of another library, such as "'lbfgs'" for "bfgs"; of the reference solvers, those
/// of `known`. `letters`: the lower-case letters and the digits of its name. Empty for other names.
ASTERISM_API std::string method_elsewhere(std::string_view letters, const std::vector<std::string>& known);

/// A Cholesky factorisation of sparse matrices, such as another package's. Its members may throw
/// std::bad_alloc.
class SparseFactorization {
 public:
  using Matrix = Eigen::SparseMatrix<double>;

  virtual ~SparseFactorization() = default;
  /// Orders a new pattern, of a lower triangle.
  virtual void analyze(const Matrix& lower) = 0;
  /// Factors a matrix of that pattern; false where it is not positive definite.
  virtual bool factorize(const Matrix& lower) = 0;
  /// matrix^-1 b, for one or several right-hand sides.
  virtual Eigen::MatrixXd solve(const Eigen::MatrixXd& b) const = 0;
};

/// "newton" with such factorisations, made by `make`. Summary::solver is `name`, which is not copied.
ASTERISM_API AnySolver<System> newton_by(std::string_view name,
                                         std::function<std::unique_ptr<SparseFactorization>()> make);

}  // namespace ASTERISM_ABI
}  // namespace asterism
