#pragma once

// Newton's matrix by one instruction set's vectors. No standard library, see batch_lanes.hpp.
#include "../batch_lanes.hpp"
#include "kernels.hpp"

namespace asterism::lanes_v0_1 {
namespace {

using L = DoubleLanes;
using V = L::V;

// Columns kDim j, ... of the Hessian, the rows of the nodes from i on: minus a spring's curvature in each
// lane.
template <int kDim>
ASTERISM_INLINE void couple(const SpringHessian& springs, std::ptrdiff_t i, std::ptrdiff_t j,
                            const V (&curvature)[kDim * (kDim + 1) / 2]) {
  const V zero = L::set(0);
  for (int column = 0; column < kDim; ++column) {
    double* const to = springs.hessian + (kDim * j + column) * springs.rows + kDim * i;
    V entries[kDim];
    for (int row = 0; row < kDim; ++row) {
      const int low = row < column ? row : column, high = row < column ? column : row;
      entries[row] = zero - curvature[high * (high + 1) / 2 + low];
    }
    if constexpr (kDim == 2) {
      L::store(to, L::low_pairs(entries[0], entries[1]));
      L::store(to + L::kLanes, L::high_pairs(entries[0], entries[1]));
    } else {
      double lanes[kDim][L::kLanes];
      for (int row = 0; row < kDim; ++row) L::store(lanes[row], entries[row]);
      for (int lane = 0; lane < L::kLanes; ++lane) {
        for (int row = 0; row < kDim; ++row) to[kDim * lane + row] = lanes[row][lane];
      }
    }
  }
}

template <int kDim>
double differentiate_in(const SpringHessian& springs) {
  constexpr int kEntries = kDim * (kDim + 1) / 2;
  const V zero = L::set(0), least = L::set(kLeastLengthSquare);
  const V least_across = L::set(springs.clamp ? 0 : -__builtin_inf());
  V energy = zero, short_ones = zero;  // the stiffness of springs that are too short
  for (std::ptrdiff_t i = 0; i < springs.nodes; i += L::kLanes) {
    V points[kDim], gradient[kDim], own[kEntries] = {};
    for (int c = 0; c < kDim; ++c) points[c] = L::load(springs.points + c * springs.stride + i);
    if (springs.anchors != nullptr) {
      const V k = L::load(springs.anchor_stiffness + i);
      for (int c = 0; c < kDim; ++c) {
        const V d = points[c] - L::load(springs.anchors + c * springs.stride + i);
        gradient[c] = k * d;
        energy = L::fma(gradient[c] + gradient[c], d, energy);
        own[c * (c + 3) / 2] = k;
      }
    } else {
      for (int c = 0; c < kDim; ++c) gradient[c] = L::load(springs.gradient + c * springs.stride + i);
      for (int e = 0; e < kEntries; ++e) own[e] = L::load(springs.own + e * springs.stride + i);
    }
    // Each spring is met from both of its ends, so that nothing has to be added across lanes.
    for (std::ptrdiff_t j = 0; j < springs.nodes; ++j) {
      const V k = L::load(springs.stiffness + j * springs.stride + i);
      V d[kDim], square = zero;
      for (int c = 0; c < kDim; ++c) {
        d[c] = points[c] - L::set(springs.points[c * springs.stride + j]);
        square = L::fma(d[c], d[c], square);
      }
      short_ones = L::select(L::less(square, least), L::max(short_ones, k), short_ones);
      square = L::max(square, least);
      const V inverse = L::inverse_sqrt(square);
      // Where springs are nearly at rest, the rounding of a length is what limits Newton's steps.
      const V stretch = L::sqrt(square, inverse) - L::load(springs.rest_length + j * springs.stride + i);
      const V tension = k * stretch, force = tension * inverse;
      energy = L::fma(tension, stretch, energy);
      const V across = L::max(least_across, force), difference = k - across;
      V curvature[kEntries];
      for (int c = 0, e = 0; c < kDim; ++c) {
        gradient[c] = L::fma(force, d[c], gradient[c]);
        d[c] = d[c] * inverse;
        const V bend = difference * d[c];
        for (int r = 0; r < c; ++r) curvature[e++] = bend * d[r];
        curvature[e++] = L::fma(bend, d[c], across);
      }
      for (int e = 0; e < kEntries; ++e) own[e] = own[e] + curvature[e];
      if (j < i + L::kLanes) couple<kDim>(springs, i, j, curvature);
    }
    for (int c = 0; c < kDim; ++c) {
      energy = L::fma(gradient[c], zero, energy);
      L::store(springs.gradient + c * springs.stride + i, gradient[c]);
    }
    for (int e = 0; e < kEntries; ++e) L::store(springs.own + e * springs.stride + i, own[e]);
  }
  for (std::ptrdiff_t j = 0; j < springs.nodes; ++j) {
    double* const block = springs.hessian + kDim * j * (springs.rows + 1);
    for (int column = 0; column < kDim; ++column) {
      for (int row = column; row < kDim; ++row)
        block[column * springs.rows + row] = springs.own[(row * (row + 1) / 2 + column) * springs.stride + j];
    }
  }
  return L::bits(L::less(zero, short_ones)) != 0 ? __builtin_inf() : L::sum(energy) / 4;
}

double run_with_these_instructions(const SpringHessian& springs) {
  return springs.dim == 2 ? differentiate_in<2>(springs) : differentiate_in<3>(springs);
}

// Gauss's elimination without pivoting, as NewtonMatrix has it, of two columns at a time. Vectors begin at
// multiples of their size, so that no load spans two stores; what they have above the diagonal is not read.
class Elimination {
  using Index = std::ptrdiff_t;

 public:
  explicit Elimination(const NewtonEquations& equations) : at_(equations) {}

  Pivots run() {
    int k = 0;
    for (; k + 1 < at_.size; k += 2) eliminate_pair(k);
    if (k < at_.size) at_.inverse_pivots[k] = 1 / repair(column(k)[k], k);
    return pivots_;
  }

 private:
  // The columns of two pivots, and the numbers that take the first from the second, and each from a column of
  // which 1 is in the pivot's row.
  struct Pair {
    double *p, *q;
    double ratio, inverse_p, inverse_q;
  };

  double* column(Index k) const { return at_.matrix + k * at_.rows; }
  double rounding(int k) const { return at_.rounding[k / at_.dim]; }

  // See NewtonMatrix::repair.
  double repair(double& pivot, int k) {
    const double rounding = this->rounding(k);
    if (pivot > rounding) [[likely]]
      return pivot;
    if (pivot < most_negative_ * rounding) {
      most_negative_ = pivot / rounding;
      pivots_.negative = k;
    }
    pivots_.repaired = true;
    if (pivot < -rounding) return pivot = -pivot;
    return pivot = rounding > 0 ? at_.flat * rounding : 1;
  }

  // Pivots k and k + 1; the reciprocal of the second is the first over the determinant of both, which is
  // divided by while the first is.
  void eliminate_pair(int k) {
    double *const p = column(k), *const q = column(k + 1);
    const double below = p[k + 1];
    const double determinant = p[k] * q[k + 1] - below * below, inverse_determinant = 1 / determinant;
    const double first = repair(p[k], k), inverse = 1 / first, ratio = below * inverse;
    double second = q[k + 1] - ratio * below;
    const double size = determinant < 0 ? -determinant : determinant;
    const bool is_plain =
        !pivots_.repaired && second > rounding(k + 1) && size > 0x1p-1000 && size < 0x1p1000;
    const double second_inverse = is_plain ? first * inverse_determinant : 1 / repair(second, k + 1);
    at_.inverse_pivots[k] = inverse;
    at_.inverse_pivots[k + 1] = second_inverse;
    at_.right[k + 1] -= ratio * at_.right[k];
    const Pair pair{p, q, ratio, inverse, second_inverse};
    switch ((at_.size + L::kLanes - 1) / L::kLanes - (k + 2) / L::kLanes) {
      case 0:
        break;
      case 1:
        subtract<1>(pair, k + 2);
        break;
      case 2:
        subtract<2>(pair, k + 2);
        break;
      case 3:
        subtract<3>(pair, k + 2);
        break;
      case 4:
        subtract<4>(pair, k + 2);
        break;
      default:
        subtract_many(pair, k + 2);
    }
    q[k + 1] = second;
  }

  // Takes a pair from the columns from c on, of which as many vectors are below the pivots.
  template <int kVectors>
  void subtract(const Pair& pair, Index c) const {
    const Index from = c / L::kLanes * L::kLanes;
    V p[kVectors], q[kVectors];
    double of_p[kVectors * L::kLanes], of_q[kVectors * L::kLanes];
    for (int v = 0; v < kVectors; ++v) {
      p[v] = L::load(pair.p + from + v * L::kLanes);
      q[v] = L::fnma(L::set(pair.ratio), p[v], L::load(pair.q + from + v * L::kLanes));
      L::store(pair.q + from + v * L::kLanes, q[v]);
      L::store(of_p + v * L::kLanes, p[v] * L::set(pair.inverse_p));
      L::store(of_q + v * L::kLanes, q[v] * L::set(pair.inverse_q));
    }
    const auto reduce = [&]<int kFirst>(Vectors<kFirst>, double* to, double factor_p, double factor_q)
                            ASTERISM_INLINED {
                              const V by_p = L::set(factor_p), by_q = L::set(factor_q);
                              for (int v = kFirst; v < kVectors; ++v) {
                                const V rest = L::fnma(by_p, p[v], L::load(to + from + v * L::kLanes));
                                L::store(to + from + v * L::kLanes, L::fnma(by_q, q[v], rest));
                              }
                            };
    const auto reduce_from = [&]<int kFirst>(Vectors<kFirst> first) ASTERISM_INLINED {
      if constexpr (kFirst < kVectors) {
        const Index end = from + (kFirst + 1) * L::kLanes, last = end < at_.size ? end : at_.size;
        for (Index i = kFirst == 0 ? c : end - L::kLanes; i < last; ++i)
          reduce(first, column(i), of_p[i - from], of_q[i - from]);
      }
    };
    reduce_from(Vectors<0>());
    reduce_from(Vectors<1>());
    reduce_from(Vectors<2>());
    reduce_from(Vectors<3>());
    reduce_right(at_, pair, c, [&](double* right, double factor_p, double factor_q) ASTERISM_INLINED {
      reduce(Vectors<0>(), right, factor_p, factor_q);
    });
  }

  // The same of any number.
  void subtract_many(const Pair& pair, Index c) const {
    const Index from = c / L::kLanes * L::kLanes;
    for (Index i = from; i < at_.size; i += L::kLanes)
      L::store(pair.q + i, L::fnma(L::set(pair.ratio), L::load(pair.p + i), L::load(pair.q + i)));
    const auto reduce = [&](double* to, double factor_p, double factor_q, Index first) ASTERISM_INLINED {
      const V by_p = L::set(factor_p), by_q = L::set(factor_q);
      for (Index i = first; i < at_.size; i += L::kLanes) {
        const V rest = L::fnma(by_p, L::load(pair.p + i), L::load(to + i));
        L::store(to + i, L::fnma(by_q, L::load(pair.q + i), rest));
      }
    };
    for (Index i = c; i < at_.size; ++i)
      reduce(column(i), pair.p[i] * pair.inverse_p, pair.q[i] * pair.inverse_q, i / L::kLanes * L::kLanes);
    reduce_right(at_, pair, c, [&](double* right, double factor_p, double factor_q) ASTERISM_INLINED {
      reduce(right, factor_p, factor_q, from);
    });
  }

  // The same for the right-hand side, which stays as it is above row c.
  template <typename Reduce>
  ASTERISM_INLINE void reduce_right(const NewtonEquations& at, const Pair& pair, Index c, Reduce&& reduce) {
    double* const first = at.right + c / L::kLanes * L::kLanes;
    const V above = L::load(first);
    reduce(at.right, at.right[c - 2] * pair.inverse_p, at.right[c - 1] * pair.inverse_q);
    L::store(first, L::select(lanes_between<L>(0, c % L::kLanes), above, L::load(first)));
  }

  template <int kFirst>
  struct Vectors {};

  const NewtonEquations& at_;
  Pivots pivots_{false, -1};
  double most_negative_ = -1;  // in units of its rounding
};

Pivots run_with_these_instructions(const NewtonEquations& equations) { return Elimination(equations).run(); }

// The substitution.
double run_with_these_instructions(const NewtonStep& at) {
  using Index = std::ptrdiff_t;
  const auto column = [&](Index k) { return at.matrix + k * at.rows; };
  double decrement = 0;
  // As many unknowns at a time as are in a vector: first what those behind add to each, then one by one.
  for (Index first = (at.size - 1) / L::kLanes * L::kLanes, end = at.size; first >= 0;
       end = first, first -= L::kLanes) {
    double values[L::kLanes];
    for (Index k = first; k < end; ++k) {
      V sum = L::set(0);
      for (Index i = first + L::kLanes; i < at.size; i += L::kLanes) {
        const bool is_whole = i + L::kLanes <= at.size;
        const V step =
            is_whole ? L::load(at.step + i) : L::load(at.step + i, lanes_between<L>(0, at.size - i));
        sum = L::fma(L::load(column(k) + i), step, sum);
      }
      decrement += at.right[k] * at.right[k] * at.inverse_pivots[k];
      values[k - first] = at.right[k] - L::sum(sum);
    }
    for (Index k = end; k-- > first;) {
      const double value = at.step[k] = values[k - first] * at.inverse_pivots[k];
      for (Index i = first; i < k; ++i) values[i - first] -= column(i)[k] * value;
    }
  }
  return decrement;
}

}  // namespace
}  // namespace asterism::lanes_v0_1
