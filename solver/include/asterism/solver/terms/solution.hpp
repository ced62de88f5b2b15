#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <asterism/solver/energy/proof.hpp>
#include <asterism/solver/terms/system.hpp>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Answers questions about a solution x, a minimum of the energy. It validates, assembles and factors the
/// Hessian once. The system and x may change afterwards; the answers do not change.
///
///     const asterism::Solution solution(system, x);
///     if (!solution) std::cerr << solution.problem();
///     Eigen::Matrix2d spread = solution.covariance(3);
class ASTERISM_API Solution {
 public:
  /// x is dim x nodes.
  Solution(const System& system, const Eigen::MatrixXd& x);
  Solution(Solution&&) noexcept;
  Solution& operator=(Solution&&) noexcept;
  ~Solution();

  /// Whether the Hessian is positive definite to the digits of a double, so that there are answers.
  explicit operator bool() const { return problem_.empty(); }
  /// Why there are none: bad input, a term without second derivatives, or a Hessian that is not positive
  /// definite, such as where a part is free to turn. At a stationary point, rounding and what a solver's
  /// tolerance leaves of the forces do not count.
  std::string_view problem() const { return problem_; }

  /// The covariance by Laplace's approximation, H^-1, of one node, dim x dim; 0 for a fixed node. Throws
  /// std::logic_error without answers, std::out_of_range for an unknown node.
  Eigen::MatrixXd covariance(int node) const;
  /// The covariances of all nodes side by side, dim x (dim nodes), by selected inversion (Takahashi, Fagan
  /// and Chin 1973). Throws as above.
  Eigen::MatrixXd covariances() const;
  /// The whole matrix, (dim nodes) x (dim nodes). Throws as above.
  Eigen::MatrixXd joint_covariance() const;
  /// log det H, over the points and hidden unknowns, for the evidence by Laplace's approximation. Throws as
  /// above.
  double log_determinant() const;

  /// The derivatives of a loss by all numbers of the system, from those by the points of the solution
  /// (implicit function theorem): for each term, one matrix of the size of each of its columns, 0 for the
  /// numbers of elements without stiffness. Throws as above, and std::invalid_argument
  /// for a term that is not differentiable.
  std::vector<std::vector<Eigen::MatrixXd>> gradients(const Eigen::MatrixXd& by_x) const;

 private:
  struct Factored;
  const Factored& factored() const;

  std::unique_ptr<Factored> factored_;
  std::string problem_;
};

/// The second derivatives of the energy at x, (dim nodes) x (dim nodes), coordinate d of node i in row dim i
/// + d; rows of fixed nodes are those of the identity. The system must be valid. Throws std::invalid_argument
/// that names the term for one without this curvature.
ASTERISM_API Eigen::MatrixXd hessian(const System& system, const Eigen::MatrixXd& x,
                                     Curvature curvature = Curvature::True);

/// Whether x is the global minimum, from the minorising curvature M of all terms: if M is positive definite,
/// E(y) >= E(x) + g . (y - x) + (y - x)^T M (y - x) / 2 >= E(x) - g^T M^-1 g / 2 for all y. Where a term has
/// no such bound, the proof is not applicable, and the reason names it. Rounding is accounted for. For
/// placements without strain, 1e-10 sum A_ii L^2 / 2 stands for the energy that CertifyOptions::gap is a
/// share of, see node_stiffness and characteristic_length.
ASTERISM_API Certificate certify(const System& system, const Eigen::MatrixXd& x,
                                 const CertifyOptions& options = {});

}  // namespace ASTERISM_ABI
}  // namespace asterism
