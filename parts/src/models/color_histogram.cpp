#include <algorithm>
#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/models/color_histogram.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "../concept/part_geometry.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

ColorHistogram::ColorHistogram(const ColorHistogramOptions& options)
    : options_(check_options("ColorHistogramOptions", options)) {
  require_ordered(options.window, "ColorHistogramOptions");
}

void ColorHistogram::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  prepare(size, frame.bgr().empty() ? Space::Gray : options_.space);
  learn(frame, centre, 1);
}

void ColorHistogram::prepare(const Size2& size, Space space) {
  size_ = size, space_ = space;
  const auto [spacing, cols, rows, reach, response] = match_geometry(size, options_.window);
  spacing_ = spacing, cols_ = cols, rows_ = rows, reach_ = reach;
  response_ = likelihood_ = response;
  near_.values.resize(3, 3);
  near_.origin = Point2::Constant(-1);
  near_.periodic = false;

  const int bins = options_.bins, pixels = rows_ * cols_;
  histogram_.setZero(space_ == Space::Gray ? bins : bins * bins * bins);
  counts_.resize(histogram_.size());
  roots_ = Eigen::ArrayXf::LinSpaced(pixels + 1, 0, static_cast<float>(pixels)).sqrt();
}

void ColorHistogram::visit_state(StateArchive& archive) {
  archive.begin("color_histogram", options_);
  if (!archive.loading() && size_.isZero()) throw std::logic_error("ColorHistogram: save before init");
  archive.size(size_);
  archive(space_, 3);
  archive.require(space_ == Space::Gray || space_ == options_.space);
  if (archive.loading()) prepare(Size2(size_), space_);
  archive(histogram_);
  archive.require((histogram_ >= 0).all());
  archive.position(bias_);
  histogram_roots_ = histogram_.sqrt();
}

Evidence ColorHistogram::localize(const Frame& frame, const Point2& around) {
  auto& values = response_.values;
  sample(frame, around, reach_);
  match(reach_, values);
  settle_ties(values, 1e-5F);  // rounding of the running sums
  response_.origin = likelihood_.origin = around - spacing_ * Point2::Constant(reach_);
  // Relative to the best match, so that no likelihood underflows.
  likelihood_.values = (static_cast<float>(options_.sharpness) * (values - values.maxCoeff())).exp();
  Evidence evidence = evidence_of(response_, likelihood_);
  if (evidence.peak > 0) evidence.position -= spacing_ * bias_;
  return evidence;
}

void ColorHistogram::match(int reach, Map& values) {
  const int width = cols_ + 2 * reach, displacements = 2 * reach + 1;
  // rho of a box that slides along a row; its histogram and the sum over the bins are updated at each step.
  const float norm = 1 / roots_(roots_.size() - 1);
  for (int r = 0; r < displacements; ++r) {
    counts_.setZero();
    double sum = 0;
    const auto enter = [&](int bin) {
      const int count = counts_(bin)++;
      sum += histogram_roots_(bin) * (roots_(count + 1) - roots_(count));
    };
    const auto leave = [&](int bin) {
      const int count = --counts_(bin);
      sum -= histogram_roots_(bin) * (roots_(count + 1) - roots_(count));
    };
    const int* const first = bins_.data() + std::ptrdiff_t{r} * width;
    for (int i = 0; i < rows_; ++i)
      for (int j = 0; j < cols_; ++j) enter(first[i * width + j]);
    values(r, 0) = norm * static_cast<float>(sum);
    for (int c = 1; c < displacements; ++c) {
      for (int i = 0; i < rows_; ++i) {
        leave(first[i * width + c - 1]);
        enter(first[i * width + c - 1 + cols_]);
      }
      values(r, c) = norm * static_cast<float>(sum);
    }
  }
}

void ColorHistogram::adapt(const Frame& frame, const Point2& at) { learn(frame, at, options_.learning_rate); }

void ColorHistogram::learn(const Frame& frame, const Point2& at, double rate) {
  constexpr int kReach = 1;
  sample(frame, at, kReach);
  counts_.setZero();
  for (int r = kReach; r < rows_ + kReach; ++r) {
    const int* const row = bins_.data() + std::ptrdiff_t{r} * (cols_ + 2 * kReach) + kReach;
    for (int c = 0; c < cols_; ++c) ++counts_(row[c]);
  }
  const auto seen = counts_.cast<float>() / static_cast<float>(rows_ * cols_);
  histogram_ += static_cast<float>(rate) * (seen - histogram_);
  histogram_roots_ = histogram_.sqrt();
  // rho falls faster where other colors begin, so the vertex of the parabola is beside the target. The middle
  // is preferred as little as in a search, one cell away.
  match(kReach, near_.values);
  const float beside = 1 - 1e-4F / static_cast<float>(std::max(1, reach_ * reach_));
  const auto vertex = [beside](float before, float middle, float after) {
    const double left = before * beside, right = after * beside, curvature = 2.0 * middle - left - right;
    return curvature > 0 ? std::clamp(0.5 * (right - left) / curvature, -0.5, 0.5) : 0.0;
  };
  const auto& rho = near_.values;
  bias_ = {vertex(rho(1, 0), rho(1, 1), rho(1, 2)), vertex(rho(0, 1), rho(1, 1), rho(2, 1))};
}

void ColorHistogram::sample(const Frame& frame, const Point2& centre, int margin) {
  const cv::Size grid(cols_ + 2 * margin, rows_ + 2 * margin);
  const Size2 window = spacing_ * Size2(grid.width, grid.height);
  cv::Mat& patch = patch_.mat;
  if (space_ == Space::Gray)
    sample_patch(frame.gray(), centre, window, grid, patch);
  else
    sample_bgr(frame, centre, window, grid, patch);
  if (space_ == Space::Hsv) cv::cvtColor(patch, patch, cv::COLOR_BGR2HSV_FULL);

  const int bins = options_.bins, channels = patch.channels();
  bins_.resize(patch.total());
  const uchar* level = patch.ptr<uchar>();  // continuous: made by OpenCV at this size
  for (int& bin : bins_) {
    bin = 0;
    for (int k = 0; k < channels; ++k) bin = bin * bins + *level++ * bins / 256;
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
