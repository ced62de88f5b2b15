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
  const V zero = L::set(0), least = L::set(kLeastLengthSquare);
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

    // The links from e on, whose numbers are at these addresses, in the lanes of `which`.
    const auto add = [&](int e, typename L::M which, const double* lower_at, const double* upper_at,
                         const double* stiffness_at) ASTERISM_INLINED {
      V d[kMost], square = zero;
      for (int c = 0; c < dim; ++c) {
        d[c] = from[c] - L::load(points[c] + j + e);
        square = L::fma(d[c], d[c], square);
      }
      shortest = L::min(square, shortest);
      const V inverse = L::inverse_sqrt(L::max(square, least));
      const V r = square * inverse;
      V stretch = r - L::load(lower_at);
      if (!kHooke) stretch = L::min(stretch, zero) + L::max(r - L::load(upper_at), zero);
      const V k = L::select(L::both(which, L::at_most(least, square)), L::load(stiffness_at), zero);
      const V tension = k * stretch;
      energy = L::fma(tension, stretch, energy);
      if (!kWithForces) return;
      const V weight = tension * inverse;
      energy = L::fma(weight, zero, energy);
      for (int c = 0; c < dim; ++c) {
        double* const at = forces[c] + j + e;
        const V force = weight * d[c];
        sum[c] = sum[c] + force;
        L::store(at, L::load(at) - force);
      }
    };
    const auto all = L::mask((1U << kLanes) - 1);
    int e = 0;
    for (; e + kLanes <= length; e += kLanes) add(e, all, lower + e, upper + e, stiffness + e);
    if (e < length) {
      const auto rest = L::mask((1U << (length - e)) - 1);
      if (first + e + kLanes <= links.count) {  // what is beyond the row belongs to the next links
        add(e, rest, lower + e, upper + e, stiffness + e);
      } else {
        double numbers[3][kLanes] = {};
        for (int w = 0; e + w < length; ++w) {
          numbers[0][w] = lower[e + w];
          numbers[1][w] = upper[e + w];
          numbers[2][w] = stiffness[e + w];
        }
        add(e, rest, numbers[0], numbers[1], numbers[2]);
      }
    }
    for (int c = 0; kWithForces && c < dim; ++c) forces[c][i] += total<L>(sum[c]);

    if (L::bits(L::less(shortest, least)) == 0) continue;
    for (e = 0; e < length; ++e) {
      double square = 0;
      for (int c = 0; c < dim; ++c) {
        const double offset = points[c][i] - points[c][j + e];
        square += offset * offset;
      }
      if (!(square >= kLeastLengthSquare)) links.left_out(links.context, first + e);
    }
  }
  return total<L>(energy);
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
