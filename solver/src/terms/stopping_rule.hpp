#pragma once

#include <asterism/solver/terms/system.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The first node of each connected component that nothing holds.
std::vector<int> floating_nodes(const System& system);

/// What all terms add to the scales at x.
Scales scales_of(const System& system, const Eigen::MatrixXd& x);

/// What relative errors of the energy at x refer to: the energy, and with loads, whose energy grows with the
/// distance from the origin, twice the absolute value of each term of them.
double energy_scale(const System& system, const Eigen::MatrixXd& x, double energy);
/// A bound of the rounding error of the energy at x.
double energy_rounding(const System& system, const Eigen::MatrixXd& x, double energy);

/// The stopping rule of all methods, max_i |g_i| / (A_ii L) <= tolerance, see stationarity. For terms whose
/// curvature has no bound, A is that at the x of the last `set` or `renew`.
class SystemRule {
 public:
  /// False where stiffness or lengths leave the range of a double.
  bool set(const System& system, const Eigen::MatrixXd& x, double tolerance);
  /// The rule at another x. It stays as it was where the gradient gave its scale: that of the start tells.
  void renew(const System& system, const Eigen::MatrixXd& x);

  double tolerance() const { return tolerance_; }
  double length() const { return length_; }
  const Eigen::VectorXd& node_stiffness() const { return stiffness_; }
  /// Of the system of the last `set`.
  const std::vector<Scales::Place>& places() const { return places_; }
  double stationarity(const Eigen::MatrixXd& gradient) const;
  /// Also true for a gradient with NaN, which no further iteration can cure.
  bool reached(const Eigen::MatrixXd& gradient) const { return !(stationarity(gradient) > tolerance_); }
  /// Whether each force would move its node by a few times the rounding of its coordinates at most.
  bool is_rounding(const Eigen::MatrixXd& x, const Eigen::MatrixXd& gradient) const;

 private:
  double length_of(const System& system, const Eigen::MatrixXd& x, const Scales& scales);

  Eigen::VectorXd stiffness_, weights_;
  std::vector<Scales::Place> places_;
  double length_ = 0, tolerance_ = 0;
  bool is_by_gradient_ = false;
  bool changes_with_x_ = false;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
