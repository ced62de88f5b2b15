#pragma once

// fHOG with scalar votes and without kernels: an earlier version of asterism::Fhog, kept as the oracle of the
// kernels. Its interface and results are those of Fhog.

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/core/hal/hal.hpp>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace asterism::testing {
namespace scalar_fhog {

using Quad = Eigen::Array4f;
using QuadMap = Eigen::Map<Quad>;
using ConstQuadMap = Eigen::Map<const Quad>;

inline constexpr int kSigned = 18, kUnsigned = 9;
// A gradient between -10 and 0 degrees lands in slot 18, which is orientation 0 again: an extra slot is
// cheaper than a test per pixel.
inline constexpr int kSlots = kSigned + 1;
inline constexpr float kMaxPixel = 1e8F;  // keeps block energies far from overflow for every cell size
inline constexpr float kRegulariser = 1e-4F;
inline constexpr int kMaxCells = 1 << 20;  // in a row; keeps all indices within int

// Slope |gy| / |gx| above which direction k + 1 has a larger projection than direction k, k = 0..3. The
// directions are rounded to four decimals as published: exact ones would move a few 8-bit gradients across a
// bin boundary and differ from all other implementations.
inline constexpr std::array<float, 4> kSlopes = {
    (1.0000F - 0.9397F) / 0.3420F, (0.9397F - 0.7660F) / (0.6428F - 0.3420F),
    (0.7660F - 0.5000F) / (0.8660F - 0.6428F), (0.5000F - 0.1736F) / (0.9848F - 0.8660F)};

inline int padded(int n) { return (n + 3) / 4 * 4; }

inline std::size_t index(int i) { return static_cast<std::size_t>(i); }

template <typename Value>
void grow(std::vector<Value>& buffer, int size, const Value& value) {
  if (buffer.size() < index(size)) buffer.resize(index(size), value);
}

// All ones where the sign bit is set.
inline std::int32_t sign_mask(float v) { return std::bit_cast<std::int32_t>(v) >> 31; }

}  // namespace scalar_fhog

class ScalarFhog {
 public:
  static constexpr int kChannels = 31;

  /// cell_size in pixels, >= 1; std::invalid_argument otherwise.
  explicit ScalarFhog(int cell_size = 4);

  int cell_size() const { return cell_size_; }

  /// patch: CV_8UC1 or CV_32FC1 in units of 0..255, at least one cell in each direction, or
  /// std::invalid_argument is thrown. Float values are clamped to +-1e8, so that every finite patch has
  /// finite features. features: kChannels planes of (rows / cell_size) x (cols / cell_size) floats,
  /// row-major, contiguous, overwritten. Allocates only when the patch is larger than any before; one object
  /// is for one thread at a time.
  void compute(const cv::Mat& patch, float* features);

 private:
  void reserve(int cells_x);
  void load_row(const cv::Mat& patch, int y);
  void vote_row(int y, int rows);
  void collect(int interval_row);
  void normalise_blocks(int block_row, int rows);
  void emit_row(int cell_row, float* features, std::ptrdiff_t plane) const;

  int cell_size_;

  // Workspace of the current patch; see fhog.cpp for the layout.
  int cells_x_ = 0;    // cells in a row
  int intervals_ = 0;  // cells_x_ + 1: gaps between neighbouring cell centres, and two half gaps outside
  int stride_ = 0;     // floats of a padded row of cells
  std::vector<Eigen::Array4f> phase_weights_, votes_;
  std::vector<float> pixels_, magnitude_, open_row_, histogram_, energy_, normaliser_;
  std::vector<int> slot_;
};

using namespace scalar_fhog;

inline ScalarFhog::ScalarFhog(int cell_size) : cell_size_(cell_size) {
  if (cell_size < 1)
    throw std::invalid_argument("ScalarFhog: cell_size is " + std::to_string(cell_size) + ", must be >= 1");
}

inline void ScalarFhog::reserve(int cells_x) {
  cells_x_ = cells_x;
  intervals_ = cells_x + 1;
  stride_ = padded(cells_x) + 4;
  const int width = cells_x * cell_size_;
  const Quad zero4 = Quad::Zero();
  grow(phase_weights_, cell_size_, zero4);
  grow(votes_, kSlots * intervals_, zero4);
  grow(pixels_, 3 * (width + 2), 0.0F);
  grow(magnitude_, width, 0.0F);
  grow(slot_, width, 0);
  grow(open_row_, kSigned * stride_, 0.0F);
  grow(histogram_, 2 * kSigned * stride_, 0.0F);
  grow(energy_, 2 * stride_, 0.0F);
  grow(normaliser_, 2 * stride_, 0.0F);
}

inline void ScalarFhog::load_row(const cv::Mat& patch, int y) {
  const int width = cells_x_ * cell_size_;
  float* const row = pixels_.data() + (y % 3) * (width + 2) + 1;
  if (patch.depth() == CV_8U) {
    const std::uint8_t* const source = patch.ptr<std::uint8_t>(y);
    for (int x = 0; x < width; ++x) row[x] = static_cast<float>(source[x]);
    row[width] = static_cast<float>(source[std::min(width, patch.cols - 1)]);
  } else {
    const float* const source = patch.ptr<float>(y);
    const auto clamped = [](float v) { return std::min(std::max(v, -kMaxPixel), kMaxPixel); };
    for (int x = 0; x < width; ++x) row[x] = clamped(source[x]);
    row[width] = clamped(source[std::min(width, patch.cols - 1)]);
  }
  row[-1] = row[0];
}

// Votes of pixel row y; `rows` of the patch are loaded or replicated.
inline void ScalarFhog::vote_row(int y, int rows) {
  const int width = cells_x_ * cell_size_;
  const auto row_at = [&](int i) { return pixels_.data() + (i % 3) * (width + 2) + 1; };
  const float* const here = row_at(y);
  const float* const above = row_at(std::max(y - 1, 0));
  const float* const below = row_at(std::min(y + 1, rows - 1));
  float* __restrict const magnitude = magnitude_.data();
  int* __restrict const slot = slot_.data();

  // Fold into the first quadrant, count the slopes exceeded (k = 0..4: 0, 20, .. 80 degrees), unfold:
  // k, 9 - k, 9 + k, 18 - k in the four quadrants. A half turn adds 9, so signed orientations need no more
  // tests.
  const std::int32_t step = intervals_, half_turn = kUnsigned * step;
  for (int x = 0; x < width; ++x) {
    const float gx = here[x + 1] - here[x - 1], gy = below[x] - above[x];
    const float ax = std::abs(gx), ay = std::abs(gy);
    std::int32_t k = 0;
    for (const float slope : kSlopes) k += ay > ax * slope ? step : 0;
    // If gx = 0, then 80 and 100 degrees tie; the first wins, whatever the sign of gy.
    const std::int32_t down = sign_mask(gy), mirrored = sign_mask(gx + 1e-9F * gy) ^ down;
    slot[x] = ((k ^ mirrored) - mirrored) + (mirrored & half_turn) + (down & half_turn);
    magnitude[x] = gx * gx + gy * gy;
  }
  // std::sqrt may set errno, which keeps compilers from vectorising it.
  cv::hal::sqrt32f(magnitude, magnitude, width);

  // Fraction of the way from the upper to the lower cell centres, the same for all pixels of the row. In x it
  // depends only on the pixel's phase within an interval.
  const int half = cell_size_ / 2;
  const auto fraction = [&](int phase) {
    return (static_cast<float>(half + phase) + 0.5F) / static_cast<float>(cell_size_) - 0.5F;
  };
  const float fy = fraction((y + cell_size_ - half) % cell_size_);
  for (int p = 0; p < cell_size_; ++p) {
    const float fx = fraction(p);
    phase_weights_[index(p)] = {(1 - fx) * (1 - fy), (1 - fx) * fy, fx * (1 - fy), fx * fy};
  }

  // Local copies, because the compiler must assume that the votes overlap the members.
  const int cells_x = cells_x_;
  const auto vote_all = [&](auto cell, const Quad* weights) {
    Quad* votes = votes_.data();
    const auto vote = [&](int x, int phase) { votes[slot[x]] += magnitude[x] * weights[phase]; };
    for (int x = 0; x < half; ++x) vote(x, cell - half + x);
    int x = half;
    for (int i = 1; i < cells_x; ++i, x += cell) {
      ++votes;
      for (int p = 0; p < cell; ++p) vote(x + p, p);
    }
    ++votes;
    for (int p = 0; x < width; ++x, ++p) vote(x, p);
  };
  if (cell_size_ == 4) {  // the usual size: unrolled, weights in registers
    std::array<Quad, 4> weights;
    std::copy_n(phase_weights_.begin(), 4, weights.begin());
    vote_all(std::integral_constant<int, 4>(), weights.data());
  } else {
    vote_all(cell_size_, phase_weights_.data());
  }
}

// Sums the votes of interval row j into the histograms: its upper lanes complete cell row j - 1, its lower
// lanes open cell row j. Leaves the votes zero.
inline void ScalarFhog::collect(int j) {
  const int n = cells_x_;
  // The extra slot is orientation 0.
  for (int i = 0; i < intervals_; ++i) votes_[index(i)] += votes_[index(kSigned * intervals_ + i)];
  float* const histogram = histogram_.data() + (j + 1) % 2 * kSigned * stride_;
  for (int o = 0; o < kSigned; ++o) {
    const float* __restrict const v = votes_[index(o * intervals_)].data();
    float* __restrict const open = open_row_.data() + o * stride_;
    float* __restrict const done = histogram + o * stride_;
    for (int c = 0; c < n; ++c) {
      done[c] = open[c] + (v[4 * c + 2] + v[4 * c + 4]);
      open[c] = v[4 * c + 3] + v[4 * c + 5];
    }
  }
  std::fill_n(votes_.front().data(), 4 * kSlots * intervals_, 0.0F);  // as floats it becomes a memset

  float* const energy = energy_.data() + (j + 1) % 2 * stride_ + 1;
  for (int c = 0; c < n; c += 4) {  // rows are padded
    Quad sum = Quad::Zero();
    for (int o = 0; o < kUnsigned; ++o) {
      const float* const h = histogram + o * stride_ + c;
      sum += (ConstQuadMap(h) + ConstQuadMap(h + kUnsigned * stride_)).square();
    }
    QuadMap(energy + c) = sum;
  }
  energy[-1] = energy[0];
  energy[n] = energy[n - 1];
}

// Normalisers of the blocks between cell rows r - 1 and r.
inline void ScalarFhog::normalise_blocks(int r, int rows) {
  const float* const above = energy_.data() + (std::max(r - 1, 0) % 2) * stride_;
  const float* const below = energy_.data() + (std::min(r, rows - 1) % 2) * stride_;
  float* __restrict const normaliser = normaliser_.data() + r % 2 * stride_;
  for (int b = 0; b < intervals_; ++b) {
    normaliser[b] = above[b] + above[b + 1] + below[b] + below[b + 1] + kRegulariser;
  }
  cv::hal::sqrt32f(normaliser, normaliser, intervals_);
  for (int b = 0; b < intervals_; ++b) normaliser[b] = 1 / normaliser[b];
}

// Features of cell row r.
inline void ScalarFhog::emit_row(int r, float* features, std::ptrdiff_t plane) const {
  const float* const histogram = histogram_.data() + r % 2 * kSigned * stride_;
  const float* const upper = normaliser_.data() + r % 2 * stride_;
  const float* const lower = normaliser_.data() + (r + 1) % 2 * stride_;

  // Four cells at once; put(channel, values) stores them. The factor 1/2 of the features is applied before
  // clipping, hence the clip at 0.1 and the doubled texture factor.
  const auto emit_four = [&](int c, auto&& put) {
    const Quad clip = Quad::Constant(0.1F);
    const Quad n0 = 0.5F * ConstQuadMap(lower + c + 1), n1 = 0.5F * ConstQuadMap(upper + c + 1);
    const Quad n2 = 0.5F * ConstQuadMap(lower + c), n3 = 0.5F * ConstQuadMap(upper + c);
    Quad t0 = Quad::Zero(), t1 = t0, t2 = t0, t3 = t0;
    for (int o = 0; o < kSigned; ++o) {
      const Quad h = ConstQuadMap(histogram + o * stride_ + c);
      const Quad p0 = (h * n0).min(clip), p1 = (h * n1).min(clip), p2 = (h * n2).min(clip),
                 p3 = (h * n3).min(clip);
      t0 += p0;
      t1 += p1;
      t2 += p2;
      t3 += p3;
      put(o, (p0 + p1) + (p2 + p3));
    }
    for (int o = 0; o < kUnsigned; ++o) {
      const Quad h =
          ConstQuadMap(histogram + o * stride_ + c) + ConstQuadMap(histogram + (o + kUnsigned) * stride_ + c);
      put(kSigned + o, ((h * n0).min(clip) + (h * n1).min(clip)) + ((h * n2).min(clip) + (h * n3).min(clip)));
    }
    constexpr float kTexture = 2 * 0.2357F;
    put(27, kTexture * t0);
    put(28, kTexture * t1);
    put(29, kTexture * t2);
    put(30, kTexture * t3);
  };

  float* const row = features + static_cast<std::ptrdiff_t>(r) * cells_x_;
  int c = 0;
  for (; c + 4 <= cells_x_; c += 4) {
    emit_four(c, [&](int channel, const Quad& values) { QuadMap(row + channel * plane + c) = values; });
  }
  if (c < cells_x_) {
    emit_four(c, [&](int channel, const Quad& values) {
      for (int i = 0; c + i < cells_x_; ++i) row[channel * plane + c + i] = values[i];
    });
  }
}

inline void ScalarFhog::compute(const cv::Mat& patch, float* features) {
  if (patch.type() != CV_8UC1 && patch.type() != CV_32FC1) {
    throw std::invalid_argument("ScalarFhog: patch must be CV_8UC1 or CV_32FC1, is " +
                                cv::typeToString(patch.type()));
  }
  const int cells_y = patch.rows / cell_size_, cells_x = patch.cols / cell_size_;
  if (patch.dims > 2 || cells_y < 1 || cells_x < 1) {
    throw std::invalid_argument("ScalarFhog: patch of " + std::to_string(patch.cols) + " x " +
                                std::to_string(patch.rows) + " pixels is smaller than a cell of " +
                                std::to_string(cell_size_));
  }
  if (cells_x > kMaxCells) throw std::invalid_argument("ScalarFhog: more than 2^20 cells in a row");
  reserve(cells_x);
  const std::ptrdiff_t plane = static_cast<std::ptrdiff_t>(cells_y) * cells_x;
  const int height = cells_y * cell_size_, loaded = std::min(patch.rows, height + 1), half = cell_size_ / 2;

  load_row(patch, 0);
  int y = 0;
  for (int j = 0; j <= cells_y; ++j) {
    for (const int end = std::min(half + j * cell_size_, height); y < end; ++y) {
      if (y + 1 < loaded) load_row(patch, y + 1);
      vote_row(y, loaded);
    }
    collect(j);  // completes cell row j - 1; row -1 is outside the patch
    if (j > 0) normalise_blocks(j - 1, cells_y);
    if (j > 1) emit_row(j - 2, features, plane);
  }
  normalise_blocks(cells_y, cells_y);
  emit_row(cells_y - 1, features, plane);
}

}  // namespace asterism::testing
