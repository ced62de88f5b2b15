#pragma once

#include <asterism/solver/config.hpp>
#include <asterism/solver/topology.hpp>
#include <limits>
#include <utility>

namespace asterism::inline ASTERISM_ABI {

/// A constellation as a spring system (Sec. "The dual spring-system formulation"): node i hangs on its anchor
/// a_i by a spring of stiffness k_i and zero rest length, linked nodes are joined by springs of rest length
/// mu_ij and stiffness k_ij. Its energy is E(x) = 1/2 sum_i k_i |x_i - a_i|^2 + 1/2 sum_ij k_ij (mu_ij - |x_i
/// - x_j|)^2.
///
/// `Scalar` is float or double, `Dim` the number of coordinates of a point, `N` and `MaxN` as for Topology.
/// Points are Dim x N, a node is a column. Coordinates and rest lengths share one unit of length [px];
/// stiffness may have any unit [1/px^2 for E = -log p], as only ratios of stiffness move the solution.
///
/// The values are plain members to be refilled every frame; refilling does not allocate. They start as NaN,
/// so that a forgotten one gets Status::InvalidInput and not a wrong answer.
template <typename Scalar_, int Dim, int N = Eigen::Dynamic, int MaxN = N>
class SpringSystem {
  static_assert(Dim > 0);

 public:
  using Scalar = Scalar_;
  using TopologyType = Topology<N, MaxN>;
  using Point = Eigen::Matrix<Scalar, Dim, 1>;
  using Points = Eigen::Matrix<Scalar, Dim, N, (Dim == 1 ? Eigen::RowMajor : Eigen::ColMajor), Dim, MaxN>;
  using NodeVector = Eigen::Matrix<Scalar, N, 1, Eigen::ColMajor, MaxN, 1>;
  using LinkVector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1, Eigen::ColMajor, TopologyType::kMaxLinks, 1>;

  static constexpr int kDim = Dim;
  static constexpr int kNodes = N;
  static constexpr int kMaxNodes = MaxN;

  explicit SpringSystem(TopologyType topology) : topology_(std::move(topology)) {
    constexpr Scalar kUnset = std::numeric_limits<Scalar>::quiet_NaN();
    anchors.setConstant(Dim, nodes(), kUnset);
    anchor_stiffness.setConstant(nodes(), kUnset);
    rest_length.setConstant(link_count(), kUnset);
    link_stiffness.setConstant(link_count(), kUnset);
  }

  /// Sets every rest length to the distance of its two nodes in `points` (Dim x N).
  template <typename Derived>
  void set_rest_lengths(const Eigen::MatrixBase<Derived>& points) {
    eigen_assert(points.rows() == Dim && points.cols() == nodes());
    int l = 0;
    for (const Link& link : links()) rest_length[l++] = (points.col(link.i) - points.col(link.j)).norm();
  }

  const TopologyType& topology() const { return topology_; }
  std::span<const Link> links() const { return topology_.links(); }
  int nodes() const { return topology_.nodes(); }
  int link_count() const { return topology_.link_count(); }

  Points anchors;               ///< a_i, Dim x N [px]
  NodeVector anchor_stiffness;  ///< k_i >= 0, N; each connected component needs one that is positive
  LinkVector rest_length;       ///< mu_ij >= 0, one a link, in the order of links() [px]
  LinkVector link_stiffness;    ///< k_ij >= 0, one a link, in the order of links()

 private:
  TopologyType topology_;
};

}  // namespace asterism::inline ASTERISM_ABI
