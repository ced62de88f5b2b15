#include <algorithm>
#include <asterism/parts/features/fhog.hpp>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>

#include "../kernels/part_kernels.hpp"

// One pass over the patch, a row of cells at a time, so that everything but the result stays in the first
// cache:
//
//   load_row     a row of pixels as floats, with the border replicated
//   vote_row     magnitude and orientation of each gradient, then one vote per pixel
//   collect      votes -> histograms of the row of cells that is now complete, and its energy
//   normalise_blocks  1 / sqrt of the 2 x 2 block energies between two rows of cells
//   emit_row     normalise, clip and sum one row of cells into the 31 planes
//
// Bilinear interpolation spreads a pixel over the four cells whose centres surround it. Scattering four times
// a pixel is what costs the time in the usual implementations. Here the unit is the *interval*, the square
// between four neighbouring centres: all its pixels share the same four cells, so a vote is one 4-vector
// (left top, left bottom, right top, right bottom) added to the interval's entry for the orientation. A
// cell's histogram is the sum of one lane of each of its four intervals.
//
// The steps themselves are kernels, part_kernels_impl.hpp; the tests compare them with a scalar version.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace {

constexpr int kSigned = 18;
// A gradient between -10 and 0 degrees lands in slot 18, which is orientation 0 again: an extra slot is
// cheaper than a test per pixel.
constexpr int kSlots = kSigned + 1;
constexpr float kMaxPixel = 1e8F;  // keeps block energies far from overflow for every cell size
constexpr float kRegulariser = 1e-4F;
constexpr int kMaxCells = 1 << 20;  // in a row; keeps all indices within int
constexpr int kPadding = part_kernels_v0_1::kMaxLanes;

int padded(int n) { return (n + kPadding - 1) / kPadding * kPadding; }

template <typename Value>
void grow(std::vector<Value>& buffer, int size, const Value& value) {
  if (buffer.size() < static_cast<std::size_t>(size)) buffer.resize(static_cast<std::size_t>(size), value);
}

}  // namespace

Fhog::Fhog(int cell_size) : cell_size_(cell_size), kernels_(&part_kernels_v0_1::kernels()) {
  if (cell_size < 1)
    throw std::invalid_argument("Fhog: cell_size is " + std::to_string(cell_size) + ", must be >= 1");
}

void Fhog::reserve(int cells_x) {
  cells_x_ = cells_x;
  intervals_ = cells_x + 1;
  stride_ = padded(cells_x) + kPadding;
  row_ = padded(cells_x * cell_size_ + 2) + kPadding;
  grow(phase_weights_, 4 * cell_size_, 0.0F);
  grow(votes_, kSlots * intervals_, Eigen::Array4f(Eigen::Array4f::Zero()));
  grow(pixels_, 3 * row_, 0.0F);
  grow(magnitude_, row_, 0.0F);
  grow(slot_, row_, 0);
  grow(open_row_, kSigned * stride_, 0.0F);
  grow(histogram_, 2 * kSigned * stride_, 0.0F);
  grow(energy_, 2 * stride_, 0.0F);
  grow(normaliser_, 2 * stride_, 0.0F);
}

void Fhog::load_row(const cv::Mat& patch, int y) {
  const int width = cells_x_ * cell_size_;
  float* __restrict const row = pixels_.data() + y % 3 * row_ + 1;
  if (patch.depth() == CV_8U) {
    const std::uint8_t* __restrict const source = patch.ptr<std::uint8_t>(y);
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
void Fhog::vote_row(int y, int rows) {
  const auto row_at = [&](int i) { return pixels_.data() + i % 3 * row_ + 1; };
  // Fraction of the way from the upper to the lower cell centres, the same for all pixels of the row. In x it
  // depends only on the pixel's phase within an interval.
  const int half = cell_size_ / 2;
  const auto fraction = [&](int phase) {
    return (static_cast<float>(half + phase) + 0.5F) / static_cast<float>(cell_size_) - 0.5F;
  };
  const float fy = fraction((y + cell_size_ - half) % cell_size_);
  for (int p = 0; p < cell_size_; ++p) {
    const float fx = fraction(p);
    float* const weights = phase_weights_.data() + 4 * p;
    weights[0] = (1 - fx) * (1 - fy);
    weights[1] = (1 - fx) * fy;
    weights[2] = fx * (1 - fy);
    weights[3] = fx * fy;
  }
  kernels_->vote_row({.above = row_at(std::max(y - 1, 0)),
                      .here = row_at(y) - 1,
                      .below = row_at(std::min(y + 1, rows - 1)),
                      .width = cells_x_ * cell_size_,
                      .cell_size = cell_size_,
                      .slot_stride = intervals_,
                      .magnitude = magnitude_.data(),
                      .slot = slot_.data(),
                      .weights = phase_weights_.data(),
                      .votes = votes_.front().data()});
}

// Sums the votes of interval row j into the histograms: its upper lanes complete cell row j - 1, its lower
// lanes open cell row j. Leaves the votes zero.
void Fhog::collect(int j) {
  float* const histogram = histogram_.data() + (j + 1) % 2 * kSigned * stride_;
  float* const energy = energy_.data() + (j + 1) % 2 * stride_ + 1;
  kernels_->collect(votes_.front().data(), intervals_, cells_x_, stride_, open_row_.data(), histogram,
                    energy);
  energy[-1] = energy[0];
  energy[cells_x_] = energy[cells_x_ - 1];
}

// Normalisers of the blocks between cell rows r - 1 and r.
void Fhog::normalise_blocks(int r, int rows) {
  const float* const above = energy_.data() + (std::max(r - 1, 0) % 2) * stride_;
  const float* const below = energy_.data() + (std::min(r, rows - 1) % 2) * stride_;
  float* __restrict const normaliser = normaliser_.data() + r % 2 * stride_;
  for (int b = 0; b < intervals_; ++b) {
    normaliser[b] = 1 / std::sqrt(above[b] + above[b + 1] + below[b] + below[b + 1] + kRegulariser);
  }
}

// Features of cell row r.
void Fhog::emit_row(int r, float* features, std::ptrdiff_t plane) const {
  kernels_->emit_row({.histogram = histogram_.data() + r % 2 * kSigned * stride_,
                      .upper = normaliser_.data() + r % 2 * stride_,
                      .lower = normaliser_.data() + (r + 1) % 2 * stride_,
                      .cells = cells_x_,
                      .stride = stride_,
                      .plane = plane,
                      .features = features + static_cast<std::ptrdiff_t>(r) * cells_x_});
}

void Fhog::compute(const cv::Mat& patch, float* features) {
  if (patch.type() != CV_8UC1 && patch.type() != CV_32FC1) {
    throw std::invalid_argument("Fhog: patch must be CV_8UC1 or CV_32FC1, is " +
                                cv::typeToString(patch.type()));
  }
  const int cells_y = patch.rows / cell_size_, cells_x = patch.cols / cell_size_;
  if (patch.dims > 2 || cells_y < 1 || cells_x < 1) {
    throw std::invalid_argument("Fhog: patch of " + std::to_string(patch.cols) + " x " +
                                std::to_string(patch.rows) + " pixels is smaller than a cell of " +
                                std::to_string(cell_size_));
  }
  if (cells_x > kMaxCells) throw std::invalid_argument("Fhog: more than 2^20 cells in a row");
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

}  // namespace ASTERISM_ABI
}  // namespace asterism
