#pragma once

// The sum over rows of links by one instruction set's vectors. No standard library, see batch_lanes.hpp.
#include "../batch_lanes.hpp"
#include "kernels.hpp"

namespace asterism::lanes_v0_1 {
namespace {

// How many of `count` pairs are a row.
ASTERISM_INLINE int row_length(const int* pairs, int count) {
  const int i = pairs[0], j = pairs[1];
  int differs = 0;
  for (int e = 0; e < count; ++e) differs |= (pairs[2 * e] ^ i) | (pairs[2 * e + 1] ^ (j + e));
  if (differs == 0) return count;
  int e = 1;
  while (pairs[2 * e] == i && pairs[2 * e + 1] == j + e) ++e;
  return e;
}

// kDim is the number of coordinates, or 0 where it is known at run time.
template <typename L, int kDim, bool kHooke, bool kWithForces>
double sum_of(const LinkRows& links) {
  using V = typename L::V;
  constexpr int kLanes = L::kLanes, kMost = kDim > 0 ? kDim : kMostCoordinates;
  const int dim = kDim > 0 ? kDim : links.dim;
  const V zero = L::set(0), one = L::set(1), least = L::set(kLeastLengthSquare);
  const double* points[kMost];
  double* forces[kMost];
  for (int c = 0; c < dim; ++c) {
    points[c] = links.points + c * links.stride;
    forces[c] = links.forces + (kWithForces ? c * links.stride : 0);
  }
  V energy = zero;
  for (int first = 0, length, i = 0, j = 1; first < links.count; first += length, j = ++i + 1) {
    if (links.pairs != nullptr) i = links.pairs[2 * first], j = links.pairs[2 * first + 1];
    const int most = links.count - first, to_last = links.nodes - j;
    length = most < to_last ? most : to_last;
    if (links.pairs != nullptr) length = row_length(links.pairs + 2 * first, length);
    const double* const lower = links.lower.data + first * links.lower.stride;
    const double* const upper = links.upper.data + first * links.upper.stride;
    const double* const stiffness = links.stiffness.data + first * links.stiffness.stride;
    V from[kMost], sum[kMost];
    for (int c = 0; c < dim; ++c) from[c] = L::set(points[c][i]), sum[c] = zero;
    V shortest = least;

    // The links to the nodes from `to` on, those in the lanes of `which` if not all are in the row.
    const auto add = [&](int to, bool is_whole, typename L::M which, V lower_of, V upper_of, V stiffness_of)
                         ASTERISM_INLINED {
                           V d[kMost], square = zero;
                           for (int c = 0; c < dim; ++c) {
                             d[c] = from[c] - L::load(points[c] + to);
                             square = L::fma(d[c], d[c], square);
                           }
                           if (!is_whole) square = L::select(which, square, one);
                           shortest = L::min(square, shortest);
                           const V inverse = L::inverse_sqrt(L::max(square, least));
                           const V r = square * inverse;
                           V stretch = r - lower_of;
                           if (!kHooke) stretch = L::min(stretch, zero) + L::max(r - upper_of, zero);
                           const V k = L::select(L::at_most(least, square), stiffness_of, zero);
                           const V tension = k * stretch;
                           energy = L::fma(tension, stretch, energy);
                           if (!kWithForces) return;
                           const V weight = tension * inverse;
                           energy = L::fma(weight, zero, energy);
                           for (int c = 0; c < dim; ++c) {
                             double* const at = forces[c] + to;
                             const V force = weight * d[c];
                             sum[c] = sum[c] + force;
                             L::store(at, L::load(at) - force);
                           }
                         };
    // Vectors begin at multiples of their size: what one row has stored, the next one loads as a whole.
    for (int to = j - j % kLanes; to < j + length; to += kLanes) {
      const std::ptrdiff_t e = to - j;
      if (e >= 0 && e + kLanes <= length) {
        add(to, true, lanes_between<L>(0, kLanes), L::load(lower + e), L::load(upper + e),
            L::load(stiffness + e));
      } else {  // the others have no stiffness
        const auto which = lanes_between<L>(-e, length - e);
        add(to, false, which, L::load(lower + e, which), L::load(upper + e, which),
            L::load(stiffness + e, which));
      }
    }
    for (int c = 0; kWithForces && c < dim; ++c) forces[c][i] += L::sum(sum[c]);

    if (L::bits(L::less(shortest, least)) == 0) continue;
    for (int e = 0; e < length; ++e) {
      double square = 0;
      for (int c = 0; c < dim; ++c) {
        const double offset = points[c][i] - points[c][j + e];
        square += offset * offset;
      }
      if (!(square >= kLeastLengthSquare)) links.left_out(links.context, first + e);
    }
  }
  return L::sum(energy);
}

template <int kDim>
double sum_in(const LinkRows& links) {
  using L = DoubleLanes;
  const bool with_forces = links.forces != nullptr;
  if (links.is_hooke)
    return with_forces ? sum_of<L, kDim, true, true>(links) : sum_of<L, kDim, true, false>(links);
  return with_forces ? sum_of<L, kDim, false, true>(links) : sum_of<L, kDim, false, false>(links);
}

double run_with_these_instructions(const LinkRows& links) {
  if (links.dim == 2) return sum_in<2>(links);
  return links.dim == 3 ? sum_in<3>(links) : sum_in<0>(links);
}

}  // namespace
}  // namespace asterism::lanes_v0_1
