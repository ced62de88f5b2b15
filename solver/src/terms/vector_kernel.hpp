#pragma once

// Vectors and a symmetric matrix by one instruction set's vectors. No standard library, see batch_lanes.hpp.
#include <asterism/solver/linear/vector_kernels.hpp>

#include "../batch_lanes.hpp"
#include "kernels.hpp"

namespace asterism::lanes_v0_1 {
namespace {

// Visits as many columns at a time as accumulators fit in registers.
template <typename Visit>
ASTERISM_INLINE void for_each_group(int count, Visit&& visit) {
  int c = 0;
  for (; c + 4 <= count; c += 4) visit.template operator()<4>(c);
  for (; c < count; ++c) visit.template operator()<1>(c);
}

double run_with_these_instructions(const DescentPair& at) {
  const auto rest = lanes_between<L>(0, at.columns.size % L::kLanes);
  const int whole = at.columns.size - at.columns.size % L::kLanes;
  L::V of_change = L::set(0);
  const auto take = [&](int i, const auto& load) ASTERISM_INLINED {
    const L::V change = load(at.descent_before + i) - load(at.descent + i);
    L::store(at.step_column + i, L::set(at.step) * load(at.direction + i));
    L::store(at.change_column + i, change);
    of_change = L::fma(change, load(at.gradient_before + i), of_change);
  };
  const auto load_all = [](const double* from) ASTERISM_INLINED { return L::load(from); };
  const auto load_rest = [&](const double* from) ASTERISM_INLINED { return L::load(from, rest); };
  if (at.step_column != nullptr) {
    for (int i = 0; i < whole; i += L::kLanes) take(i, load_all);
    if (whole < at.columns.size) take(whole, load_rest);
  }
  for_each_group(at.columns.count, [&]<int kCount>(int first) ASTERISM_INLINED {
    const double* const columns = at.columns.data + first * at.columns.stride;
    L::V sums[kCount];
    for (L::V& sum : sums) sum = L::set(0);
    const auto take_in = [&](int i, L::V gradient) ASTERISM_INLINED {
      for (int c = 0; c < kCount; ++c)
        sums[c] = L::fma(L::load(columns + c * at.columns.stride + i), gradient, sums[c]);
    };
    for (int i = 0; i < whole; i += L::kLanes) take_in(i, L::load(at.gradient + i));
    if (whole < at.columns.size) take_in(whole, L::load(at.gradient + whole, rest));
    for (int c = 0; c < kCount; ++c) at.products[first + c] = L::sum(sums[c]);
  });
  return L::sum(of_change);
}

double run_with_these_instructions(const ColumnSum& at) {
  const auto rest = lanes_between<L>(0, at.columns.size % L::kLanes);
  const int whole = at.columns.size - at.columns.size % L::kLanes;
  L::V of_gradient = L::set(0);
  const auto sum_at = [&](int i, L::V first, L::V gradient) ASTERISM_INLINED {
    L::V even = L::set(at.scale) * first, odd = L::set(0);
    for (int c = 0; c + 1 < at.columns.count; c += 2) {
      const double* const column = at.columns.data + c * at.columns.stride + i;
      even = L::fma(L::set(at.weights[c]), L::load(column), even);
      odd = L::fma(L::set(at.weights[c + 1]), L::load(column + at.columns.stride), odd);
    }
    const L::V sum = even + odd;
    of_gradient = L::fma(sum, gradient, of_gradient);
    return sum;
  };
  for (int i = 0; i < whole; i += L::kLanes)
    L::store(at.sum + i, sum_at(i, L::load(at.first + i), L::load(at.gradient + i)));
  if (whole < at.columns.size)
    L::store(at.sum + whole,
             sum_at(whole, L::load(at.first + whole, rest), L::load(at.gradient + whole, rest)), rest);
  return L::sum(of_gradient);
}

// On the lower triangle, and what stands above it in a column's first vector.
bool run_with_these_instructions(const MatrixInverse& at) {
  const auto first = [](int j) { return j - j % L::kLanes; };
  double pivots[aligned_rows(kMostInverted)];  // the column of the pivot
  for (int p = 0; p < at.n; ++p) {
    double* const column = at.matrix + p * at.stride;
    for (int i = first(p); i < at.n; i += L::kLanes) L::store(pivots + i, L::load(column + i));
    for (int j = 0; j < p; ++j) pivots[j] = at.matrix[j * at.stride + p];
    const double pivot = pivots[p];
    if (!(pivot > at.rounding * at.diagonal[p])) return false;
    const double inverse = 1 / pivot;
    for (int j = 0; j < at.n; ++j) {
      double* const to = at.matrix + j * at.stride;
      const L::V factor = L::set(pivots[j] * inverse);
      for (int i = first(j); i < at.n; i += L::kLanes)
        L::store(to + i, L::fnma(factor, L::load(pivots + i), L::load(to + i)));
      if (j < p) to[p] = pivots[j] * inverse;
    }
    for (int i = first(p); i < at.n; i += L::kLanes)
      L::store(column + i, L::load(pivots + i) * L::set(inverse));
    column[p] = -inverse;
  }
  for (int j = 0; j < at.n; ++j) {
    double* const column = at.matrix + j * at.stride;
    for (int i = first(j); i < at.n; i += L::kLanes) L::store(column + i, L::set(0) - L::load(column + i));
    for (int i = 0; i < j; ++i) column[i] = at.matrix[i * at.stride + j];
  }
  return true;
}

// The rows of kVectors vectors from row i on, which are the nodes'.
template <int kDim, int kVectors>
ASTERISM_INLINE void subtract_rows(const PointsLessProduct& at, int i) {
  L::V sums[kDim][kVectors];
  for (auto& of_coordinate : sums) {
    for (L::V& sum : of_coordinate) sum = L::set(0);
  }
  const double* column = at.matrix + i;
  const double* factor = at.factor;
  for (int j = 0; j < at.n; ++j, column += at.stride, factor += kDim) {
    for (int c = 0; c < kDim; ++c) {
      for (int v = 0; v < kVectors; ++v)
        sums[c][v] = L::fma(L::set(factor[c]), L::load(column + v * L::kLanes), sums[c][v]);
    }
  }
  if constexpr (kDim == 2) {
    const auto take_from = [&](double* to, std::ptrdiff_t left, L::V sum) ASTERISM_INLINED {
      if (left >= L::kLanes) return L::store(to, L::load(to) - sum);
      const auto which = lanes_between<L>(0, left);
      L::store(to, L::load(to, which) - sum, which);
    };
    for (int v = 0; v < kVectors; ++v) {
      const std::ptrdiff_t first = kDim * (i + v * L::kLanes), left = kDim * at.n - first;
      take_from(at.points + first, left, L::low_pairs(sums[0][v], sums[1][v]));
      take_from(at.points + first + L::kLanes, left - L::kLanes, L::high_pairs(sums[0][v], sums[1][v]));
    }
    return;
  }
  double rows[kDim][kVectors * L::kLanes];
  for (int c = 0; c < kDim; ++c) {
    for (int v = 0; v < kVectors; ++v) L::store(rows[c] + v * L::kLanes, sums[c][v]);
  }
  const int last = i + kVectors * L::kLanes < at.n ? kVectors * L::kLanes : at.n - i;
  double* const points = at.points + kDim * i;
  for (int r = 0; r < last; ++r) {
    for (int c = 0; c < kDim; ++c) points[kDim * r + c] -= rows[c][r];
  }
}

template <int kDim>
void subtract_in(const PointsLessProduct& at) {
  constexpr int kLanes = DoubleLanes::kLanes;
  int i = 0;
  for (; i + kLanes < at.n; i += 2 * kLanes) subtract_rows<kDim, 2>(at, i);
  if (i < at.n) subtract_rows<kDim, 1>(at, i);
}

void run_with_these_instructions(const PointsLessProduct& product) {
  if (product.dim == 1) return subtract_in<1>(product);
  product.dim == 2 ? subtract_in<2>(product) : subtract_in<3>(product);
}

}  // namespace
}  // namespace asterism::lanes_v0_1
