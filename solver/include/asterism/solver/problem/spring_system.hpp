#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/matrix/diagonalise.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/model.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <limits>
#include <type_traits>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// N times a factor, for a number that may be Eigen::Dynamic.
template <int N>
constexpr int times(int factor) {
  return N == Eigen::Dynamic ? Eigen::Dynamic : N * factor;
}

}  // namespace detail

/// A constellation as a spring system (Sec. "The dual spring-system formulation"): a spring of stiffness k_i
/// and rest length 0 ties node i to its anchor a_i, and springs of rest length mu_ij and stiffness k_ij join
/// linked nodes. Its energy is E(x) = 1/2 sum_i k_i |x_i - a_i|^2 + 1/2 sum_ij k_ij (mu_ij - |x_i
/// - x_j|)^2.
///
/// `Scalar` is float or double, `Dim` the number of coordinates of a point, `N` and `MaxN` as for Topology.
/// Points are Dim x N, a node is a column. Coordinates and rest lengths share one unit of length [px];
/// stiffness may have any unit [1/px^2 for E = -log p], as only ratios of stiffness move the solution.
///
/// A link may also prefer an offset m_ij, a vector (rest_offset): its energy is then 1/2 k_ij (mu_ij - |x_i -
/// x_j - m_ij|)^2. With mu_ij = 0, 1/2 k_ij |x_i - x_j - m_ij|^2, it is the link of pictorial structures
/// (Fischler and Elschlager 1973; Felzenszwalb and Huttenlocher 2005). If all links are, the energy is
/// convex.
///
/// Nodes may also carry loads f_i, constant forces such as a weight (loads): they add - sum_i f_i . x_i to
/// the energy, which may then be negative.
///
/// A `Model` other than Springs replaces the link's potential or the anchor's loss, or gives anchors an
/// information matrix; k_i and k_ij then bound the curvature of anchor and link from above.
///
/// The values are plain members, to be refilled every frame; refilling does not allocate. They start as
/// NaN, so that a solver returns Status::InvalidInput, not a wrong answer, if one was forgotten.
template <typename Scalar_, int Dim, int N = Eigen::Dynamic, int MaxN = N, typename Model_ = Springs>
class SpringSystem {
  static_assert(Dim > 0);

  struct Nothing {};

 public:
  using Scalar = Scalar_;
  /// The kind of links and anchors.
  using Model = Model_;
  using TopologyType = Topology<N, MaxN>;
  using Point = Eigen::Matrix<Scalar, Dim, 1>;
  using Points = Eigen::Matrix<Scalar, Dim, N, (Dim == 1 ? Eigen::RowMajor : Eigen::ColMajor), Dim, MaxN>;
  /// One number for each node, N.
  using NodeVector = Eigen::Matrix<Scalar, N, 1, Eigen::ColMajor, MaxN, 1>;
  /// One number for each link, in the order of links().
  using LinkVector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1, Eigen::ColMajor, TopologyType::kMaxLinks, 1>;

  static constexpr int kDim = Dim;
  static constexpr int kNodes = N;
  static constexpr int kMaxNodes = MaxN;
  /// Anchors have an information matrix.
  static constexpr bool kAnisotropic = Model::kAnchorShape == AnchorShape::Anisotropic;
  /// An anchor's Hessian is k_i times the identity wherever the node is.
  static constexpr bool kPlainAnchors =
      !kAnisotropic && std::is_same_v<typename Model::AnchorLoss, Quadratic>;

  /// One vector for each link, Dim x L.
  using LinkPoints =
      Eigen::Matrix<Scalar, Dim, Eigen::Dynamic, (Dim == 1 ? Eigen::RowMajor : Eigen::ColMajor), Dim,
                    TopologyType::kMaxLinks>;

  /// One vector for each node, or none, Dim x N.
  using Loads =
      Eigen::Matrix<Scalar, Dim, Eigen::Dynamic, (Dim == 1 ? Eigen::RowMajor : Eigen::ColMajor), Dim, MaxN>;

  /// No value is set yet: all are NaN. No link has an offset and no node a load.
  explicit SpringSystem(TopologyType topology) : topology_(std::move(topology)) {
    constexpr Scalar kUnset = std::numeric_limits<Scalar>::quiet_NaN();
    anchors.setConstant(Dim, nodes(), kUnset);
    anchor_stiffness.setConstant(nodes(), kUnset);
    rest_length.setConstant(link_count(), kUnset);
    link_stiffness.setConstant(link_count(), kUnset);
    rest_offset.resize(Dim, 0);
    loads.resize(Dim, 0);
    fixed_.setConstant(nodes(), false);
    if constexpr (kAnisotropic) anchor_shape.setConstant(Dim, Dim * nodes(), kUnset);
  }

  /// Sets every rest length to the distance of its two nodes in `points` (Dim x N).
  template <typename Derived>
  void set_rest_lengths(const Eigen::MatrixBase<Derived>& points) {
    eigen_assert(points.rows() == Dim && points.cols() == nodes());
    int l = 0;
    for (const Link& link : links()) {
      const Point d = points.col(link.i) - points.col(link.j);
      rest_length[l++] = d.norm();
    }
  }

  /// Sets every offset m_ij to p_i - p_j for the columns p of `points` (Dim x N), and every rest length to 0:
  /// the links then prefer the shape of these points as it lies, not only its distances.
  template <typename Derived>
  void set_rest_offsets(const Eigen::MatrixBase<Derived>& points) {
    eigen_assert(points.rows() == Dim && points.cols() == nodes());
    rest_offset.resize(Dim, link_count());
    rest_length.setZero(link_count());
    int l = 0;
    for (const Link& link : links()) rest_offset.col(l++) = points.col(link.i) - points.col(link.j);
  }

  /// Whether links have offsets.
  bool has_offsets() const { return rest_offset.cols() > 0; }

  /// Whether nodes have loads.
  bool has_loads() const { return loads.cols() > 0; }

  /// Holds node i where the start of a solve has it. It is eliminated from the unknowns, and its springs pull
  /// on the other nodes. A node number out of range is a defect() of the system.
  void fix(int node) { set_fixed(node, true); }
  /// Lets node i move again.
  void release(int node) { set_fixed(node, false); }
  /// Whether node i is held, and how many are.
  bool is_fixed(int node) const { return fixed_[node]; }
  int fixed_count() const { return fixed_count_; }

  /// Anisotropic anchors: sets k_i and anchor_shape from node i's information matrix (Dim x Dim, symmetric,
  /// positive semi-definite; the inverse of a covariance), k_i being its largest eigenvalue. The anchor's
  /// energy becomes 1/2 (x_i - a_i)^T information (x_i - a_i), or 1/2 k_i rho of that over k_i for another
  /// loss rho. For any other matrix solvers return Status::InvalidInput.
  template <typename Derived>
  void set_anchor_information(int node,
                              const Eigen::MatrixBase<Derived>& information) requires(kAnisotropic) {
    eigen_assert(0 <= node && node < nodes() && information.rows() == Dim && information.cols() == Dim);
    anchor_stiffness[node] = split(information, anchor_shape.template block<Dim, Dim>(0, Dim * node));
  }

  /// The same system in another scalar. From float to double no value changes.
  template <typename Other>
  SpringSystem<Other, Dim, N, MaxN, Model> cast() const {
    SpringSystem<Other, Dim, N, MaxN, Model> other(topology_);
    other.anchors = anchors.template cast<Other>();
    other.anchor_stiffness = anchor_stiffness.template cast<Other>();
    other.rest_length = rest_length.template cast<Other>();
    other.link_stiffness = link_stiffness.template cast<Other>();
    other.rest_offset = rest_offset.template cast<Other>();
    other.loads = loads.template cast<Other>();
    if constexpr (kAnisotropic) other.anchor_shape = anchor_shape.template cast<Other>();
    other.anchor_loss = anchor_loss;
    other.link_potential = link_potential;
    for (int i = 0; i < nodes(); ++i) {
      if (is_fixed(i)) other.fix(i);
    }
    return other;
  }

  /// The problem of the topology or of the fixed nodes.
  const Defect& defect() const { return topology_.defect() ? topology_.defect() : defect_; }

  const TopologyType& topology() const { return topology_; }
  std::span<const Link> links() const { return topology_.links(); }
  int nodes() const { return topology_.nodes(); }
  int link_count() const { return topology_.link_count(); }

  Points anchors;               ///< a_i, Dim x N [px]
  NodeVector anchor_stiffness;  ///< k_i >= 0, N; at least one > 0 in each connected component
  LinkVector rest_length;       ///< mu_ij >= 0, one for each link, in the order of links() [px]
  LinkVector link_stiffness;    ///< k_ij >= 0, one for each link, in the order of links()

  /// m_ij, Dim x L, one column for each link (i, j), in the order of links() [px]. Without columns, as at
  /// first, all are 0.
  LinkPoints rest_offset;

  /// f_i, Dim x N, the constant force on each node [stiffness x px]. Without columns, as at first, all are 0.
  /// The energy has a minimum if what holds the nodes pulls ever harder: quadratic anchors or fixed nodes,
  /// and links that are springs or ropes. A robust anchor may let go of a load, and solvers then end at
  /// SolverOptions::max_iterations or with Status::NumericalFailure.
  Loads loads;

  /// The type of anchor_shape.
  using Shapes = Eigen::Matrix<Scalar, Dim, N == Eigen::Dynamic ? N : Dim * N,
                               (Dim == 1 ? Eigen::RowMajor : Eigen::ColMajor), Dim,
                               MaxN == Eigen::Dynamic ? MaxN : Dim * MaxN>;
  /// Only for anisotropic anchors: Dim x (Dim N), each node's information matrix divided by k_i, with
  /// eigenvalues from 0 to 1.
  [[no_unique_address]] std::conditional_t<kAnisotropic, Shapes, Nothing> anchor_shape;
  /// Parameters of the anchors' loss and of the links' potential, if these have any.
  [[no_unique_address]] typename Model::AnchorLoss anchor_loss;
  [[no_unique_address]] typename Model::LinkPotential link_potential;

 private:
  // A matrix divided by its largest eigenvalue, which is returned; for any other matrix one that is refused.
  template <typename Derived, typename Block>
  static Scalar split(const Eigen::MatrixBase<Derived>& information, Block&& shape) {
    using Matrix = Eigen::Matrix<Scalar, Dim, Dim, Eigen::ColMajor>;
    const Matrix matrix = information;
    Matrix values = matrix;
    Matrix modes;
    detail::diagonalise(values, modes);
    const Scalar largest = detail::all_finite(matrix) ? values.diagonal().maxCoeff() : matrix.sum();
    if (largest > 0) {
      shape = matrix / largest;
    } else {
      shape.setIdentity();
    }
    return largest;
  }

  void set_fixed(int node, bool fixed) {
    if (node < 0 || node >= nodes()) {
      if (!defect_) defect_ = {"fixed node", node, "is out of range"};
    } else if (fixed_[node] != fixed) {
      fixed_[node] = fixed;
      fixed_count_ += fixed ? 1 : -1;
    }
  }

  TopologyType topology_;
  Eigen::Array<bool, N, 1, Eigen::ColMajor, MaxN, 1> fixed_;
  int fixed_count_ = 0;
  Defect defect_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
