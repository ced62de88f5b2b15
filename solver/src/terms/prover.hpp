#pragma once

#include <asterism/solver/energy/proof.hpp>
#include <asterism/solver/terms/system.hpp>

#include "matrix.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// certify for one valid system whose terms have minorising curvature, and several x: it keeps the pattern of
/// the matrix and its analysis.
class SystemProver {
 public:
  explicit SystemProver(const System& system) : system_(system) {}
  Certificate certify(const Eigen::MatrixXd& x, double gap);

 private:
  bool is_of_fixed(Eigen::Index row) const;
  Eigen::VectorXd diagonal_of_inverse() const;

  const System& system_;
  SystemMatrix matrix_{SystemMatrix::Storage::Best};
  SystemFactor factor_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
