#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/matrix/diagonalise.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <cmath>
#include <limits>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// The rotation R (or, if allowed, reflection) that maximises trace(R^T M), for M = sum_i k_i q_i p_i^T the
/// one that turns the points p_i nearest to q_i; identity for M = 0. Two dimensions: the angle's tangent is
/// (M10 - M01) / (M00 + M11). Three: Horn's quaternion (Closed-form solution of absolute orientation, 1987).
/// More: singular vectors (Kabsch 1976), which need <Eigen/Dense>.
template <typename Scalar, int Dim>
Eigen::Matrix<Scalar, Dim, Dim, Eigen::ColMajor> nearest_rotation(
    Eigen::Matrix<Scalar, Dim, Dim, Eigen::ColMajor> M, bool allow_reflection) {
  using Matrix = Eigen::Matrix<Scalar, Dim, Dim, Eigen::ColMajor>;
  Scalar size = M.squaredNorm();
  if (!(size > std::numeric_limits<Scalar>::min() && is_finite(size * size))) [[unlikely]] {
    const Scalar largest = largest_size(M);
    if (!(largest > 0 && is_finite(largest))) return Matrix::Identity();
    M /= largest;
    size = M.squaredNorm();
  }
  constexpr Scalar kRounding = 8 * std::numeric_limits<Scalar>::epsilon();
  Matrix R = Matrix::Identity();
  if constexpr (Dim == 2) {
    Scalar cosine = M(0, 0) + M(1, 1);
    Scalar sine = M(1, 0) - M(0, 1);
    Scalar square = cosine * cosine + sine * sine;
    const Scalar mirrored_cosine = M(0, 0) - M(1, 1);
    const Scalar mirrored_sine = M(1, 0) + M(0, 1);
    const Scalar mirrored_square = mirrored_cosine * mirrored_cosine + mirrored_sine * mirrored_sine;
    const bool mirror = allow_reflection && mirrored_square > (1 + kRounding) * square;
    if (mirror) {
      cosine = mirrored_cosine;
      sine = mirrored_sine;
      square = mirrored_square;
    }
    if (!(square > kRounding * kRounding * size)) return R;  // no angle is better than another
    const Scalar inverse = 1 / std::sqrt(square);
    cosine *= inverse;
    sine *= inverse;
    R(0, 0) = cosine;
    R(1, 0) = sine;
    R(0, 1) = mirror ? sine : -sine;
    R(1, 1) = mirror ? -cosine : cosine;
  } else if constexpr (Dim == 3) {
    Eigen::Matrix<Scalar, 4, 4, Eigen::ColMajor> N;  // lower triangle
    N(0, 0) = M(0, 0) + M(1, 1) + M(2, 2);
    N(1, 0) = M(2, 1) - M(1, 2);
    N(2, 0) = M(0, 2) - M(2, 0);
    N(3, 0) = M(1, 0) - M(0, 1);
    N(1, 1) = M(0, 0) - M(1, 1) - M(2, 2);
    N(2, 1) = M(1, 0) + M(0, 1);
    N(3, 1) = M(0, 2) + M(2, 0);
    N(2, 2) = -M(0, 0) + M(1, 1) - M(2, 2);
    N(3, 2) = M(2, 1) + M(1, 2);
    N(3, 3) = -M(0, 0) - M(1, 1) + M(2, 2);
    Eigen::Matrix<Scalar, 4, 4, Eigen::ColMajor> vectors;
    diagonalise(N, vectors);
    int least = 0;
    int largest = 0;
    for (int k = 1; k < 4; ++k) {
      if (N(k, k) < N(least, least)) least = k;
      if (N(k, k) > N(largest, largest)) largest = k;
    }
    // -M has the matrix -N, and minus a rotation is a reflection.
    const bool mirror = allow_reflection && -N(least, least) > (1 + kRounding) * N(largest, largest);
    const Eigen::Matrix<Scalar, 4, 1> q = vectors.col(mirror ? least : largest).normalized();
    const Scalar w = q[0], x = q[1], y = q[2], z = q[3];
    R << 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),  //
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),   //
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y);
    if (mirror) R = -R;
  } else if constexpr (Dim == 1) {
    if (allow_reflection && M(0, 0) < 0) R(0, 0) = -1;
  } else {
    // <Eigen/SVD> takes every other program a second to read.
    static_assert(
        requires { sizeof(Eigen::JacobiSVD<Matrix>); },
        "systems of more than three dimensions also need <Eigen/Dense>, included before this header");
    const Eigen::JacobiSVD<Matrix> svd(M, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Matrix U = svd.matrixU();
    if (!allow_reflection && (U * svd.matrixV().transpose()).determinant() < 0) U.col(Dim - 1) *= -1;
    R = U * svd.matrixV().transpose();
  }
  return R;
}

/// rigid_alignment in place; false if x stays as it was.
template <typename System>
bool align(const System& system, typename System::Points& x, bool allow_reflection) {
  using Scalar = typename System::Scalar;
  using Point = typename System::Point;
  constexpr int kDim = System::kDim;
  if (system.fixed_count() != 0 || system.has_loads()) return false;
  const int n = system.nodes();
  // An anchor's spring, or the one that lies above its loss here: lowering these lowers that.
  const auto weight = [&](int i) {
    const Scalar k = system.anchor_stiffness[i];
    if constexpr (System::kPlainAnchors) return k;
    const Point d = anchor_offset(system, i, x);
    return k * system.anchor_loss(d.dot(anchor_shaped(system, i, d))).first;
  };
  // An anchor without stiffness means nothing: its position, which is finite, is multiplied by 0 first.
  Scalar total = 0;
  Scalar centre[kDim] = {}, anchor_centre[kDim] = {};
  for (int i = 0; i < n; ++i) {
    const Scalar k = weight(i);
    total += k;
    for (int c = 0; c < kDim; ++c) {
      centre[c] += k * x(c, i);
      anchor_centre[c] += k * system.anchors(c, i);
    }
  }
  if (!(total > 0 && is_finite(total))) return false;
  const Scalar inverse = 1 / total;
  Scalar offset = 0;    // of the centres from the origin
  Scalar distance = 0;  // between them, squared
  for (int c = 0; c < kDim; ++c) {
    centre[c] *= inverse;
    anchor_centre[c] *= inverse;
    const Scalar difference = centre[c] - anchor_centre[c];
    offset += centre[c] * centre[c] + anchor_centre[c] * anchor_centre[c];
    distance += difference * difference;
  }

  auto M = diagonal<kDim>(Scalar(0));
  Scalar spread = 0;
  Scalar anchor_spread = 0;
  for (int i = 0; i < n; ++i) {
    const Scalar k = weight(i);
    for (int c = 0; c < kDim; ++c) {
      const Scalar p = x(c, i) - centre[c], q = system.anchors(c, i) - anchor_centre[c];
      for (int r = 0; r < kDim; ++r) M(r, c) += p * (k * (system.anchors(r, i) - anchor_centre[r]));
      spread += k * p * p;
      anchor_spread += k * q * q;
    }
  }
  // On one point up to rounding: nothing to turn.
  constexpr Scalar kRounding = 8 * std::numeric_limits<Scalar>::epsilon();
  const Scalar rounding = kRounding * kRounding * (total * offset);
  if (!(spread > rounding && anchor_spread > rounding) || system.has_offsets()) M.setZero();
  const auto R = nearest_rotation<Scalar, kDim>(M, allow_reflection);
  const auto moved = [&](int i) {
    Point result;
    for (int r = 0; r < kDim; ++r) {
      result[r] = anchor_centre[r];
      for (int c = 0; c < kDim; ++c) result[r] += R(r, c) * (x(c, i) - centre[c]);
    }
    return result;
  };

  if constexpr (System::kPlainAnchors) {
    // Twice what the anchors' energy falls by, as the cross terms of centre and spread vanish.
    Scalar turn = 0;  // the trace of (R - I)^T M
    for (int c = 0; c < kDim; ++c) {
      for (int r = 0; r < kDim; ++r) turn += (R(r, c) - Scalar(r == c ? 1 : 0)) * M(r, c);
    }
    const Scalar gain = total * distance + 2 * turn;
    if (!(gain > kRounding * (spread + anchor_spread) + rounding)) return false;
  } else {
    Scalar before = 0;
    Scalar after = 0;
    for (int i = 0; i < n; ++i) {
      if (!(system.anchor_stiffness[i] > 0)) continue;
      before += anchor_force(system, i, x.col(i) - system.anchors.col(i)).energy;
      after += anchor_force(system, i, moved(i) - system.anchors.col(i)).energy;
    }
    if (!(after < before)) return false;
  }
  for (int i = 0; i < n; ++i) x.col(i) = moved(i);
  return true;
}

}  // namespace detail

/// x (Dim x N) moved and turned as one rigid body to where sum_i k_i |x_i - a_i|^2 is least (weighted
/// Procrustes, in closed form). No spring between nodes changes its length, so the energy cannot rise. The
/// slowest modes of a system with weak anchors vanish in one step. With `allow_reflection`, x may become its
/// mirror image, if that is nearer. Does not allocate.
///
/// If links have offsets or information matrices, x is moved and not turned, as these do not turn with it.
/// The same holds if all nodes whose anchor has stiffness coincide, or all these anchors do (for example, if
/// only one anchor has stiffness). x is returned unchanged if no rigid motion is better, if no anchor has
/// stiffness, if numbers overflow, or if a node is fixed or has a load. For a robust loss, the springs that
/// lie above it at x stand for the anchors; for information matrices, their largest eigenvalue. In these two
/// cases x is returned unchanged if the motion does not lower the energy.
template <typename System>
typename System::Points rigid_alignment(const System& system, const typename System::Points& x,
                                        bool allow_reflection = false) {
  typename System::Points result = x;
  detail::align(system, result, allow_reflection);
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
