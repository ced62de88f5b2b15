#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Metric of Lbfgs: the diagonal of K_dyn, which costs nothing to invert. For sparse systems whose anchors
/// are not weak beside the springs.
template <typename System>
class JacobiMetric {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  static constexpr std::string_view kName = "Jacobi";

  /// False where the diagonal leaves the range of the scalar.
  bool factorize(const System& system) {
    detail::node_stiffness(system, inverse_);
    for (auto& k : inverse_) k = 1 / (k > 0 ? k : Scalar(1));  // a fixed node may have none
    return detail::all_finite(inverse_);
  }

  /// x <- x - diag(K_dyn)^-1 g.
  void descend(const Points& gradient, Points& x) const { x.noalias() -= gradient * inverse_.asDiagonal(); }

 private:
  typename System::NodeVector inverse_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
