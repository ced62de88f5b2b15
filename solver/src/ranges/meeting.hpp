#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "range_energy.hpp"

namespace asterism::ranges {

template <int D>
struct Box {
  Vector<D> centre, half;
};

/// Where D ranges meet: at two places, mirror images in the plane (line) of their beacons, or at none.
template <int D>
struct Meeting {
  /// Whether the beacons are clearly apart, and not on a line, so that the places are known.
  bool is_clear = false;
  int places = 0;
  Vector<D> place[2];  ///< the two, or the one at which the ranges almost meet
  int boxes = 0;
  Box<D> box[2];  ///< contain all places where the D are inliers
};

/// In coordinates about the first beacon, along those towards the others, places are linear functions of the
/// squared distances, and so the square of the last coordinate is a quadratic one. Where beacons are at one
/// place, or on one line in space, distances do not tell places along it.
template <int D>
Meeting<D> meeting_of(const RangeEnergy<D>& energy, const int (&set)[D]) {
  double square[D], mean[D], spread[D];  // of the range, and of an inlier's distance
  constexpr double kNone = std::numeric_limits<double>::infinity();
  Vector<D> low = constant<D>(-kNone), high = constant<D>(kNone);
  for (int j = 0; j < D; ++j) {
    const int i = set[j];
    const double r = energy.range(i), limit = energy.limit(i);
    const double most = r + limit, least = std::max(0.0, r - limit);
    square[j] = r * r;
    mean[j] = 0.5 * (most * most + least * least);
    spread[j] = 0.5 * (most - least) * (most + least);
    for (int k = 0; k < D; ++k) {
      low[k] = std::max(low[k], energy.coordinate(i, k) - most);
      high[k] = std::min(high[k], energy.coordinate(i, k) + most);
    }
  }
  Meeting<D> result;
  const auto add_box = [&](const Vector<D>& middle, const Vector<D>& reach, double rounding) {
    Box<D>& box = result.box[result.boxes];
    for (int k = 0; k < D; ++k) {
      const double from = std::max(low[k], middle[k] - reach[k]),
                   to = std::min(high[k], middle[k] + reach[k]);
      if (from > to + 2 * rounding) return;
      box.centre[k] = 0.5 * (from + to);
      box.half[k] = 0.5 * (to - from) + rounding;
    }
    ++result.boxes;
  };
  // x = origin + height axis_0 + sum_{j > 0} at_j axis_j, where at_j = constant_j + sum_k by_jk square_k
  const Vector<D> origin = energy.beacon(set[0]);
  Vector<D> axis[D], place = origin, middle = origin, half = constant<D>(0);
  double by[D][D] = {}, constants[D] = {}, slope[D] = {1};
  double height = square[0], most = mean[0], less = 0, change = 1e-11 * energy.extent() * energy.extent();
  // Coordinates are differences of numbers of these sizes, of which this share is more than what they may be
  // wrong by.
  constexpr double kRounding = 1e-13;
  double sizes[D] = {}, rounding = 1e-9 * energy.extent();
  bool is_clear = true;  // where the ranges meet
  for (int j = 1; j < D; ++j) {
    axis[j] = energy.from_beacon(energy.beacon(set[j]), set[0]);
    constants[j] = dot(axis[j], axis[j]);
    sizes[j] = constants[j];
    for (const int k : {0, j}) sizes[j] += mean[k] + spread[k];
    by[j][0] = 1;
    by[j][j] = -1;
    for (int l = 1; l < j; ++l) {
      const double along = dot(axis[j], axis[l]);
      constants[j] -= 2 * along * constants[l];
      sizes[j] += 2 * std::abs(along) * sizes[l];
      for (int k = 0; k < D; ++k) {
        by[j][k] -= 2 * along * by[l][k];
        axis[j][k] -= along * axis[l][k];
      }
    }
    const double length = norm(axis[j]);
    if (length < 1e-4 * energy.extent()) {
      add_box(origin, constant<D>(kNone), rounding);
      return result;
    }
    is_clear = is_clear && length > 1e-2 * energy.extent();
    sizes[j] /= 2 * length;
    const double wrong = kRounding * sizes[j];
    double at = constants[j] /= 2 * length, of_mean = at, reach = wrong;
    for (int k = 0; k < D; ++k) {
      axis[j][k] /= length;
      by[j][k] /= 2 * length;
      at += by[j][k] * square[k];
      of_mean += by[j][k] * mean[k];
      reach += std::abs(by[j][k]) * spread[k];
    }
    height -= at * at;
    most -= of_mean * of_mean;
    less += reach * reach;
    change += 2 * std::abs(of_mean) * wrong;
    rounding += wrong;
    for (int k = 0; k < D; ++k) {
      slope[k] -= 2 * of_mean * by[j][k];
      place[k] += at * axis[j][k];
      middle[k] += of_mean * axis[j][k];
      half[k] += reach * std::abs(axis[j][k]);
    }
  }
  if constexpr (D == 2)
    axis[0] = {{-axis[1][1], axis[1][0]}};
  else
    axis[0] = {{axis[1][1] * axis[2][2] - axis[1][2] * axis[2][1],
                axis[1][2] * axis[2][0] - axis[1][0] * axis[2][2],
                axis[1][0] * axis[2][1] - axis[1][1] * axis[2][0]}};
  result.is_clear = is_clear;
  for (const double side : {-1.0, 1.0}) {
    Vector<D>& x = result.place[result.places++];
    x = place;
    for (int k = 0; k < D; ++k) x[k] += side * std::sqrt(std::max(0.0, height)) * axis[0][k];
    if (height <= 0) break;
  }
  for (int k = 0; k < D; ++k) change += std::abs(slope[k]) * spread[k];
  if (most + change >= 0) {
    const double top = std::sqrt(most + change), bottom = std::sqrt(std::max(0.0, most - change - less));
    const double along = bottom > 0 ? 0.5 * (top + bottom) : 0;
    for (int k = 0; k < D; ++k) half[k] += (top - along) * std::abs(axis[0][k]);
    for (const double side : {along, -along}) {
      Vector<D> of_part = middle;
      for (int k = 0; k < D; ++k) of_part[k] += side * axis[0][k];
      add_box(of_part, half, rounding);
      if (along == 0) break;
    }
  }
  return result;
}

}  // namespace asterism::ranges
