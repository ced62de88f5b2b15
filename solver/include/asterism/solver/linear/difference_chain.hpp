#pragma once

// The arithmetic of one chain, for DifferenceChains, or of several side by side in the lanes of a vector. No
// Eigen and no standard library: kernels that use it are compiled for wider instructions than their callers
// (see batch_kernels.hpp).
#include <cstddef>

namespace asterism::lanes_v0_1 {

/// A chain of DifferenceChains. Real: double, or a vector of the compiler. Symmetric blocks are upper
/// triangles, row by row.
template <int Dim, typename Real>
struct DifferenceChain {
  static constexpr int kEntries = Dim * (Dim + 1) / 2;  ///< of a symmetric block
  /// The number of entry (r, c) of a symmetric block among these.
  static constexpr int entry(int r, int c) {
    const int low = r < c ? r : c, high = r < c ? c : r;
    return low * Dim - low * (low - 1) / 2 + high - low;
  }

  std::ptrdiff_t points;       ///< of the chain
  std::ptrdiff_t stride;       ///< point t is number t * stride of each array
  const double* coefficients;  ///< a, b, c (points - 2, 3), without stride
  Real* inverse;               ///< of the eliminated diagonal blocks S_t (points, kEntries)
  Real* next;                  ///< S_t^-1 times the block (t, t + 1) (points, Dim, Dim)
  Real* second;                ///< the block (t, t + 2) is this times the identity (points)

  /// The arguments of DifferenceChains::factorize. check: called with each pivot.
  template <typename Check>
  void factorize(const Real* information, const Real* weight, const Real* prior, Check&& check) {
    Real here[kEntries], after[kEntries],
        coupling[Dim][Dim];  // of the rows t and t + 1, as far as eliminated
    for (int k = 0; k < kEntries; ++k) here[k] = after[k] = Real{};
    add_diagonal(0, information, weight, here);
    if (points > 1) add_diagonal(1, information, weight, after);
    const Real first = neighbour(0, weight);
    for (int r = 0; r < Dim; ++r) {
      for (int c = 0; c < Dim; ++c) {
        coupling[r][c] = r == c ? first : Real{};
        if (prior == nullptr || points < 2) continue;
        coupling[r][c] += prior[r * 2 * Dim + Dim + c];
        if (r > c) continue;
        here[entry(r, c)] += prior[r * 2 * Dim + c];
        after[entry(r, c)] += prior[(Dim + r) * 2 * Dim + Dim + c];
      }
    }
    for (std::ptrdiff_t t = 0; t < points; ++t) {
      Real s[kEntries], g[Dim][Dim];
      invert(here, s, check);
      for (int r = 0; r < Dim; ++r) {
        for (int c = 0; c < Dim; ++c) {
          g[r][c] = s[entry(r, 0)] * coupling[0][c];
          for (int k = 1; k < Dim; ++k) g[r][c] += s[entry(r, k)] * coupling[k][c];
        }
      }
      const Real u =
          t + 2 < points ? weight[t * stride] * (coefficients[t * 3] * coefficients[t * 3 + 2]) : Real{};
      store(s, g, u, t);
      if (t + 1 == points) break;
      for (int r = 0; r < Dim; ++r) {
        for (int c = r; c < Dim; ++c) {
          Real left = after[entry(r, c)];
          for (int k = 0; k < Dim; ++k) left -= coupling[k][r] * g[k][c];
          here[entry(r, c)] = left;
        }
      }
      for (int k = 0; k < kEntries; ++k) after[k] = -u * u * s[k];
      if (t + 2 < points) add_diagonal(t + 2, information, weight, after);
      const Real along = neighbour(t + 1, weight);
      for (int r = 0; r < Dim; ++r) {
        for (int c = 0; c < Dim; ++c) coupling[r][c] = (r == c ? along : Real{}) - u * g[c][r];
      }
    }
  }

  /// x (points, Dim), which holds the right side, becomes the minimum.
  void solve(Real* x) const {
    Real here[Dim], after[Dim], behind[Dim];  // x at t, t + 1 and t + 2
    for (int r = 0; r < Dim; ++r) here[r] = after[r] = Real{};
    for (std::ptrdiff_t t = 0; t < points; ++t) {  // here, after: what the points before subtract at t, t + 1
      Real *at = x + t * stride * Dim, z[Dim];
      const Real *s = inverse + t * stride * kEntries, *g = next + t * stride * Dim * Dim;
      for (int r = 0; r < Dim; ++r) at[r] = z[r] = at[r] - here[r];
      for (int r = 0; r < Dim; ++r) {
        here[r] = after[r];
        Real sum = s[entry(r, 0)] * z[0];
        for (int k = 1; k < Dim; ++k) sum += s[entry(r, k)] * z[k];
        for (int k = 0; k < Dim; ++k) here[r] += g[k * Dim + r] * z[k];
        after[r] = second[t * stride] * sum;
      }
    }
    for (int r = 0; r < Dim; ++r) after[r] = behind[r] = Real{};
    for (std::ptrdiff_t t = points; t-- > 0;) {
      Real* at = x + t * stride * Dim;
      const Real *s = inverse + t * stride * kEntries, *g = next + t * stride * Dim * Dim;
      for (int r = 0; r < Dim; ++r) behind[r] = at[r] - second[t * stride] * behind[r];
      for (int r = 0; r < Dim; ++r) {
        here[r] = s[entry(r, 0)] * behind[0];
        for (int k = 1; k < Dim; ++k) here[r] += s[entry(r, k)] * behind[k];
        for (int k = 0; k < Dim; ++k) here[r] -= g[r * Dim + k] * after[k];
      }
      for (int r = 0; r < Dim; ++r) {
        behind[r] = after[r];
        at[r] = after[r] = here[r];
      }
    }
  }

  /// covariance: of each point (points, kEntries). spread: the trace of the covariance of each difference
  /// (points - 2). Takahashi's recursion from the last point.
  void covariance(Real* covariance, Real* spread) const {
    // Cov(t + 1), Cov(t + 2) and Cov(t + 1, t + 2); beyond the last point all are 0.
    Real first[kEntries], beyond[kEntries], both[Dim][Dim];
    for (int r = 0; r < Dim; ++r) {
      for (int c = 0; c < Dim; ++c) first[entry(r, c)] = beyond[entry(r, c)] = both[r][c] = Real{};
    }
    for (std::ptrdiff_t t = points; t-- > 0;) {
      const Real *s = inverse + t * stride * kEntries, *g = next + t * stride * Dim * Dim;
      const Real u = second[t * stride];
      Real here[kEntries], one[Dim][Dim], two[Dim][Dim];  // Cov(t), Cov(t, t + 1), Cov(t, t + 2)
      Real far[kEntries];                                 // S_t^-1 times the block (t, t + 2)
      for (int k = 0; k < kEntries; ++k) far[k] = u * s[k];
      for (int r = 0; r < Dim; ++r) {
        for (int c = 0; c < Dim; ++c) {
          one[r][c] = two[r][c] = Real{};
          for (int k = 0; k < Dim; ++k) {
            one[r][c] -= g[r * Dim + k] * first[entry(k, c)] + far[entry(r, k)] * both[c][k];
            two[r][c] -= g[r * Dim + k] * both[k][c] + far[entry(r, k)] * beyond[entry(k, c)];
          }
        }
      }
      for (int r = 0; r < Dim; ++r) {
        for (int c = r; c < Dim; ++c) {
          Real sum = s[entry(r, c)];
          for (int k = 0; k < Dim; ++k) sum -= one[r][k] * g[c * Dim + k] + two[r][k] * far[entry(c, k)];
          here[entry(r, c)] = sum;
        }
      }
      if (t + 2 < points) {
        const double* a = coefficients + t * 3;
        Real sum{};
        for (int r = 0; r < Dim; ++r) {
          const int d = entry(r, r);
          sum += (a[0] * a[0]) * here[d] + (a[1] * a[1]) * first[d] + (a[2] * a[2]) * beyond[d] +
                 (2 * a[0] * a[1]) * one[r][r] + (2 * a[0] * a[2]) * two[r][r] +
                 (2 * a[1] * a[2]) * both[r][r];
        }
        spread[t * stride] = sum;
      }
      for (int r = 0; r < Dim; ++r) {
        for (int c = 0; c < Dim; ++c) both[r][c] = one[r][c];
      }
      for (int k = 0; k < kEntries; ++k) {
        covariance[t * stride * kEntries + k] = here[k];
        beyond[k] = first[k];
        first[k] = here[k];
      }
    }
  }

  /// The inverse of a block, by A = L D L^T. check: called with each pivot, the entries of D.
  template <typename Check>
  static void invert(const Real* a, Real* inverse, Check&& check) {
    Real l[Dim][Dim], below[Dim][Dim], one_over[Dim] = {};  // below: of L^-1
    for (int c = 0; c < Dim; ++c) {
      for (int r = c; r < Dim; ++r) {
        Real left = a[entry(c, r)];
        for (int k = 0; k < c; ++k) left -= l[r][k] * below[c][k];
        below[r][c] = left;  // L D, for now
        if (r > c) l[r][c] = left * one_over[c];
        if (r == c) {
          check(left);
          one_over[c] = 1.0 / left;
        }
      }
    }
    for (int r = 0; r < Dim; ++r) {
      for (int c = 0; c < r; ++c) {
        Real sum = l[r][c];
        for (int k = c + 1; k < r; ++k) sum += l[r][k] * below[k][c];
        below[r][c] = -sum;
      }
    }
    for (int r = 0; r < Dim; ++r) {
      for (int c = r; c < Dim; ++c) {
        Real sum = (r == c ? one_over[c] : below[c][r] * one_over[c]);
        for (int k = c + 1; k < Dim; ++k) sum += below[k][r] * below[k][c] * one_over[k];
        inverse[entry(r, c)] = sum;
      }
    }
  }

 private:
  void add_diagonal(std::ptrdiff_t t, const Real* information, const Real* weight, Real* block) const {
    Real sum{};
    for (std::ptrdiff_t k = 0; k < 3; ++k) {
      if (t < k || t - k + 2 >= points) continue;
      const double c = coefficients[(t - k) * 3 + k];
      sum += weight[(t - k) * stride] * (c * c);
    }
    for (int k = 0; k < kEntries; ++k) block[k] += information[t * stride * kEntries + k];
    for (int r = 0; r < Dim; ++r) block[entry(r, r)] += sum;
  }

  /// Of the block (t, t + 1), which the differences make a multiple of the identity.
  Real neighbour(std::ptrdiff_t t, const Real* weight) const {
    Real sum{};
    for (std::ptrdiff_t k = 0; k < 2; ++k) {
      if (t < k || t - k + 2 >= points) continue;
      const double* c = coefficients + (t - k) * 3;
      sum += weight[(t - k) * stride] * (c[k] * c[k + 1]);
    }
    return sum;
  }

  void store(const Real (&s)[kEntries], const Real (&g)[Dim][Dim], Real u, std::ptrdiff_t t) {
    for (int k = 0; k < kEntries; ++k) inverse[t * stride * kEntries + k] = s[k];
    for (int r = 0; r < Dim; ++r) {
      for (int c = 0; c < Dim; ++c) next[(t * stride * Dim + r) * Dim + c] = g[r][c];
    }
    second[t * stride] = u;
  }
};

}  // namespace asterism::lanes_v0_1
