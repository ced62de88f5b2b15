#include <asterism/parts/features/cell_spectra.hpp>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

#include "../concept/part_geometry.hpp"
#include "../kernels/filter_plan.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// The spectrum of exp(-i^2 / (2 sigma^2)) over wrapped distances i, which is real: its first `bins` bins.
Eigen::ArrayXd gaussian_spectrum(int n, double sigma, int bins) {
  Eigen::ArrayXd spectrum = Eigen::ArrayXd::Zero(bins);
  for (int i = 0; i < n; ++i) {
    const double value = std::exp(-0.5 * std::pow(wrapped(i, n) / sigma, 2));
    for (int k = 0; k < bins; ++k) spectrum(k) += value * std::cos(2 * std::numbers::pi * (i * k % n) / n);
  }
  return spectrum;
}

}  // namespace

CellSpectra::CellSpectra(const CellFeatures& features, int cell_size, const char* of)
    : features_(features), cell_size_(cell_size), fhog_(cell_size) {
  require(features.hog || features.gray || features.color || features.own != nullptr,
          std::string(of).append(": at least one feature is needed").c_str());
  channels_ = (features.hog ? Fhog::kChannels : 0) + (features.gray ? 1 : 0) + (features.color ? 2 : 0);
  if (features.own != nullptr) channels_ += features.own->channels();
}

int CellSpectra::fast_cells(double wanted) {
  const auto is_fast = [](int n) {
    for (const int radix : {2, 3, 5, 7})
      while (n % radix == 0) n /= radix;
    return n == 1;
  };
  int below = 4 * std::max(1, static_cast<int>(wanted / 4)), above = below + 4;
  while (!is_fast(below)) below -= 4;
  while (!is_fast(above)) above += 4;
  return wanted - below <= above - wanted ? below : above;
}

void CellSpectra::prepare(int rows, int cols) {
  rows_ = rows;
  cols_ = cols;
  plan_ = Plan::shared(rows, cols);
  const int lanes = plan_->kernels.lanes;
  padded_channels_ = (channels_ + lanes - 1) / lanes * lanes;
  const Eigen::Index plane = Eigen::Index{rows} * cols;
  planes_.reset(padded_channels_ * plane);
  sample_.reset(plan_->spectra_floats(padded_channels_));
  work_.reset(part_kernels_v0_1::work_floats(rows, cols));
  cell_work_.resize(cols * cell_size_);
  cell_sums_.resize(cols);

  const Eigen::ArrayXf across = hann(cols), down = hann(rows);
  hann_.reset(plane);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) hann_.data()[r * cols + c] = down(r) * across(c);
}

double CellSpectra::transform(const Frame& frame, const Point2& centre, const Size2& window) {
  const Eigen::Index plane = Eigen::Index{rows_} * cols_;
  float* planes = planes_.data();
  if (features_.hog || features_.gray)
    sampler_.sample(frame.gray(), centre, window, {cols_ * cell_size_, rows_ * cell_size_}, patch_.mat);
  if (features_.hog) {
    fhog_.compute(patch_.mat, planes);
    planes += Fhog::kChannels * plane;
  }
  if (features_.gray) {
    add_gray(planes);
    planes += plane;
  }
  if (features_.color) {
    add_color(frame, centre, window, planes);
    planes += 2 * plane;
  }
  if (features_.own != nullptr) add_own(frame, centre, window, planes);
  return plan_->kernels.forward(plan_->transform, padded_channels_, planes_.data(), hann_.data(),
                                sample_.data(), work_.data());
}

// The gray level of a cell is the mean of its pixels, rounded to a whole level, less one half.
void CellSpectra::add_gray(float* plane) {
  const int cell = cell_size_;
  for (int r = 0; r < rows_; ++r) {
    plan_->kernels.cell_sums(patch_.mat.ptr<std::uint8_t>(r * cell),
                             static_cast<std::ptrdiff_t>(patch_.mat.step), cell, cols_, cell_work_.data(),
                             cell_sums_.data());
    const float scale = 1 / static_cast<float>(cell * cell);
    for (int c = 0; c < cols_; ++c)
      *plane++ = std::rint(static_cast<float>(cell_sums_(c)) * scale) / 255 - 0.5F;
  }
}

void CellSpectra::add_color(const Frame& frame, const Point2& centre, const Size2& window, float* planes) {
  float *a = planes, *b = planes + Eigen::Index{rows_} * cols_;
  if (frame.bgr().empty()) {
    std::fill(a, b + Eigen::Index{rows_} * cols_, 0.0F);
    return;
  }
  sample_patch(frame.bgr(), centre, window, {cols_, rows_}, cells_.mat);
  cv::cvtColor(cells_.mat, cells_.mat, cv::COLOR_BGR2Lab);
  for (int r = 0; r < rows_; ++r) {
    const cv::Vec3b* const row = cells_.mat.ptr<cv::Vec3b>(r);
    for (int c = 0; c < cols_; ++c) {
      *a++ = static_cast<float>(row[c][1] - 128) / 128;
      *b++ = static_cast<float>(row[c][2] - 128) / 128;
    }
  }
}

void CellSpectra::add_own(const Frame& frame, const Point2& centre, const Size2& window, float* planes) {
  cv::Mat& pixels = colored_.mat;
  sample_bgr(frame, centre, window, {cols_ * cell_size_, rows_ * cell_size_}, pixels);
  features_.own->compute(pixels, rows_, cols_, planes);
  const float* const begin = planes;
  const float* const end = planes + Eigen::Index{features_.own->channels()} * rows_ * cols_;
  if (!std::all_of(begin, end, [](float value) { return std::isfinite(value); }))
    throw std::runtime_error("CellChannels: a value is not finite");
}

bool CellSpectra::flat() const {
  if (features_.hog || features_.gray) {
    const std::uint8_t level = *patch_.mat.ptr<std::uint8_t>(0);
    for (int y = 0; y < patch_.mat.rows; ++y) {
      const std::uint8_t* const row = patch_.mat.ptr<std::uint8_t>(y);
      if (!std::all_of(row, row + patch_.mat.cols, [level](std::uint8_t other) { return other == level; }))
        return false;
    }
  }
  if (features_.color) {
    const Eigen::Index plane = Eigen::Index{rows_} * cols_;
    const float* const a =
        planes_.data() + plane * ((features_.hog ? Fhog::kChannels : 0) + (features_.gray ? 1 : 0));
    for (const float* const axis : {a, a + plane})
      if (!std::all_of(axis, axis + plane, [axis](float other) { return other == *axis; })) return false;
  }
  if (features_.own != nullptr) {
    const auto first = colored_.mat.at<cv::Vec3b>(0, 0);
    const auto begin = colored_.mat.begin<cv::Vec3b>(), end = colored_.mat.end<cv::Vec3b>();
    if (!std::all_of(begin, end, [&first](const cv::Vec3b& other) { return other == first; })) return false;
  }
  return true;
}

Eigen::ArrayXd CellSpectra::gaussian_label(double sigma) const {
  const part_kernels_v0_1::Transform& t = plan_->transform;
  // A product of a Gaussian along each axis; so is its spectrum.
  const Eigen::ArrayXd across = gaussian_spectrum(cols_, sigma, t.bins),
                       down = gaussian_spectrum(rows_, sigma, rows_);
  Eigen::ArrayXd label = Eigen::ArrayXd::Zero(plan_->half_floats());
  for (int r = 0; r < rows_; ++r) label.segment(r * t.padded_bins, t.bins) = down(r) * across;
  return label;
}

void CellSpectra::put_response(const float* plane, float factor, float constant,
                               ResponseMap& response) const {
  const int lanes = plan_->kernels.lanes, shift = cols_ / 2;
  for (int r = 0; r < rows_; ++r) {
    const float* const from = plane + plan_->plane_index(r, 0);
    float* const to = response.values.data() + (r + rows_ / 2) % rows_ * cols_;
    for (int c = 0; c < cols_ - shift; ++c) to[c + shift] = factor * from[c * lanes] + constant;
    for (int c = cols_ - shift; c < cols_; ++c) to[c + shift - cols_] = factor * from[c * lanes] + constant;
  }
}

void CellSpectra::visit_spectra(StateArchive& archive, AlignedFloats& spectra) const {
  const part_kernels_v0_1::Transform& t = plan_->transform;
  const Eigen::Index lanes = plan_->kernels.lanes;
  for (Eigen::Index channel = 0; channel < channels_; ++channel)
    for (Eigen::Index row = 0; row < t.rows; ++row)
      for (Eigen::Index bin = 0; bin < t.bins; ++bin) {
        float* const real =
            spectra.data() + ((channel / lanes * t.rows + row) * t.bins + bin) * 2 * lanes + channel % lanes;
        archive(real[0]);
        archive(real[lanes]);
      }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
