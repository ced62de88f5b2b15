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

  /// What the quadratic that touches the energy at x from below proves.
  struct Bound {
    bool in_range = false;        ///< whether energy and curvature are in the range of a double
    bool has_minimum = false;     ///< whether the quadratic has one
    double energy = 0;            ///< at x
    double lower_bound = 0;       ///< of the energy, 0 or, for loads, -infinity where it proves none
    double decrease = 0;          ///< from the energy to the minimum of the quadratic, rounded upwards
    double rounding = 0;          ///< of the energy
    double trace_of_inverse = 0;  ///< of its curvature, rounded upwards
  };
  Bound bound(const Eigen::MatrixXd& x);

 private:
  bool is_of_fixed(Eigen::Index row) const;
  Eigen::VectorXd diagonal_of_inverse() const;

  const System& system_;
  SystemMatrix matrix_{SystemMatrix::Storage::Best};
  SystemFactor factor_;
  double margin_ = 0;  // that was taken off the diagonal of the matrix
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
