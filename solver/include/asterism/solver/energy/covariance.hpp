#pragma once

#include <Eigen/SparseCore>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/free_motion.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/matrix/dense_factor.hpp>
#include <asterism/solver/matrix/sparse_factor.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <limits>
#include <new>
#include <ostream>
#include <string_view>
#include <type_traits>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Whether a covariance was computed, or why not.
enum class CovarianceStatus {
  Computed,             ///< the only one with a covariance
  NotPositiveDefinite,  ///< the Hessian is not, to the digits of the scalar, or a rigid motion changes no
                        ///< energy, which the message names: x is not a strict local minimum
  NumericalFailure,     ///< the Hessian leaves the range of the scalar
  InvalidInput,         ///< the message names the offending value
  OutOfMemory,
};

constexpr std::string_view to_string(CovarianceStatus status) {
  switch (status) {
    case CovarianceStatus::Computed:
      return "computed";
    case CovarianceStatus::NotPositiveDefinite:
      return "not positive definite";
    case CovarianceStatus::NumericalFailure:
      return "numerical failure";
    case CovarianceStatus::InvalidInput:
      return "invalid input";
    case CovarianceStatus::OutOfMemory:
      return "out of memory";
  }
  return "unknown status";
}

inline std::ostream& operator<<(std::ostream& out, CovarianceStatus status) {
  return out << to_string(status);
}

/// The covariance of all nodes, or the reason why it was not computed.
template <typename System>
struct Covariance {
  CovarianceStatus status = CovarianceStatus::InvalidInput;  ///< whether there is one
  Message message;                                           ///< what is wrong, where there is none
  /// (Dim N) x (Dim N), symmetric; coordinate d of node i is row Dim i + d [px^2 for stiffness in 1/px^2].
  /// If it was not computed, it is empty; for a fixed number of nodes, its entries are NaN.
  DenseHessian<System> matrix;

  /// Whether it was computed.
  explicit operator bool() const { return status == CovarianceStatus::Computed; }
};

/// The covariance of each node, or the reason why it was not computed.
template <typename System>
struct NodeCovariances {
  static constexpr int kDim = System::kDim;
  /// One Dim x Dim block for each node, side by side.
  using Blocks = Eigen::Matrix<typename System::Scalar, kDim, detail::times<System::kNodes>(kDim),
                               (kDim == 1 ? Eigen::RowMajor : Eigen::ColMajor), kDim,
                               detail::times<System::kMaxNodes>(kDim)>;

  CovarianceStatus status = CovarianceStatus::InvalidInput;  ///< whether there is one
  Message message;                                           ///< what is wrong, where there is none
  /// Dim x (Dim N), the nodes' symmetric blocks side by side [px^2 for stiffness in 1/px^2]. Where they were
  /// refused there are no entries, or NaN for a fixed number of nodes.
  Blocks blocks;

  /// Node i's Dim x Dim block.
  auto of(int node) const { return blocks.template middleCols<kDim>(kDim * node); }
  /// Whether it was computed.
  explicit operator bool() const { return status == CovarianceStatus::Computed; }
};

namespace detail {

constexpr const char* kIndefinite =
    "the Hessian is not positive definite to the digits of the scalar: x is not a strict local minimum";

/// Between the refusals: compute(result) says Computed, or why not, of valid input.
template <typename Result, typename System, typename Compute>
Result covariance_of_valid(const System& system, const typename System::Points& x, Compute&& compute) {
  Result result;
  const auto refuse = [&result](CovarianceStatus status, const Message& message) {
    result.status = status;
    result.message = message;
  };
  const auto compute_or_refuse = [&] {
    if (const Defect defect = validate(system, x)) return refuse(CovarianceStatus::InvalidInput, defect);
    if (const int l = peaked_link(system, x); l >= 0) {
      return refuse(CovarianceStatus::NotPositiveDefinite,
                    Defect{"link", l, "has ends that coincide: x is not a local minimum"});
    }
    if (const FreeMotion motion = FreeMotions<System>().find(system, x)) {
      Message reason = "the Hessian is not positive definite: ";
      return refuse(CovarianceStatus::NotPositiveDefinite, reason.append(motion.message()));
    }
    result.status = compute(result);
    if (result.status == CovarianceStatus::Computed) return;
    refuse(result.status, result.status == CovarianceStatus::NotPositiveDefinite
                              ? kIndefinite
                              : "the Hessian leaves the range of the scalar");
  };
  attempt<std::bad_alloc>(compute_or_refuse, [&](const std::bad_alloc& error) {
    refuse(CovarianceStatus::OutOfMemory, memory_message(error));
  });
  return result;
}

/// H^-1 by Cholesky, into `inverse`. Pivots that are rounding alone beside the diagonal are refused.
template <typename System>
CovarianceStatus invert_hessian(const System& system, const typename System::Points& x,
                                DenseHessian<System>& inverse) {
  using Scalar = typename System::Scalar;
  constexpr Scalar kRounding = 8 * std::numeric_limits<Scalar>::epsilon();
  if constexpr (System::kMaxNodes == Eigen::Dynamic) {
    const double size = double{System::kDim} * system.nodes();
    require_memory(3 * sizeof(Scalar) * size * size);  // the inverse, the factor, and the transpose
  }
  inverse = hessian(system, x);
  if (!all_finite(inverse)) return CovarianceStatus::NumericalFailure;
  DenseHessian<System> factor = inverse;
  if (!DenseFactor<Scalar>::factorize(factor.data(), factor.rows()))
    return CovarianceStatus::NotPositiveDefinite;
  const auto pivots = factor.diagonal().array().square();
  if (!(pivots > kRounding * inverse.diagonal().array()).all()) return CovarianceStatus::NotPositiveDefinite;
  DenseFactor<Scalar>::invert(factor.data(), factor.rows(), inverse.data());
  inverse = Scalar(0.5) * (inverse + inverse.transpose().eval());
  if (!all_finite(inverse)) return CovarianceStatus::NumericalFailure;
  for (int i = 0; system.fixed_count() > 0 && i < system.nodes(); ++i) {
    if (system.is_fixed(i)) inverse.diagonal().template segment<System::kDim>(System::kDim * i).setZero();
  }
  return CovarianceStatus::Computed;
}

template <typename System>
CovarianceStatus dense_node_covariances(const System& system, const typename System::Points& x,
                                        typename NodeCovariances<System>::Blocks& blocks) {
  constexpr int kDim = System::kDim;
  DenseHessian<System> inverse;
  const CovarianceStatus status = invert_hessian(system, x, inverse);
  if (status != CovarianceStatus::Computed) return status;
  blocks.resize(kDim, kDim * system.nodes());
  for (int i = 0; i < system.nodes(); ++i) {
    blocks.template middleCols<kDim>(kDim * i) = inverse.template block<kDim, kDim>(kDim * i, kDim * i);
  }
  return status;
}

/// The entries of Z = (L D L^T)^-1 on the pattern of L, L with a unit diagonal: Takahashi, Fagan and Chin
/// (1973), Erisman and Tinney (1975). From the last column to the first, those of a column follow from
/// entries of the pattern alone:
///   Z_Sj = -Z_SS L_Sj,  Z_jj = 1 / D_j - L_Sj^T Z_Sj,  S the rows below the diagonal in column j of L.
/// Columns next to each other of the same S (a supernode J) are taken together, with Y = L_SJ L_JJ^-1:
///   Z_SJ = -Z_SS Y,  Z_JJ = (L_JJ D_J L_JJ^T)^-1 - Y^T Z_SJ,
/// for Z_SS to be gathered once and the products to be those of dense matrices.
template <typename Scalar>
class SelectedInverse {
 public:
  using Sparse = Eigen::SparseMatrix<Scalar>;
  using Vector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;

  /// `lower` holds L below its unit diagonal, rows in ascending order, compressed; it is to outlive this.
  SelectedInverse(const Sparse& lower, const Vector& pivots);

  /// Z_ij for i = j or an entry (i, j) of the pattern.
  Scalar operator()(int i, int j) const {
    if (i == j) return diagonal_[i];
    const int column = std::min(i, j);
    const int* at = std::lower_bound(rows_ + first_[column], rows_ + first_[column + 1], std::max(i, j));
    return values_[static_cast<std::size_t>(at - rows_)];
  }

 private:
  using Matrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor>;

  int count(int column) const { return first_[column + 1] - first_[column]; }

  // Whether columns j and j + 1 belong to one supernode: j's rows are j + 1 and those of j + 1, which hold
  // the rest of j's anyway.
  bool continues(int j) const { return count(j) == count(j + 1) + 1 && rows_[first_[j]] == j + 1; }

  // Columns begin to end - 1, those from `end` on being there.
  void invert(int begin, int end, const Vector& pivots) {
    const int width = end - begin;
    const int m = count(end - 1);
    const int* const below = rows_ + first_[end - 1];
    triangle_.setIdentity(width, width);
    product_.resize(m, width);
    for (int c = 0; c < width; ++c) {
      const Scalar* column = factor_ + first_[begin + c];
      for (int r = c + 1; r < width; ++r) triangle_(r, c) = *column++;
      std::copy_n(column, m, product_.col(c).data());
    }
    const auto L = triangle_.template triangularView<Eigen::UnitLower>();
    square_.setIdentity(width, width);
    L.solveInPlace(square_);  // L_JJ^-1
    block_ = pivots.segment(begin, width).cwiseInverse().asDiagonal() * square_;
    inverse_.noalias() = square_.transpose() * block_;
    if (m > 0) {
      gather(below, m);
      L.template solveInPlace<Eigen::OnTheRight>(product_);  // Y
      block_.noalias() = gathered_.template selfadjointView<Eigen::Lower>() * product_;
      inverse_.noalias() += product_.transpose() * block_;
    }
    for (int c = 0; c < width; ++c) {
      diagonal_[begin + c] = inverse_(c, c);
      Scalar* column = values_.data() + first_[begin + c];
      for (int r = c + 1; r < width; ++r) *column++ = inverse_(r, c);
      for (int r = 0; r < m; ++r) *column++ = -block_(r, c);
    }
  }

  // Lower triangle of Z_SS. By the rules of fill, column S_a has all of S beyond it among its rows.
  void gather(const int* rows, int m) {
    gathered_.resize(m, m);
    for (int a = 0; a < m; ++a) {
      const int column = rows[a];
      gathered_(a, a) = diagonal_[column];
      const int* at = rows_ + first_[column];
      for (int b = a + 1; b < m; ++b, ++at) {
        while (*at != rows[b]) ++at;
        gathered_(b, a) = values_[static_cast<std::size_t>(at - rows_)];
      }
    }
  }

  const int* first_;
  const int* rows_;
  const Scalar* factor_;
  std::vector<Scalar> values_;  // of Z, at the places of L's
  Vector diagonal_;             // of Z
  Matrix triangle_, square_, inverse_, product_, block_, gathered_;
};

template <typename Scalar>
SelectedInverse<Scalar>::SelectedInverse(const Sparse& lower, const Vector& pivots)
    : first_(lower.outerIndexPtr()),
      rows_(lower.innerIndexPtr()),
      factor_(lower.valuePtr()),
      values_(static_cast<std::size_t>(lower.nonZeros())),
      diagonal_(pivots.size()) {
  int end = static_cast<int>(pivots.size());
  while (end > 0) {
    int begin = end - 1;
    while (begin > 0 && continues(begin - 1)) --begin;
    invert(begin, end, pivots);
    end = begin;
  }
}

#ifdef ASTERISM_SOLVER_COMPILED
extern template ASTERISM_API SelectedInverse<double>::SelectedInverse(const Sparse&, const Vector&);
extern template ASTERISM_API SelectedInverse<float>::SelectedInverse(const Sparse&, const Vector&);
#endif

template <typename System>
CovarianceStatus sparse_node_covariances(const System& system, const typename System::Points& x,
                                         typename NodeCovariances<System>::Blocks& blocks) {
  using Scalar = typename System::Scalar;
  using Sparse = Eigen::SparseMatrix<Scalar>;
  constexpr int kDim = System::kDim;
  constexpr Scalar kRounding = 8 * std::numeric_limits<Scalar>::epsilon();
  SparseFactor<Scalar> cholesky;
  {
    const Sparse matrix = sparse_hessian(system, x);
    if (!all_finite(matrix.coeffs())) return CovarianceStatus::NumericalFailure;
    cholesky.analyze(matrix, 2);  // the factor and as many entries of the inverse
    cholesky.factorize(matrix);
    if (cholesky.info() != Eigen::Success) return CovarianceStatus::NotPositiveDefinite;
    const Eigen::Matrix<Scalar, Eigen::Dynamic, 1> pivots = cholesky.permutationPinv() * cholesky.vectorD();
    if (!(pivots.array() > kRounding * matrix.diagonal().array()).all())
      return CovarianceStatus::NotPositiveDefinite;
  }
  const SelectedInverse<Scalar> inverse(cholesky.matrixL().nestedExpression(), cholesky.vectorD());
  const auto& place = cholesky.permutationP().indices();
  blocks.resize(kDim, kDim * system.nodes());
  for (int i = 0; i < system.nodes(); ++i) {
    for (int row = 0; row < kDim; ++row) {
      for (int column = 0; column < kDim; ++column) {
        blocks(row, kDim * i + column) =
            system.is_fixed(i) ? Scalar(0) : inverse(place[kDim * i + row], place[kDim * i + column]);
      }
    }
  }
  if (!all_finite(blocks)) return CovarianceStatus::NumericalFailure;
  return CovarianceStatus::Computed;
}

}  // namespace detail

/// The covariance of x by Laplace's approximation: for E = -log p, up to a constant, p is near its maximum x
/// the Gaussian of mean x and covariance H^-1, H = d2E/dx2 (Bishop, Pattern Recognition and Machine Learning,
/// 4.4). x (Dim x N) is to be a solution: the result describes p's spread about it and no other mode.
///
/// The inverse of IDA's matrix K_dyn, which lies above H, is no substitute: it underestimates.
///
/// Refused, with a message: bad input as for a solver, a Hessian that is not positive definite to the digits
/// of the scalar (a saddle, a flat direction, linked nodes that coincide and push each other apart), a
/// component or a part of one that anchors and fixed nodes leave free to turn or slide (one held node in the
/// plane; one, or several on a line, in space), overflow, lack of memory. A fixed node has covariance zero,
/// others are conditioned on it. O((Dim N)^3); a fixed or bounded number of nodes uses no heap.
template <typename System>
Covariance<System> covariance(const System& system, const typename System::Points& x) {
  auto result = detail::covariance_of_valid<Covariance<System>>(
      system, x, [&](auto& r) { return detail::invert_hessian(system, x, r.matrix); });
  if (!result) detail::clear_numbers(result.matrix);
  return result;
}

/// Only the diagonal blocks of covariance(): each node's own Dim x Dim covariance, marginal over the other
/// nodes. For many nodes with few links each the Hessian is factored as a sparse matrix and only the
/// entries of its inverse on the factor's pattern are computed (selected inversion); time and memory are
/// those of the factorisation. A fixed or bounded number of nodes uses no heap.
template <typename System>
NodeCovariances<System> node_covariances(const System& system, const typename System::Points& x) {
  auto result = detail::covariance_of_valid<NodeCovariances<System>>(system, x, [&](auto& r) {
    if constexpr (System::kMaxNodes == Eigen::Dynamic) {
      if (detail::is_large_and_sparse(system)) return detail::sparse_node_covariances(system, x, r.blocks);
    }
    return detail::dense_node_covariances(system, x, r.blocks);
  });
  if (!result) detail::clear_numbers(result.blocks);
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
