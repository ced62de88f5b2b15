#include "straightforward_structure.hpp"

#include <algorithm>
#include <cstddef>
#include <limits>

namespace asterism::bench {

void StraightforwardStar::line(const float* f, int count, int stride, const AxisCost& cost, float* result,
                               int* place) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  // weight (p - q - offset)^2 = a (q - p)^2 + b (q - p) + c
  const auto a = static_cast<float>(cost.weight);
  const auto b = static_cast<float>(2 * cost.weight * cost.offset);
  const auto c = static_cast<float>(cost.weight * cost.offset * cost.offset);
  float* const begin = begin_.data();
  int* const site = site_.data();
  const auto crossing = [&](int p, int q) {
    const auto distance = static_cast<float>(q - p);
    return (f[q * stride] - f[p * stride] - b * distance + a * static_cast<float>(q * q - p * p)) /
           (2 * a * distance);
  };
  int last = 0;
  site[0] = 0;
  begin[0] = -kInfinity;
  begin[1] = kInfinity;
  for (int q = 1; q < count; ++q) {
    float from = crossing(site[last], q);
    while (from <= begin[last]) from = crossing(site[--last], q);
    site[++last] = q;
    begin[last] = from;
    begin[last + 1] = kInfinity;
  }
  last = 0;
  for (int q = 0; q < count; ++q) {
    while (begin[last + 1] < static_cast<float>(q)) ++last;
    const auto d = static_cast<float>(q - site[last]);
    result[q * stride] = a * d * d + b * d + c + f[site[last] * stride];
    place[q * stride] = site[last];
  }
}

void StraightforwardStar::transform(const float* f, int width, int height, const DisplacementCost& cost,
                                    float* result, int* place_x, int* place_y) {
  begin_.resize(static_cast<std::size_t>(std::max(width, height) + 1));
  site_.resize(begin_.size());
  between_.resize(static_cast<std::size_t>(width * height));
  for (int y = 0; y < height; ++y) {
    line(f + y * width, width, 1, cost.x, between_.data() + y * width, place_x + y * width);
  }
  for (int x = 0; x < width; ++x) {
    line(between_.data() + x, height, width, cost.y, result + x, place_y + x);
  }
}

void StraightforwardStar::solve(std::span<const Joint> joints, std::span<const MapView<const float>> maps,
                                PartPlacement& best) {
  const int width = maps[0].width, height = maps[0].height;
  const auto pixels = static_cast<std::size_t>(width * height);
  sum_.assign(maps[0].data, maps[0].data + pixels);
  message_.resize(pixels);
  place_x_.resize(joints.size());
  place_y_.resize(joints.size());
  for (std::size_t k = 0; k < joints.size(); ++k) {
    place_x_[k].resize(pixels);
    place_y_[k].resize(pixels);
    transform(maps[static_cast<std::size_t>(joints[k].child)].data, width, height, joints[k].cost,
              message_.data(), place_x_[k].data(), place_y_[k].data());
    for (std::size_t i = 0; i < pixels; ++i) sum_[i] += message_[i];
  }
  const auto least = std::min_element(sum_.begin(), sum_.end());
  const auto root = static_cast<int>(least - sum_.begin());
  best.positions.resize(2, static_cast<Eigen::Index>(maps.size()));
  best.positions.col(0) << root % width, root / width;
  best.energy = static_cast<double>(*least);
  for (std::size_t k = 0; k < joints.size(); ++k) {
    const int y = place_y_[k][static_cast<std::size_t>(root)];
    const int x = place_x_[k][static_cast<std::size_t>(y * width + root % width)];
    best.positions.col(joints[k].child) << x, y;
  }
}

}  // namespace asterism::bench
