#pragma once

#include <algorithm>
#include <cmath>

// Vectors and symmetric matrices of two or three rows, by closed forms.
namespace asterism::ranges {

template <int D>
struct Vector {
  double at[D];
  double& operator[](int i) { return at[i]; }
  double operator[](int i) const { return at[i]; }
};

template <int D>
Vector<D> constant(double value) {
  Vector<D> v;
  for (double& a : v.at) a = value;
  return v;
}

template <int D>
double dot(const Vector<D>& a, const Vector<D>& b) {
  double sum = 0;
  for (int i = 0; i < D; ++i) sum += a[i] * b[i];
  return sum;
}

template <int D>
double norm(const Vector<D>& a) {
  return std::sqrt(dot(a, a));
}

template <int D>
double distance(const Vector<D>& a, const Vector<D>& b) {
  double sum = 0;
  for (int i = 0; i < D; ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum);
}

/// A symmetric matrix: the rows of its lower triangle.
template <int D>
struct Symmetric {
  static constexpr int kSize = D * (D + 1) / 2;
  double at[kSize];

  double& operator()(int i, int j) { return i >= j ? at[i * (i + 1) / 2 + j] : at[j * (j + 1) / 2 + i]; }
  double operator()(int i, int j) const { return i >= j ? at[i * (i + 1) / 2 + j] : at[j * (j + 1) / 2 + i]; }

  static Symmetric zero() {
    Symmetric m;
    for (double& a : m.at) a = 0;
    return m;
  }
  /// += factor p p^T
  void add(double factor, const Vector<D>& p) {
    int n = 0;
    for (int i = 0; i < D; ++i)
      for (int j = 0; j <= i; ++j) at[n++] += factor * p[i] * p[j];
  }
  /// *this + value I
  Symmetric shifted(double value) const {
    Symmetric m = *this;
    for (int i = 0; i < D; ++i) m(i, i) += value;
    return m;
  }
  Vector<D> times(const Vector<D>& v) const {
    Vector<D> product = constant<D>(0);
    for (int i = 0; i < D; ++i)
      for (int j = 0; j < D; ++j) product[i] += (*this)(i, j) * v[j];
    return product;
  }
  double trace() const {
    double sum = 0;
    for (int i = 0; i < D; ++i) sum += (*this)(i, i);
    return sum;
  }
  /// The determinant times the inverse.
  Symmetric adjugate() const {
    if constexpr (D == 2) {
      return {{at[2], -at[1], at[0]}};
    } else {
      return {{at[2] * at[5] - at[4] * at[4], at[3] * at[4] - at[1] * at[5], at[0] * at[5] - at[3] * at[3],
               at[1] * at[4] - at[2] * at[3], at[1] * at[3] - at[0] * at[4], at[0] * at[2] - at[1] * at[1]}};
    }
  }
  double determinant(const Symmetric& adjugate) const {
    double sum = 0;
    for (int i = 0; i < D; ++i) sum += (*this)(i, 0) * adjugate(i, 0);
    return sum;
  }
  double determinant() const { return determinant(adjugate()); }
  /// The inverse of a matrix that is not singular.
  Symmetric inverse() const {
    Symmetric m = adjugate();
    const double factor = 1 / determinant(m);
    for (double& a : m.at) a *= factor;
    return m;
  }
  /// Whether all eigenvalues are positive (Sylvester's criterion).
  bool is_definite() const {
    const double minor = at[0] * at[2] - at[1] * at[1];
    if (!(at[0] > 0 && minor > 0)) return false;
    if constexpr (D == 3) return determinant() > 0;
    return true;
  }
  /// A lower bound of the eigenvalues of a definite matrix, which is exact in the plane.
  double least_of_definite() const {
    const double sum = trace();
    if constexpr (D == 2)
      return std::max(0.0, 0.5 * (sum - std::hypot(at[0] - at[2], 2 * at[1])));
    else
      return 4 * determinant() / (sum * sum);  // the product of the others is at most (sum / 2)^2
  }
};

template <int D>
double form(const Symmetric<D>& m, const Vector<D>& v) {
  return dot(v, m.times(v));
}

/// The direction of the least eigenvalue of a matrix that is not definite, by powers of the inverse of one
/// that is, barely: as exact where the other eigenvalues are far larger, as across a valley.
template <int D>
Vector<D> lowest_direction(const Symmetric<D>& m) {
  double size = 0;
  for (double a : m.at) size = std::max(size, std::abs(a));
  Vector<D> v = constant<D>(1);
  for (double shift = 1e-16 * size; shift < 1e3 * size; shift *= 3) {
    const Symmetric<D> shifted = m.shifted(shift);
    if (!shifted.is_definite()) continue;
    const Symmetric<D> inverse = shifted.inverse();
    for (int i = 0; i < D; ++i) v[i] = 1 + 0.37 * i;
    for (int iteration = 0; iteration < 60; ++iteration) {
      v = inverse.times(v);
      const double length = norm(v);
      for (double& a : v.at) a /= length;
    }
    break;
  }
  return v;
}

}  // namespace asterism::ranges
