#pragma once

// The gradient of springs between all pairs of nodes by one instruction set's vectors. No standard library,
// see batch_lanes.hpp.
#include "../batch_lanes.hpp"
#include "kernels.hpp"

namespace asterism::lanes_v0_1 {
namespace {

// Points whose coordinates are side by side, and a vector for each coordinate: `count` points or as many as a
// vector has lanes, the others are 0.
template <int kDim>
ASTERISM_INLINE void load_points(V (&points)[kDim], const double* from, std::ptrdiff_t count) {
  if constexpr (kDim == 2) {
    const bool is_whole = count >= L::kLanes;
    const V low = is_whole ? L::load(from) : L::load(from, lanes_between<L>(0, 2 * count));
    const V high = is_whole ? L::load(from + L::kLanes)
                            : L::load(from + L::kLanes, lanes_between<L>(0, 2 * count - L::kLanes));
    points[0] = L::evens(low, high);
    points[1] = L::odds(low, high);
  } else {
    double rows[kDim][L::kLanes] = {};
    for (int lane = 0; lane < L::kLanes && lane < count; ++lane) {
      for (int c = 0; c < kDim; ++c) rows[c][lane] = from[kDim * lane + c];
    }
    for (int c = 0; c < kDim; ++c) points[c] = L::load(rows[c]);
  }
}
template <int kDim>
ASTERISM_INLINE void store_points(const V (&points)[kDim], double* to, std::ptrdiff_t count) {
  if constexpr (kDim == 2) {
    const V low = L::low_pairs(points[0], points[1]), high = L::high_pairs(points[0], points[1]);
    if (count >= L::kLanes) {
      L::store(to, low);
      L::store(to + L::kLanes, high);
    } else {
      L::store(to, low, lanes_between<L>(0, 2 * count));
      L::store(to + L::kLanes, high, lanes_between<L>(0, 2 * count - L::kLanes));
    }
  } else {
    double rows[kDim][L::kLanes];
    for (int c = 0; c < kDim; ++c) L::store(rows[c], points[c]);
    for (int lane = 0; lane < L::kLanes && lane < count; ++lane) {
      for (int c = 0; c < kDim; ++c) to[kDim * lane + c] = rows[c][lane];
    }
  }
}

template <int kDim>
ASTERISM_INLINE void load_rows(V (&points)[kDim], const double* rows, std::ptrdiff_t stride) {
  for (int c = 0; c < kDim; ++c) points[c] = L::load(rows + c * stride);
}
template <int kDim>
ASTERISM_INLINE void store_rows(const V (&points)[kDim], double* rows, std::ptrdiff_t stride) {
  for (int c = 0; c < kDim; ++c) L::store(rows + c * stride, points[c]);
}

// Moves the points, and begins their forces with those of the anchors, of which it returns twice the energy.
template <int kDim>
ASTERISM_INLINE V place(const SpringTiles& at) {
  V energy = L::set(0);
  for (std::ptrdiff_t i = 0; i < at.nodes; i += L::kLanes) {
    const std::ptrdiff_t count = at.nodes - i;
    V x[kDim], direction[kDim];
    load_points(x, at.from + kDim * i, count);
    load_points(direction, at.direction + kDim * i, count);
    for (int c = 0; c < kDim; ++c) x[c] = L::fma(L::set(at.step), direction[c], x[c]);
    store_points(x, at.to + kDim * i, count);
    if (count < L::kLanes) {
      V behind[kDim];
      load_rows(behind, at.points + i, at.stride);
      for (int c = 0; c < kDim; ++c) x[c] = L::select(lanes_between<L>(0, count), x[c], behind[c]);
    }
    store_rows(x, at.points + i, at.stride);
    if (at.anchors == nullptr) continue;
    const V k = L::load(at.anchor_stiffness + i);
    V d[kDim], force[kDim];
    load_rows(d, at.anchors + i, at.stride);
    for (int c = 0; c < kDim; ++c) {
      d[c] = x[c] - d[c];
      force[c] = k * d[c];
      energy = L::fma(force[c], d[c], energy);
    }
    store_rows(force, at.forces + i, at.stride);
  }
  return energy;
}

template <int kDim>
EnergyAlong differentiate_in(const SpringTiles& at) {
  V energy = place<kDim>(at), slope = L::set(0);
  V shortest = L::set(__builtin_inf());  // squares of lengths
  // The springs of the next diagonal, between a point x and a point y in each lane.
  const double* springs = at.springs;
  const auto add = [&](const V(&x)[kDim], const V(&y)[kDim], V(&of_x)[kDim], V(&of_y)[kDim])
                       ASTERISM_INLINED {
                         V d[kDim], square = L::set(0);
                         for (int c = 0; c < kDim; ++c) {
                           d[c] = x[c] - y[c];
                           square = L::fma(d[c], d[c], square);
                         }
                         shortest = L::min(square, shortest);
                         const V inverse = L::inverse_sqrt(square);
                         const V stretch = square * inverse - L::load(springs + L::kLanes);
                         const V tension = L::load(springs) * stretch;
                         energy = L::fma(tension, stretch, energy);
                         const V force = tension * inverse;
                         for (int c = 0; c < kDim; ++c) {
                           of_x[c] = L::fma(force, d[c], of_x[c]);
                           of_y[c] = L::fnma(force, d[c], of_y[c]);
                         }
                         springs += 2 * L::kLanes;
                       };
  const auto rotate = [](V(&v)[kDim]) ASTERISM_INLINED {
    for (V& coordinate : v) coordinate = L::rotate(coordinate);
  };
  for (std::ptrdiff_t a = 0; a < at.nodes; a += L::kLanes) {
    V x[kDim], of_x[kDim], y[kDim], of_y[kDim];
    load_rows(x, at.points + a, at.stride);
    load_rows(y, at.points + a, at.stride);
    load_rows(of_x, at.forces + a, at.stride);
    for (V& coordinate : of_y) coordinate = L::set(0);
    for (int s = 1; s <= L::kLanes / 2; ++s) {
      rotate(y);
      rotate(of_y);
      add(x, y, of_x, of_y);
    }
    for (int s = L::kLanes / 2; s < L::kLanes; ++s) rotate(of_y);  // to where they began
    for (int c = 0; c < kDim; ++c) of_x[c] = of_x[c] + of_y[c];
    for (std::ptrdiff_t b = a + L::kLanes; b < at.nodes; b += L::kLanes) {
      load_rows(y, at.points + b, at.stride);
      load_rows(of_y, at.forces + b, at.stride);
      for (int s = 0; s < L::kLanes; ++s) {
        add(x, y, of_x, of_y);
        rotate(y);
        rotate(of_y);
      }
      store_rows(of_y, at.forces + b, at.stride);
    }
    store_points(of_x, at.gradient + kDim * a, at.nodes - a);
    load_points(y, at.direction + kDim * a, at.nodes - a);
    for (int c = 0; c < kDim; ++c) {
      energy = L::fma(of_x[c], L::set(0), energy);
      slope = L::fma(of_x[c], y[c], slope);
    }
  }
  const bool is_short = L::bits(L::less(shortest, L::set(kLeastLengthSquare))) != 0;
  return {is_short ? __builtin_inf() : L::sum(energy) / 2, L::sum(slope)};
}

EnergyAlong run_with_these_instructions(const SpringTiles& springs) {
  return springs.dim == 2 ? differentiate_in<2>(springs) : differentiate_in<3>(springs);
}

}  // namespace
}  // namespace asterism::lanes_v0_1
