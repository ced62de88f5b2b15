#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "minima.hpp"
#include "range_energy.hpp"

// What the identity of position_search.hpp proves without a search.
namespace asterism::ranges {

/// The minimum beside beacons that all have a last coordinate of 0, and its mirror image. E depends on the
/// other coordinates y and on the square h of the last one, and dE/dh = mu / 2 increases with h: at a minimum
/// mu is 0, or h is 0 and mu >= 0. By the identity, no point is lower, and only the mirror image is as low.
/// Newton's method on y and h >= 0 finds it, where x itself is a bad unknown: E hardly depends on the last
/// coordinate near 0. False, with nothing kept, if rounding leaves more than the minima are to be told to.
template <int D>
bool settle_flat(const RangeEnergy<D>& energy, Vector<D> x, Minima<D>& minima) {
  double h = x[D - 1] * x[D - 1];
  double e = 0, mu = 0;
  int last_steps = 0;
  for (int iteration = 0; iteration < 100; ++iteration) {
    Vector<D> slope = constant<D>(0);  // by y and h
    Symmetric<D> hessian = Symmetric<D>::zero();
    e = mu = 0;
    for (int i = 0; i < energy.count(); ++i) {
      Vector<D> p = energy.from_beacon(x, i);
      const double d = energy.length(p), w = energy.weight(i), v = w * energy.range(i) / d;
      e += 0.5 * w * (d - energy.range(i)) * (d - energy.range(i));
      mu += w - v;
      p[D - 1] = 0.5;
      for (int k = 0; k + 1 < D; ++k) slope[k] += (w - v) * p[k];
      hessian.add(v / (d * d), p);
    }
    slope[D - 1] = 0.5 * mu;
    for (int k = 0; k + 1 < D; ++k) hessian(k, k) += std::max(mu, 0.0) + 1e-13 * energy.total();
    hessian(D - 1, D - 1) += 1e-13 * energy.total();
    if (h == 0 && mu >= 0) {  // on the border
      slope[D - 1] = 0;
      for (int k = 0; k + 1 < D; ++k) hessian(D - 1, k) = 0;
    }
    const Vector<D> step = hessian.inverse().times(slope);
    // The last steps lower the energy by less than its rounding.
    const double decrease = dot(step, slope);
    const bool is_last = decrease < 1e-10 * (1 + e);
    if (!(decrease > 0) || (is_last && ++last_steps > 4)) break;
    bool is_lower = false;
    for (double share = 1; share > 1e-6 && !is_lower; share *= 0.5) {
      Vector<D> y = x;
      for (int k = 0; k + 1 < D; ++k) y[k] -= share * step[k];
      const double square = std::max(0.0, h - share * step[D - 1]);
      y[D - 1] = std::sqrt(square);
      is_lower = is_last || energy(y) < e;
      if (!is_lower) continue;
      x = y;
      h = square;
    }
    if (!is_lower) break;
  }
  Vector<D> gradient;
  Symmetric<D> hessian;
  e = energy.evaluate(x, gradient, hessian);
  const double reach = energy.reach() + norm(x);
  if (!(norm(gradient) * reach + 0.5 * std::max(0.0, -mu) * reach * reach < 0.5 * kBarrier)) return false;
  minima.add(x, e, hessian);
  return true;
}

/// Whether e^T A e + 2 t e.m + n t^2 > target for all unit e and low <= t <= high. `form`: A, m, n.
template <int D>
bool is_above(const Symmetric<D>& a, const Vector<D>& m, double n, double target, double low, double high) {
  double lambda = target;  // any number below the eigenvalues of A gives a bound
  for (int round = 0; round < 4; ++round) {
    const Symmetric<D> shifted = a.shifted(-lambda);
    if (!shifted.is_definite()) return false;
    const double rest = n - form(shifted.inverse(), m), t = rest >= 0 ? low : high;
    if (lambda + t * t * rest > target) return true;
    lambda += 0.3 * shifted.least_of_definite();
  }
  return false;
}

/// The radius up to which the identity excludes, in shells, other minima about one; infinite if there are
/// none.
template <int D>
double excluded_about(const RangeEnergy<D>& energy, const Minimum<D>& about, double threshold) {
  constexpr int kShells = 6, kForm = Symmetric<D>::kSize + D + 1;  // numbers of a form in (e, t)
  constexpr double kNone = std::numeric_limits<double>::infinity();
  using Forms = double[kForm][kShells];
  double edge[kShells + 1];
  edge[kShells] = 1.0000001 * (energy.reach() + norm(about.x));
  for (int k = kShells; k > 1; --k) edge[k - 1] = edge[k] / 2;
  edge[0] = 0;
  Forms height = {}, slope = {};
  double extra[kShells] = {}, mu = 0, scale = 0;
  const double ceiling = threshold + kBarrier;
  for (int i = 0; i < energy.count(); ++i) {
    const Vector<D> p = energy.from_beacon(about.x, i);
    const double d = energy.length(p), r = energy.range(i), v = energy.weight(i) * r / d;
    mu += energy.weight(i) - v;
    scale += v;
    // Below the ceiling, rho is between these.
    const double slack = std::sqrt(2 * ceiling / energy.weight(i)) + 1e-9 * energy.extent();
    double for_height[kShells], for_slope[kShells];
    for (int k = 0; k < kShells; ++k) {
      const double inner = edge[k], s = edge[k + 1];
      const double most = std::min(d + s, r + slack), least = std::max(std::max(d - s, r - slack), 0.0);
      const double t = 2 / (d + most);
      for_height[k] = v * t * t;
      // E' / s = mu + sum v (2 p.e + s) (p.e + s) / (rho (rho + d)), and the product is
      // 2 (p.e + 3 s / 4)^2 - s^2 / 8. A summand is never below -v |rho - d| / s.
      const double of_form = s * s / (8 * least * (d + least));
      const double of_all = std::min(1.0, std::max(most - d, d - least) / inner);
      const bool is_near = of_form < of_all;
      for_slope[k] = is_near ? 2 * v / (most * (d + most)) : 0;
      extra[k] += v * (is_near ? of_form : of_all);
    }
    double product[kForm];
    int n = 0;
    for (int k = 0; k < D; ++k)
      for (int l = 0; l <= k; ++l) product[n++] = p[k] * p[l];
    for (int k = 0; k < D; ++k) product[n++] = p[k];
    product[n] = 1;
    for (n = 0; n < kForm; ++n) {
      for (int k = 0; k < kShells; ++k) {
        height[n][k] += for_height[k] * product[n];
        slope[n][k] += for_slope[k] * product[n];
      }
    }
  }
  const auto exceeds = [](const Forms& forms, int k, double target, double low, double high) {
    Symmetric<D> a;
    Vector<D> m;
    for (int n = 0; n < Symmetric<D>::kSize; ++n) a.at[n] = forms[n][k];
    for (int n = 0; n < D; ++n) m[n] = forms[Symmetric<D>::kSize + n][k];
    return is_above(a, m, forms[kForm - 1][k], target, low, high);
  };
  const double gap = threshold - about.energy + kBarrier, rounding = 1e-9 * scale;
  for (int k = 0; k < kShells; ++k) {
    const double inner = edge[k], outer = edge[k + 1];
    if (exceeds(slope, k, extra[k] - mu + rounding, 0.75 * inner, 0.75 * outer)) continue;
    const double target = 2 * gap / (inner * inner) - mu + rounding;  // infinite in the first shell
    if (inner == 0 || !exceeds(height, k, target, 0.5 * inner, 0.5 * outer)) return inner;
  }
  return kNone;
}

}  // namespace asterism::ranges
