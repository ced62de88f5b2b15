#include <algorithm>
#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/models/color.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace {

/// Approximate limit of the pixels read for one histogram; larger regions are sampled on a regular grid.
constexpr double kSamples = 10000;
/// Approximate number of cells of a segmentation, and the limit along one side, for extremely long regions.
constexpr double kCells = 1000;
constexpr double kMaxSide = 1000;
/// The update sets bins below this to 0: a color not seen for hundreds of frames counts as never seen, and no
/// arithmetic on denormal numbers is done.
constexpr float kForgotten = 1e-12f;

bool is_box(const cv::Rect2d& box) {
  return std::isfinite(box.x) && std::isfinite(box.y) && std::isfinite(box.width) &&
         std::isfinite(box.height) && box.width > 0 && box.height > 0;
}

cv::Rect2d enlarged(const cv::Rect2d& box, double factor) {
  return box_around(centre_of(box), factor * Size2(box.width, box.height));
}

/// Index of an HSV pixel's bin; all three channels have the range 0 .. 255.
std::size_t bin(const cv::Vec3b& hsv) {
  constexpr int kShift = 4;
  static_assert(256 >> kShift == ColorModel::kBinsPerChannel);
  constexpr std::size_t kSide = ColorModel::kBinsPerChannel;
  return (std::size_t(hsv[0] >> kShift) * kSide + std::size_t(hsv[1] >> kShift)) * kSide +
         std::size_t(hsv[2] >> kShift);
}

/// Whole pixels first .. end - 1 of one axis.
struct Span {
  int first = 0, end = 0;
  int length() const { return std::max(0, end - first); }
};

/// The pixels 0 .. limit - 1 whose centres are in [begin - 1/2, begin + length - 1/2): a box covers the
/// pixels begin .. begin + length - 1.
Span pixels_along(double begin, double length, int limit) {
  // fmax before fmin: a box so large that its end is infinity - infinity covers nothing.
  const double first = std::fmin(std::fmax(std::ceil(begin - 0.5), 0), limit);
  const double end = std::fmin(std::fmax(std::ceil(begin + length - 0.5), 0), limit);
  return {int(first), int(end)};
}

/// The image's pixels that a box covers.
cv::Rect pixels_of(const cv::Rect2d& box, cv::Size image) {
  const Span x = pixels_along(box.x, box.width, image.width),
             y = pixels_along(box.y, box.height, image.height);
  return {x.first, y.first, x.length(), y.length()};
}

}  // namespace

bool ColorModel::collect(const cv::Mat& bgr, const cv::Rect& region, const cv::Rect& hole,
                         Histogram& histogram) {
  const double area = double(region.area()) - double((region & hole).area());
  const int stride = std::max(1, int(std::ceil(std::sqrt(area / kSamples))));
  // Only the samples are converted to HSV, in one call.
  samples_.clear();
  samples_.reserve(std::size_t(kSamples));
  for (int y = region.y; y < region.br().y; y += stride) {
    const cv::Vec3b* row = bgr.ptr<cv::Vec3b>(y);
    for (int x = region.x; x < region.br().x; x += stride) {
      if (!hole.contains({x, y})) samples_.push_back(row[x]);
    }
  }
  if (samples_.empty()) return false;
  // Counts up to 2^24 are exact in float.
  histogram.fill(0);
  for (const cv::Vec3b& pixel : samples_in_hsv()) ++histogram[bin(pixel)];
  for (float& value : histogram) value /= float(samples_.size());
  return true;
}

const std::vector<cv::Vec3b>& ColorModel::samples_in_hsv() {
  hsv_.reserve(samples_.capacity());  // reallocates no more often than samples_
  cv::cvtColor(samples_, hsv_, cv::COLOR_BGR2HSV_FULL);
  return hsv_;
}

void ColorModel::Axis::place(double begin, double length, double scale, int limit) {
  cells = int(std::clamp(std::round(length * scale), 1.0, kMaxSide));
  spacing = length / cells;
  origin = begin - 0.5 + spacing / 2;
  count.assign(std::size_t(cells), 0);
  pixel.clear(), cell.clear();
  pixel.reserve(6 * std::size_t(cells)), cell.reserve(6 * std::size_t(cells));  // an upper bound
  valid = {0, 0};
  const int stride = int(std::clamp(std::floor(spacing / 3), 1.0, double(limit)));
  for (int i = 0; i < cells; ++i) {
    const double centre = origin + i * spacing;
    if (!(centre >= -0.5 && centre < limit - 0.5)) continue;
    if (valid.empty()) valid.start = i;
    valid.end = i + 1;
    Span span = pixels_along(centre - spacing / 2 + 0.5, spacing, limit);
    if (span.length() == 0) {
      // A cell smaller than a pixel takes the nearest one.
      span.first = std::clamp(int(std::lround(centre)), 0, limit - 1);
      span.end = span.first + 1;
    }
    // Centred in the cell, so that the samples' mean position is the cell's centre.
    const int samples = (span.length() - 1) / stride + 1;
    const int first = span.first + (span.length() - 1 - (samples - 1) * stride) / 2;
    count[std::size_t(i)] = samples;
    for (int k = 0; k < samples; ++k) {
      pixel.push_back(first + k * stride);
      cell.push_back(i);
    }
  }
}

double Segmentation::at(const Point2& position) const {
  if (posterior.empty()) return 0;
  const double x = (position.x() - origin.x()) / spacing.x(), y = (position.y() - origin.y()) / spacing.y();
  // Written so that NaN is outside.
  if (!(x >= -0.5 && x <= posterior.cols - 0.5 && y >= -0.5 && y <= posterior.rows - 0.5)) return 0;
  // Beyond the outermost centres the value is constant.
  const double cx = std::clamp(x, 0.0, posterior.cols - 1.0), cy = std::clamp(y, 0.0, posterior.rows - 1.0);
  const int x0 = int(cx), y0 = int(cy);
  const int x1 = std::min(x0 + 1, posterior.cols - 1), y1 = std::min(y0 + 1, posterior.rows - 1);
  const double fx = cx - x0, fy = cy - y0;
  const float *upper = posterior.ptr<float>(y0), *lower = posterior.ptr<float>(y1);
  return (1 - fy) * ((1 - fx) * double(upper[x0]) + fx * double(upper[x1])) +
         fy * ((1 - fx) * double(lower[x0]) + fx * double(lower[x1]));
}

double Segmentation::foreground_fraction(const cv::Rect2d& box) const {
  if (posterior.empty() || !is_box(box)) return 0;
  // The cells first .. end - 1 whose centres are in the box, counted beyond the grid too.
  struct Cells {
    double first, end;
    cv::Range inside(int limit) const {
      return {int(std::clamp(first, 0.0, double(limit))), int(std::clamp(end, 0.0, double(limit)))};
    }
  };
  const auto covered = [](double begin, double length, double grid_origin, double grid_spacing) -> Cells {
    const double first = std::ceil((begin - 0.5 - grid_origin) / grid_spacing);
    const double end = std::ceil((begin + length - 0.5 - grid_origin) / grid_spacing);
    if (end > first) return {first, end};
    const double nearest = std::round((begin + (length - 1) / 2 - grid_origin) / grid_spacing);
    return {nearest, nearest + 1};
  };
  const Cells x = covered(box.x, box.width, origin.x(), spacing.x());
  const Cells y = covered(box.y, box.height, origin.y(), spacing.y());
  const cv::Range cols = x.inside(posterior.cols), rows = y.inside(posterior.rows);
  int foreground = 0;
  for (int row = rows.start; row < rows.end; ++row) {
    const float* value = posterior.ptr<float>(row);
    foreground += int(std::count_if(value + cols.start, value + cols.end, [](float p) { return p > 0.5f; }));
  }
  if (foreground == 0) return 0;  // also if the box is so far away that its cells cannot be counted
  return foreground / ((x.end - x.first) * (y.end - y.first));
}

ColorModel::ColorModel(const ColorOptions& options) : options_(check_options("ColorOptions", options)) {
  if (options.max_area_ratio <= options.min_area_ratio)
    throw std::invalid_argument("ColorOptions: area ratios must satisfy min < max");
}

void ColorModel::init(const Frame& frame, const cv::Rect2d& box) {
  if (!is_box(box)) throw std::invalid_argument("ColorModel: the box must be finite and not empty");
  enabled_ = false;
  if (frame.has_color()) {
    const cv::Rect inner = pixels_of(box, frame.size());
    const cv::Rect outer = pixels_of(enlarged(box, options_.surrounding), frame.size());
    enabled_ =
        collect(frame.bgr(), inner, {}, foreground_) && collect(frame.bgr(), outer, inner, background_);
  }
  if (!enabled_) {
    foreground_.fill(0);
    background_.fill(0);
  }
}

void ColorModel::adapt(const Frame& frame, const cv::Rect2d& box) {
  if (!is_box(box)) throw std::invalid_argument("ColorModel: the box must be finite and not empty");
  if (!enabled_ || !frame.has_color()) return;
  const cv::Rect inner = pixels_of(box, frame.size());
  const cv::Rect outer = pixels_of(enlarged(box, options_.surrounding), frame.size());
  // Eq. 21.
  const float rate = float(options_.histogram_rate);
  const auto update = [rate](Histogram& learned, const Histogram& seen) {
    for (std::size_t i = 0; i < learned.size(); ++i) {
      const float value = learned[i] * (1 - rate) + seen[i] * rate;
      learned[i] = value < kForgotten ? 0 : value;
    }
  };
  Histogram seen;
  if (collect(frame.bgr(), inner, {}, seen)) update(foreground_, seen);
  if (collect(frame.bgr(), outer, inner, seen)) update(background_, seen);
}

Segmentation ColorModel::segment(const Frame& frame, const cv::Rect2d& region, const Size2& box_size) {
  if (!is_box(region) || !is_box({0, 0, box_size.x(), box_size.y()})) {
    throw std::invalid_argument("ColorModel: the region or the box must be finite and not empty");
  }
  Segmentation result;
  if (!enabled_ || !frame.has_color()) return result;

  const double scale = std::min(
      1.0, std::sqrt(kCells / std::max(1.0, region.width - 1)) / std::sqrt(std::max(1.0, region.height - 1)));
  const cv::Mat& bgr = frame.bgr();
  x_axis_.place(region.x, region.width, scale, bgr.cols);
  y_axis_.place(region.y, region.height, scale, bgr.rows);
  result.origin = {x_axis_.origin, y_axis_.origin};
  result.spacing = {x_axis_.spacing, y_axis_.spacing};
  cv::Mat& posterior = posterior_.mat;
  if (posterior.u != nullptr && posterior.u->refcount > 1) posterior.release();  // in use elsewhere
  posterior.create(y_axis_.cells, x_axis_.cells, CV_32FC1);
  std::fill_n(posterior.ptr<float>(), posterior.total(), 0.0f);  // setTo would allocate
  result.posterior = posterior;
  if (x_axis_.pixel.empty() || y_axis_.pixel.empty()) return result;

  // p(f | color) of every bin by Bayes' rule.
  const float prior_f = float(options_.foreground_prior), prior_b = 1 - prior_f;
  Histogram posterior_of_bin;
  for (std::size_t i = 0; i < posterior_of_bin.size(); ++i) {
    const float f = prior_f * foreground_[i], b = prior_b * background_[i];
    posterior_of_bin[i] = f + b > 0 ? f / (f + b) : prior_f;
  }

  // Each cell averages its pixels' posteriors, not their colors: a mean color may be unlike all the colors
  // that were averaged and like none that the histograms have seen.
  samples_.resize(y_axis_.pixel.size() * x_axis_.pixel.size());
  cv::Vec3b* sample = samples_.data();
  for (const int y : y_axis_.pixel) {
    const cv::Vec3b* row = bgr.ptr<cv::Vec3b>(y);
    for (const int x : x_axis_.pixel) *sample++ = row[x];
  }
  const cv::Vec3b* pixel = samples_in_hsv().data();
  for (const int row : y_axis_.cell) {
    float* sum = posterior.ptr<float>(row);
    for (const int col : x_axis_.cell) sum[col] += posterior_of_bin[bin(*pixel++)];
  }
  cv::Mat valid = posterior(y_axis_.valid, x_axis_.valid);
  for (int row = 0; row < valid.rows; ++row) {
    const int count_y = y_axis_.count[std::size_t(y_axis_.valid.start + row)];
    float* value = valid.ptr<float>(row);
    for (int col = 0; col < valid.cols; ++col) {
      const int count = count_y * x_axis_.count[std::size_t(x_axis_.valid.start + col)];
      value[col] = std::min(value[col] / float(count), 1.0f);
    }
  }

  // The random field covers only the cells inside the image: those outside have no effect and posterior 0.
  regularize_posterior(valid, {}, options_.mrf, mrf_, valid);

  // Eq. 6, with M_fg in pixels.
  const float* const first = posterior.ptr<float>();
  const auto cells = std::count_if(first, first + posterior.total(), [](float p) { return p > 0.5f; });
  const double foreground = static_cast<double>(cells) * result.spacing.prod();
  const double ratio = foreground / box_size.prod();
  result.informative = ratio > options_.min_area_ratio && ratio < options_.max_area_ratio;
  return result;
}

void ColorModel::visit_state(StateArchive& archive) {
  archive.begin("color", options_);
  archive(enabled_);
  for (auto* const histogram : {&foreground_, &background_}) {
    if (archive.loading()) histogram->fill(0);
    if (!enabled_) continue;
    for (float& share : *histogram) {
      archive(share);
      archive.require(share >= 0 && share <= 2);  // the sum is 1 up to rounding
    }
  }
}

double ColorModel::probability(const Segmentation& segmentation, const Point2& position) const {
  // Eq. 5.
  const double alpha = segmentation.informative ? options_.uniform_weight : 1;
  return segmentation.at(position) * (1 - alpha) + alpha;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
