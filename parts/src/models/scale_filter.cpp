#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/models/scale_filter.hpp>
#include <cmath>
#include <numbers>

#include "../concept/part_geometry.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Limit of the cells in a template, each of which has 31 channels at every scale.
constexpr double kMaxScaleCells = 4096;
// Limit of the side of the patch from which all scales are sampled.
constexpr double kMaxSourceSide = 4096;

}  // namespace

ScaleFilter::ScaleFilter(const ScaleFilterOptions& options)
    : options_(check_options("ScaleFilterOptions", options)), fhog_(options.cell_size) {
  require(options.scales % 2 == 1, "ScaleFilterOptions: scales must be odd");
  require(std::pow(options.step, options.scales) <= 1e6,
          "ScaleFilterOptions: step^scales must be at most 1e6");
  const double cell_area = options.cell_size * options.cell_size;
  require(options.max_template_area >= cell_area && options.max_template_area <= kMaxScaleCells * cell_area,
          "ScaleFilterOptions: max_template_area must be in [1, 4096] cell_size^2");

  const int n = options.scales, bins = n / 2 + 1;
  // The window reaches 0 one step beyond both ends, so that no scale has weight 0.
  hann_ =
      0.5f - 0.5f * Eigen::ArrayXf::LinSpaced(n + 2, 0, 2 * std::numbers::pi_v<float>).cos().segment(1, n);
  cosines_.resize(bins, n);
  sines_.resize(bins, n);
  for (int k = 0; k < bins; ++k)
    for (int i = 0; i < n; ++i) {
      const double angle = 2 * std::numbers::pi * (k * i % n) / n;
      cosines_(k, i) = std::cos(angle);
      sines_(k, i) = std::sin(angle);
    }
  // The label: a Gaussian at scale 1, wrapped.
  const double sigma = options.label_sigma * std::sqrt(n);  // [steps]
  correlation_.resize(n);
  for (int i = 0; i < n; ++i) correlation_(i) = std::exp(-0.5 * std::pow(std::min(i, n - i) / sigma, 2));
  label_ = cosines_ * correlation_;
  real_.setZero(bins);
  imaginary_.setZero(bins);
  gram_.resize(n, n);
  response_.setZero(n);
}

void ScaleFilter::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  prepare(size);
  compute_features(frame, centre, size);
  learn(1);
}

void ScaleFilter::prepare(const Size2& size) {
  size_ = initial_size_ = size;
  const double to_template = std::min(
      {1.0, std::sqrt(options_.max_template_area) / mean_side(size), kMaxWindowSide / size.maxCoeff()});
  const auto side = [&](double length) {
    return options_.cell_size * std::max(1, static_cast<int>(length * to_template / options_.cell_size));
  };
  grid_ = {side(size.x()), side(size.y())};
  const int cells = grid_.area() / (options_.cell_size * options_.cell_size);
  hog_.resize(cells * Fhog::kChannels);
  sample_.resize(hog_.size(), options_.scales);
  template_.setZero(hog_.size(), options_.scales);
  energy_.setZero(label_.size());
  taps_.resize(static_cast<std::size_t>(grid_.width));
  response_.setZero();
  peak_ = log_variance_ = 0;
}

void ScaleFilter::visit_state(StateArchive& archive) {
  archive.begin("scale filter", options_);
  if (!archive.loading() && size_.isZero()) throw std::logic_error("ScaleFilter: save before init");
  archive.size(initial_size_);
  Size2 size = size_;
  archive.size(size);
  if (archive.loading()) prepare(Size2(initial_size_));
  size_ = size;
  archive(template_);
  archive(energy_);
}

double ScaleFilter::localize(const Frame& frame, const Point2& centre) {
  compute_features(frame, centre, size_);
  // sum_d conj(F_d) Z_d, the spectrum of the correlation of template and sample over all features.
  correlate(template_);
  real_.noalias() = cosines_ * correlation_;
  imaginary_.noalias() = sines_ * correlation_;  // conjugated
  real_.array() *= label_.array() / (energy_.array() + options_.lambda);
  imaginary_.array() *= label_.array() / (energy_.array() + options_.lambda);
  // Inverse transform; each bin except the first stands for two. Scale 1 goes to the middle.
  real_.tail(real_.size() - 1) *= 2;
  imaginary_.tail(real_.size() - 1) *= 2;
  correlation_.noalias() = cosines_.transpose() * real_;
  correlation_.noalias() += sines_.transpose() * imaginary_;
  const Eigen::Index half = response_.size() / 2;
  response_.tail(half + 1) = correlation_.head(half + 1).cast<float>() / static_cast<float>(response_.size());
  response_.head(half) = correlation_.tail(half).cast<float>() / static_cast<float>(response_.size());

  const Eigen::Index n = response_.size(), middle_scale = n / 2;
  Eigen::Index best = 0;
  peak_ = static_cast<double>(response_.maxCoeff(&best));
  const bool any = peak_ > 0;
  if (!any) {
    best = middle_scale;
    peak_ = 0;
  }
  // Vertex of the parabola through the maximum and its neighbours.
  auto position = static_cast<double>(best);
  if (any && best > 0 && best + 1 < n) {
    const double left = response_(best - 1), middle = response_(best), right = response_(best + 1);
    const double curvature = 2 * middle - left - right;
    if (curvature > 0) position += 0.5 * (right - left) / curvature;
  }
  double mass = 0, moment = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    const double weight = any ? std::max(0.0f, response_(i)) : 1.0f;
    mass += weight;
    moment += weight * std::pow(static_cast<double>(i) - position, 2);
  }
  const double log_step = std::log(options_.step);
  log_variance_ = (moment / mass + 1.0 / 12) * log_step * log_step;
  return std::exp((position - static_cast<double>(middle_scale)) * log_step);
}

void ScaleFilter::adapt(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  compute_features(frame, centre, size);
  learn(options_.learning_rate);
  size_ = size;
}

void ScaleFilter::learn(double rate) {
  template_ += static_cast<float>(rate) * (sample_ - template_);
  correlate(sample_);
  energy_ *= 1 - rate;
  energy_.noalias() += rate * (cosines_ * correlation_);
}

void ScaleFilter::correlate(const Eigen::MatrixXf& first) {
  // In chunks that are small enough for Eigen's product not to allocate.
  constexpr Eigen::Index kChunk = 256;
  gram_.setZero();
  for (Eigen::Index d = 0; d < first.rows(); d += kChunk) {
    const Eigen::Index count = std::min(kChunk, first.rows() - d);
    gram_.noalias() += first.middleRows(d, count).transpose() * sample_.middleRows(d, count);
  }
  const Eigen::Index n = gram_.rows();
  correlation_.setZero();
  for (Eigen::Index j = 0; j < n; ++j)
    for (Eigen::Index i = 0; i < n; ++i) correlation_((j - i + n) % n) += static_cast<double>(gram_(i, j));
}

void ScaleFilter::compute_features(const Frame& frame, const Point2& centre, const Size2& size) {
  const int n = options_.scales;
  // All patches are sampled from one patch of the largest size. Its resolution is what the smallest size
  // needs, or that of the image if lower.
  const double reach = std::pow(options_.step, n / 2);
  const Size2 pixels =
      (reach * (reach * Size2(grid_.width, grid_.height)).cwiseMin(size)).cwiseMin(kMaxSourceSide);
  const cv::Size source_grid(static_cast<int>(pixels.x()) + 2, static_cast<int>(pixels.y()) + 2);
  sampler_.sample(frame.gray(), centre, reach * size, source_grid, source_.mat);

  patch_.mat.create(grid_, CV_32FC1);
  for (int i = 0; i < n; ++i) {
    sample(source_.mat, std::pow(options_.step, i - 2 * (n / 2)), patch_.mat);
    fhog_.compute(patch_.mat, hog_.data());
    sample_.col(i) = hann_(i) * hog_.matrix();
  }
}

void ScaleFilter::sample(const cv::Mat& source, double fraction, cv::Mat& patch) {
  const auto tap = [fraction](int i, int pixels, int source_pixels) {
    const double from_middle = (i - 0.5 * (pixels - 1)) * fraction * source_pixels / pixels;
    const double at = std::clamp(0.5 * (source_pixels - 1) + from_middle, 0.0, source_pixels - 1.0);
    const int pixel = std::min(static_cast<int>(at), source_pixels - 2);
    return Tap{pixel, static_cast<float>(at - pixel)};
  };
  for (int x = 0; x < patch.cols; ++x) taps_[static_cast<std::size_t>(x)] = tap(x, patch.cols, source.cols);
  for (int y = 0; y < patch.rows; ++y) {
    const Tap row = tap(y, patch.rows, source.rows);
    const uchar *upper = source.ptr<uchar>(row.pixel), *lower = source.ptr<uchar>(row.pixel + 1);
    float* out = patch.ptr<float>(y);
    for (const Tap& col : taps_) {
      const auto between = [&col](const uchar* line) {
        const auto left = static_cast<float>(line[col.pixel]),
                   right = static_cast<float>(line[col.pixel + 1]);
        return left + col.weight * (right - left);
      };
      const float above = between(upper), below = between(lower);
      *out++ = above + row.weight * (below - above);
    }
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
