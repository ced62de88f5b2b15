#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/features/slic.hpp>
#include <cstdint>
#include <limits>
#include <utility>

#include "../concept/part_geometry.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// l, a, b, x, y: the paper's C_k.
using Centre = Eigen::Array<float, 5, 1>;

// Number of seeds along a side of the image.
int seeds(int pixels, int side) { return std::max(1, (pixels + side / 2) / side); }

// floor(value * numerator / denominator) in 64 bits: for long images the product of two lengths exceeds int.
int scaled(int value, int numerator, int denominator) {
  return static_cast<int>(std::int64_t{value} * numerator / denominator);
}

// Splits labels into connected pieces and numbers them from 0. A small piece joins the piece to the left of
// its first pixel, or above it, which already has its number.
int join_small_pieces(std::vector<int>& labels, int cols, std::size_t least) {
  const std::vector<int> before = std::exchange(labels, std::vector<int>(labels.size(), -1));
  const int count = static_cast<int>(before.size());
  const auto label = [&](int pixel) -> int& { return labels[static_cast<std::size_t>(pixel)]; };
  std::vector<int> piece;
  int pieces = 0;
  for (int first = 0; first < count; ++first) {
    if (label(first) >= 0) continue;
    piece.assign(1, first);
    label(first) = pieces;
    for (std::size_t i = 0; i < piece.size(); ++i) {
      const int pixel = piece[i], x = pixel % cols;
      const auto enter = [&](int next) {
        if (label(next) >= 0 ||
            before[static_cast<std::size_t>(next)] != before[static_cast<std::size_t>(pixel)])
          return;
        label(next) = pieces;
        piece.push_back(next);
      };
      if (x > 0) enter(pixel - 1);
      if (x + 1 < cols) enter(pixel + 1);
      if (pixel >= cols) enter(pixel - cols);
      if (pixel + cols < count) enter(pixel + cols);
    }
    if (piece.size() >= least || first == 0) {
      ++pieces;
      continue;
    }
    const int neighbour = label(first % cols > 0 ? first - 1 : first - cols);
    for (const int pixel : piece) label(pixel) = neighbour;
  }
  return pieces;
}

}  // namespace

SuperpixelMap slic(const Eigen::ArrayX3f& colors, int cols, const SlicOptions& options) {
  const int side = options.side;
  check_options("SlicOptions", options);
  require(cols > 0 && colors.rows() > 0 && colors.rows() % cols == 0, "slic: the pixels must be whole rows");
  require(colors.rows() <= std::numeric_limits<int>::max() / 2, "slic: more than 2^30 pixels");
  const int count = static_cast<int>(colors.rows()), rows = count / cols;
  const int across = seeds(cols, side), down = seeds(rows, side);

  SuperpixelMap result{.cols = cols, .rows = rows, .labels = {}, .areas = {}, .colors = {}};
  result.labels.resize(static_cast<std::size_t>(count));
  int* const label = result.labels.data();
  // Initial labels: the cells of the grid. A pixel that no centre reaches keeps its own.
  std::vector<Centre> centres(static_cast<std::size_t>(across * down));
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < cols; ++x)
      label[y * cols + x] = scaled(y, down, rows) * across + scaled(x, across, cols);
  for (int k = 0; k < across * down; ++k) {
    const int x = scaled(2 * (k % across) + 1, cols, 2 * across),
              y = scaled(2 * (k / across) + 1, rows, 2 * down);
    centres[static_cast<std::size_t>(k)] << colors.row(y * cols + x).transpose(), static_cast<float>(x),
        static_cast<float>(y);
  }

  // D^2 = d_c^2 + (m / S)^2 d_s^2 (Eq. 3).
  const float *const l = colors.col(0).data(), *const a = colors.col(1).data(),
                     *const b = colors.col(2).data();
  const auto reach = static_cast<float>(side);
  const float weight = static_cast<float>(options.compactness * options.compactness) / (reach * reach);
  Eigen::ArrayXf distances(count);
  float* const nearest = distances.data();
  Eigen::Array<double, 6, Eigen::Dynamic> sums(6, across * down);
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    distances.setConstant(std::numeric_limits<float>::max());
    for (int k = 0; k < across * down; ++k) {
      const Centre& centre = centres[static_cast<std::size_t>(k)];
      const float cl = centre(0), ca = centre(1), cb = centre(2), cx = centre(3), cy = centre(4);
      const int left = std::max(0, static_cast<int>(std::ceil(cx - reach))),
                right = std::min(cols - 1, static_cast<int>(std::floor(cx + reach))),
                top = std::max(0, static_cast<int>(std::ceil(cy - reach))),
                bottom = std::min(rows - 1, static_cast<int>(std::floor(cy + reach)));
      for (int y = top; y <= bottom; ++y) {
        const float dy = static_cast<float>(y) - cy;
        for (int x = left; x <= right; ++x) {
          const int i = y * cols + x;
          const float dl = l[i] - cl, da = a[i] - ca, db = b[i] - cb, dx = static_cast<float>(x) - cx;
          const float distance = dl * dl + da * da + db * db + weight * (dx * dx + dy * dy);
          const bool nearer = distance < nearest[i];
          nearest[i] = nearer ? distance : nearest[i];
          label[i] = nearer ? k : label[i];
        }
      }
    }
    sums.setZero();
    for (int y = 0, i = 0; y < rows; ++y)
      for (int x = 0; x < cols; ++x, ++i) {
        double* const sum = sums.col(label[i]).data();
        sum[0] += l[i];
        sum[1] += a[i];
        sum[2] += b[i];
        sum[3] += x;
        sum[4] += y;
        sum[5] += 1;
      }
    for (int k = 0; k < across * down; ++k)
      if (sums(5, k) > 0)
        centres[static_cast<std::size_t>(k)] = (sums.col(k).head<5>() / sums(5, k)).cast<float>();
  }

  const int pieces = join_small_pieces(result.labels, cols, static_cast<std::size_t>(side * side / 4));
  result.areas.setZero(pieces);
  Eigen::ArrayX3d means = Eigen::ArrayX3d::Zero(pieces, 3);
  for (int i = 0; i < count; ++i) {
    const int piece = result.labels[static_cast<std::size_t>(i)];
    result.areas(piece) += 1;
    means.row(piece) += colors.row(i).cast<double>();
  }
  result.colors = (means.colwise() / result.areas.cast<double>()).cast<float>();
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
