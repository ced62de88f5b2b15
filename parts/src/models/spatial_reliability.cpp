#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/features/mrf.hpp>
#include <asterism/parts/models/spatial_reliability.hpp>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#ifdef ASTERISM_PARTS_DNN
#include <asterism/parts/features/dnn_channels.hpp>
#endif

#include "../concept/part_geometry.hpp"
#include "../features/color_terms.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Margin of the segmented region around the target, x its mean side: farther away the spatial prior carries
// no information.
constexpr double kSegmentationPadding = 2;
// Bounds of the spatial prior (Lukezic et al.): 0.5 far from the target, and never certain.
constexpr double kLeastPrior = 0.5, kLargestPrior = 0.9;

// Those of the network that the options name, if they do.
std::shared_ptr<const CellChannels> channels_of(const SpatialReliabilityOptions& options) {
  if (options.network.text.empty()) return {};
#ifdef ASTERISM_PARTS_DNN
  try {
    return std::make_shared<DnnChannels>(options.network.text, options.layer.text,
                                         DnnInput{.scale = 1, .rgb = false});
  } catch (const std::runtime_error& error) {
    throw std::invalid_argument(error.what());
  }
#else
  throw std::invalid_argument(
      "SpatialReliabilityOptions: this build is without OpenCV's dnn module (libopencv-dnn-dev)");
#endif
}

// A spectrum as real numbers: alternating real and imaginary parts.
Eigen::Map<const Eigen::ArrayXf> parts_of(const std::complex<float>* spectrum, Eigen::Index bins) {
  return {reinterpret_cast<const float*>(spectrum), 2 * bins};
}
Eigen::Map<Eigen::ArrayXf> parts_of(std::complex<float>* spectrum, Eigen::Index bins) {
  return {reinterpret_cast<float*>(spectrum), 2 * bins};
}

}  // namespace

MaskedRegression::MaskedRegression(int rows, int cols, const MaskedRegressionOptions& options)
    : options_(check_options("MaskedRegressionOptions", options)), fft_(rows, cols) {
  require(options.max_penalty >= options.penalty,
          "MaskedRegressionOptions: penalty must be at most max_penalty");
  bins_ = Eigen::Index{rows} * fft_.spectrum_cols();
  for (Eigen::ArrayXf* spectrum : {&energy_, &filter_, &free_, &dual_}) spectrum->resize(2 * bins_);
  plane_.resize(Eigen::Index{rows} * cols);
}

void MaskedRegression::constrain(const float* mask) {
  auto* const spectrum = reinterpret_cast<std::complex<float>*>(filter_.data());
  fft_.inverse(spectrum, plane_.data());
  plane_ *= Eigen::Map<const Eigen::ArrayXf>(mask, plane_.size());
  fft_.forward(plane_.data(), spectrum);
}

void MaskedRegression::solve(const std::complex<float>* cross, const float* energy, const float* mask,
                             std::complex<float>* filter, std::complex<float>* dual) {
  load(energy);
  const auto lambda = static_cast<float>(options_.lambda);
  filter_ = parts_of(cross, bins_) / (energy_ + lambda);
  // The dual of a constraint that already holds: with a mask of ones the ridge regression stays as it is.
  dual_ = lambda * filter_;
  constrain(mask);
  iterate(cross, mask, options_.iterations, options_.penalty);
  parts_of(filter, bins_) = filter_;
  parts_of(dual, bins_) = dual_;
}

void MaskedRegression::refine(const std::complex<float>* cross, const float* energy, const float* mask,
                              std::complex<float>* filter, std::complex<float>* dual) {
  load(energy);
  filter_ = parts_of(filter, bins_);
  dual_ = parts_of(dual, bins_);
  iterate(cross, mask, options_.refining_iterations, options_.max_penalty);
  parts_of(filter, bins_) = filter_;
  parts_of(dual, bins_) = dual_;
}

void MaskedRegression::load(const float* energy) {
  for (Eigen::Index i = 0; i < bins_; ++i) energy_(2 * i) = energy_(2 * i + 1) = energy[i];
}

void MaskedRegression::iterate(const std::complex<float>* cross, const float* mask, int iterations,
                               double penalty) {
  const auto c = parts_of(cross, bins_);
  const auto lambda = static_cast<float>(options_.lambda);
  for (int i = 0; i < iterations; ++i) {
    const auto mu = static_cast<float>(penalty);
    free_ = (c + mu * filter_ - dual_) / (energy_ + mu);  // the regression, near the constrained filter
    filter_ = (mu * free_ + dual_) / (lambda + mu);
    constrain(mask);
    dual_ += mu * (free_ - filter_);
    penalty = std::min(options_.penalty_growth * penalty, options_.max_penalty);
  }
}

SpatialReliability::SpatialReliability(const SpatialReliabilityOptions& options)
    : options_(check_options("SpatialReliabilityOptions", options)),
      network_(channels_of(options)),
      channels_((options.hog_channels ? kHogChannels + 1 : 0) + (options.color_channels ? kColorTerms : 0) +
                (network_ ? network_->channels() : 0)),
      fhog_(options.cell_size),
      color_([&options] {
        ColorOptions color = options.color;
        color.mrf.enabled = false;  // applied in segment(), after the spatial prior
        return color;
      }()) {
  const MaskedRegression checks_its_penalties(4, 4, options.regression);
  require_ordered(options.window, options.cell_size, "SpatialReliabilityOptions");
  require(channels_ > 0, "SpatialReliabilityOptions: there are no channels");
  require(options.max_mask_area > options.min_mask_area,
          "SpatialReliabilityOptions: mask areas must satisfy min < max");
}

void SpatialReliability::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  prepare(size);
  if (options_.segmentation) color_.init(frame, box_around(centre, size));
  update_mask(frame, centre);
  transform_patch(frame, centre);
  train(true);
}

void SpatialReliability::prepare(const Size2& size) {
  const double to_template = template_scale(size, options_.window, max_window_side(options_.cell_size));
  const double margin = options_.window.padding * mean_side(size);
  cols_ = fast_side((size.x() + margin) * to_template / options_.cell_size);
  rows_ = fast_side((size.y() + margin) * to_template / options_.cell_size);
  size_ = initial_size_ = size;
  scale_ = initial_scale_ = Size2::Constant(1 / to_template);

  channels_fft_ = RealFft2(rows_, cols_, channels_);
  plane_fft_ = RealFft2(rows_, cols_);
  regression_ = MaskedRegression(rows_, cols_, options_.regression);
  const Eigen::Index plane = Eigen::Index{rows_} * cols_,
                     half = Eigen::Index{rows_} * plane_fft_.spectrum_cols();
  features_.resize(std::max(Fhog::kChannels, channels_) * plane);
  plane_.resize(plane);
  sample_.resize(channels_ * half);
  template_.setZero(channels_ * half);
  energy_.setZero(channels_ * half);
  filter_.setZero(channels_ * half);
  dual_.setZero(channels_ * half);
  spectrum_.resize(half);
  cell_sums_.resize(static_cast<std::size_t>(cols_));
  weights_.setZero(channels_);
  reliability_.resize(channels_);
  response_.values.setZero(rows_, cols_);
  mask_.values.resize(rows_, cols_);
  mask_.periodic = false;

  hann_ = hann(rows_, cols_);
  // The label is symmetric, so its spectrum is real.
  plane_fft_.forward(gaussian_label(rows_, cols_, options_.label_sigma).data(), spectrum_.data());
  label_ = spectrum_.real();
}

void SpatialReliability::visit_state(StateArchive& archive) {
  archive.begin("spatial_reliability", options_);
  if (!archive.loading() && size_.isZero()) throw std::logic_error("SpatialReliability: save before init");
  archive.size(initial_size_);
  Size2 size = size_;
  archive.size(size);
  if (archive.loading()) {
    prepare(Size2(initial_size_));
    resize(size);
    mask_.values.setZero();
    response_.values.setZero();
    segmented_ = false;
  }
  if (options_.segmentation) color_.visit_state(archive);
  archive(template_);
  archive(energy_);
  archive.require((energy_ >= 0).all());
  archive(filter_);
  archive(dual_);
  archive(weights_);
  archive.position(bias_);
}

void SpatialReliability::resize(const Size2& size) {
  require_size(size);
  size_ = size;
  scale_ = initial_scale_.cwiseProduct(size.cwiseQuotient(initial_size_));
}

Evidence SpatialReliability::localize(const Frame& frame, const Point2& around) {
  transform_patch(frame, around);
  respond(sample_);
  put_in_the_middle(plane_, response_);
  response_.spacing = scale_ * options_.cell_size;
  response_.origin = around - response_.spacing.cwiseProduct(Point2(cols_ / 2, rows_ / 2));
  Evidence evidence = evidence_of(response_);
  if (evidence.peak > 0) {
    Eigen::Index row = 0, col = 0;
    response_.values.maxCoeff(&row, &col);
    const Point2 offset = Point2(col, row) + offset_at(response_.values, row, col) - bias_;
    evidence.position = response_.position(offset.y(), offset.x());
  }
  return evidence;
}

void SpatialReliability::respond(const Spectrum& sample) {
  const Eigen::Index half = spectrum_.size();
  spectrum_.setZero();
  for (int k = 0; k < channels_; ++k)
    spectrum_ += weights_(k) * (sample.segment(k * half, half) * filter_.segment(k * half, half).conjugate());
  plane_fft_.inverse(spectrum_.data(), plane_.data());
}

void SpatialReliability::adapt(const Frame& frame, const Point2& at) {
  transform_patch(frame, at);
  if (options_.segmentation) color_.adapt(frame, box_around(at, size_));
  update_mask(frame, at);
  train(false);
}

void SpatialReliability::train(bool first) {
  const Eigen::Index half = spectrum_.size();
  const auto eta = static_cast<float>(first ? 1 : options_.learning_rate);
  for (int k = 0; k < channels_; ++k) {
    const auto sample = sample_.segment(k * half, half);
    auto mean = template_.segment(k * half, half);
    auto energy = energy_.segment(k * half, half);
    auto filter = filter_.segment(k * half, half);
    for (Eigen::Index i = 0; i < half; ++i) {
      const float re = sample(i).real(), im = sample(i).imag();
      const float mean_re = mean(i).real() + eta * (re - mean(i).real()),
                  mean_im = mean(i).imag() + eta * (im - mean(i).imag());
      mean(i) = {mean_re, mean_im};
      spectrum_(i) = {label_(i) * mean_re, label_(i) * mean_im};  // mean of F conj(Y)
      energy(i) += eta * (re * re + im * im - energy(i));
    }
    std::complex<float>* const dual = dual_.data() + k * half;
    if (first)
      regression_.solve(spectrum_.data(), energy.data(), mask_.values.data(), filter.data(), dual);
    else
      regression_.refine(spectrum_.data(), energy.data(), mask_.values.data(), filter.data(), dual);
    // Learning reliability: the channel's highest response to the target.
    spectrum_ = sample * filter.conjugate();
    plane_fft_.inverse(spectrum_.data(), plane_.data());
    reliability_(k) = std::max(0.0f, plane_.maxCoeff());
  }
  // Weights for which the weighted sum of these responses is 1 if all are at the same place.
  const float sum = options_.channel_weights ? reliability_.square().sum() : reliability_.sum();
  if (!options_.channel_weights) reliability_.setOnes();
  if (sum > 0)
    weights_ += static_cast<float>(first ? 1 : options_.weight_rate) * (reliability_ / sum - weights_);

  // After few rounds the filters have not converged: the peak of their response to the template is off
  // centre, which would make the target drift from frame to frame.
  respond(template_);
  using Map = Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  bias_ = offset_at(Eigen::Map<const Map>(plane_.data(), rows_, cols_), 0, 0);
}

void SpatialReliability::update_mask(const Frame& frame, const Point2& at) {
  mask_.spacing = scale_ * options_.cell_size;
  mask_.origin = at - mask_.spacing.cwiseProduct(Point2(cols_ - 1, rows_ - 1)) / 2;
  segmented_ = options_.segmentation && segment(frame, at);
  if (segmented_) return;
  // All cells that the box touches.
  const Size2 reach = (size_ + mask_.spacing) / 2;
  for (int r = 0; r < rows_; ++r)
    for (int c = 0; c < cols_; ++c)
      mask_.values(r, c) = ((mask_.position(r, c) - at).array().abs() <= reach.array()).all() ? 1.0f : 0.0f;
}

bool SpatialReliability::segment(const Frame& frame, const Point2& at) {
  const Size2 padded = size_.array() + kSegmentationPadding * mean_side(size_);
  Segmentation foreground = color_.segment(frame, box_around(at, padded.cwiseMin(window())), size_);
  if (foreground.posterior.empty()) return false;

  // By Bayes' rule, combine with the spatial prior: an Epanechnikov kernel that reaches the box's corners.
  const Size2 reach = size_.array() / std::numbers::sqrt2 + 1;
  cv::Mat prior(foreground.posterior.size(), CV_32FC1);
  for (int r = 0; r < prior.rows; ++r) {
    float *f = foreground.posterior.ptr<float>(r), *p = prior.ptr<float>(r);
    for (int c = 0; c < prior.cols; ++c, ++f, ++p) {
      const Point2 x = foreground.origin + foreground.spacing.cwiseProduct(Point2(c, r));
      *p = static_cast<float>(
          std::clamp(1 - (x - at).cwiseQuotient(reach).squaredNorm(), kLeastPrior, kLargestPrior));
      *f = *f * *p / (*f * *p + (1 - *f) * (1 - *p));
    }
  }
  foreground.posterior = regularize_posterior(foreground.posterior, prior, options_.color.mrf);

  for (int r = 0; r < rows_; ++r)
    for (int c = 0; c < cols_; ++c)
      mask_.values(r, c) = foreground.at(mask_.position(r, c)) > 0.5 ? 1.0f : 0.0f;
  const double area = static_cast<double>(mask_.values.sum()) * mask_.spacing.prod() / size_.prod();
  if (!(area > options_.min_mask_area && area < options_.max_mask_area)) return false;
  // Include the gradients of the contour, which belong to the target.
  cv::Mat mask(rows_, cols_, CV_32FC1, mask_.values.data());
  cv::dilate(mask, dilated_.mat, cv::Mat());
  dilated_.mat.copyTo(mask);
  return true;
}

void SpatialReliability::transform_patch(const Frame& frame, const Point2& centre) {
  const int cell = options_.cell_size;
  const Eigen::Index plane = plane_.size();
  const cv::Size grid(cols_ * cell, rows_ * cell);
  float* channel = features_.data();
  if (options_.hog_channels) {
    sampler_.sample(frame.gray(), centre, window(), grid, patch_.mat);
    fhog_.compute(patch_.mat, channel);
    // It overwrites the first unused channel of fHOG.
    channel = add_gray_cells(channel + kHogChannels * plane);
  }
  if (options_.color_channels) {
    if (!frame.bgr().empty()) {
      sample_patch(frame.bgr(), centre, window(), grid, color_patch_.mat);
      color_term_cells(color_patch_.mat, cell, channel);
    } else {
      std::fill_n(channel, kColorTerms * plane, 0.0f);
    }
    channel += kColorTerms * plane;
  }
  if (network_) {
    sample_bgr(frame, centre, window(), grid, network_patch_.mat);
    network_->compute(network_patch_.mat, rows_, cols_, channel);
  }

  for (int k = 0; k < channels_; ++k) features_.segment(k * plane, plane) *= hann_;
  channels_fft_.forward(features_.data(), sample_.data());
}

// The gray level of a cell is the mean of its pixels in the patch.
float* SpatialReliability::add_gray_cells(float* gray) {
  const int cell = options_.cell_size;
  const float scale = 1 / (255 * static_cast<float>(cell * cell));
  for (int r = 0; r < rows_; ++r) {
    std::fill(cell_sums_.begin(), cell_sums_.end(), 0);
    for (int y = r * cell; y < (r + 1) * cell; ++y) {
      const uchar* pixel = patch_.mat.ptr<uchar>(y);
      for (int& sum : cell_sums_) {
        for (int x = 0; x < cell; ++x) sum += pixel[x];
        pixel += cell;
      }
    }
    for (const int sum : cell_sums_) *gray++ = static_cast<float>(sum) * scale - 0.5f;
  }
  return gray;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
