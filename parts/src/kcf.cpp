#include <asterism/parts/kcf.hpp>
#include <asterism/parts/patch.hpp>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace asterism::inline ASTERISM_ABI {

namespace {

// However thin a target is, its window is no longer than this [template pixels].
constexpr double kMaxWindowSide = 1024;

void require(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(what);
}

// The number of cells nearest to `wanted` whose FFT is fast: a multiple of four (odd sizes cost up to four
// times as much with FFTW).
int fast_cells(double wanted) { return 4 * std::max(1, static_cast<int>(std::lround(wanted / 4))); }

// Symmetric Hann window of n >= 2 samples.
Eigen::ArrayXf hann(int n) {
  return 0.5f - 0.5f * Eigen::ArrayXf::LinSpaced(n, 0, 2 * std::numbers::pi_v<float>).cos();
}

// Signed circular distance of index i from 0 on a period of n.
int wrapped(int i, int n) { return i > n / 2 ? i - n : i; }

}  // namespace

Kcf::Kcf(const KcfOptions& options) : options_(options), fhog_(options.cell_size) {
  require(options.lambda > 0, "KcfOptions: lambda must be positive");
  require(options.learning_rate >= 0 && options.learning_rate <= 1,
          "KcfOptions: learning_rate must be in [0, 1]");
  require(options.label_sigma > 0, "KcfOptions: label_sigma must be positive");
  require(options.padding >= 0, "KcfOptions: padding must not be negative");
  require(options.kernel.sigma > 0, "KcfOptions: the kernel's sigma must be positive");
  require(options.min_template_side >= options.cell_size &&
              options.max_template_side >= options.min_template_side,
          "KcfOptions: template sides must satisfy cell_size <= min <= max");
}

void Kcf::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require(centre.allFinite(), "Kcf: the centre must be finite");
  require(size.allFinite() && size.minCoeff() > 0, "Kcf: the size must be finite and positive");

  const double mean_side = std::sqrt(size.prod());
  const Size2 margin = options_.proportional_window ? Size2(options_.padding * size)
                                                    : Size2::Constant(options_.padding * mean_side);
  const double to_template =
      std::min(std::clamp(mean_side, options_.min_template_side, options_.max_template_side) / mean_side,
               kMaxWindowSide / (size + margin).maxCoeff());
  const Size2 cells = (size + margin) * to_template / options_.cell_size;
  cols_ = fast_cells(cells.x());
  rows_ = fast_cells(cells.y());
  size_ = initial_size_ = size;
  scale_ = initial_scale_ = Size2::Constant(1 / to_template);

  const Eigen::Index plane = rows_ * cols_, half = rows_ * (cols_ / 2 + 1);
  feature_fft_ = RealFft2<float>(rows_, cols_, kChannels);
  plane_fft_ = RealFft2<double>(rows_, cols_);
  features_.resize(kChannels * plane);
  sample_.resize(kChannels * half);
  template_.setZero(kChannels * half);
  cross_float_.resize(half);
  kernel_spectrum_.resize(half);
  plane_.resize(plane);
  numerator_.setZero(half);
  denominator_.setZero(half);
  alpha_.setZero(half);
  response_.values.resize(rows_, cols_);

  const Eigen::ArrayXf across = hann(cols_), down = hann(rows_);
  hann_.resize(plane);
  for (int r = 0; r < rows_; ++r) hann_.segment(r * cols_, cols_) = down(r) * across;

  // The label phi: a Gaussian at zero shift, wrapped.
  const double sigma = options_.label_sigma * mean_side * to_template / options_.cell_size;  // [cells]
  for (int r = 0; r < rows_; ++r)
    for (int c = 0; c < cols_; ++c)
      plane_(r * cols_ + c) = std::exp(
          -0.5 * (std::pow(wrapped(r, rows_), 2) + std::pow(wrapped(c, cols_), 2)) / (sigma * sigma));
  label_.resize(half);
  plane_fft_.forward(plane_.data(), label_.data());

  train(transform_patch(frame, centre), 1);
}

void Kcf::resize(const Size2& size) {
  require(size.allFinite() && size.minCoeff() > 0, "Kcf: the size must be finite and positive");
  size_ = size;
  scale_ = initial_scale_.cwiseProduct(size.cwiseQuotient(initial_size_));
}

Evidence Kcf::localize(const Frame& frame, const Point2& around) {
  const double norm = transform_patch(frame, around);
  correlate(sample_, norm, template_, template_norm_);
  // Eq. kcf_prob_response: the response at all shifts is F^-1[A . U_y].
  kernel_spectrum_ *= alpha_;
  plane_fft_.inverse(kernel_spectrum_.data(), plane_.data());
  // Zero shift to the middle of the map, so that it is a picture of the search window.
  for (int r = 0; r < rows_; ++r)
    for (int c = 0; c < cols_; ++c)
      response_.values((r + rows_ / 2) % rows_, (c + cols_ / 2) % cols_) =
          static_cast<float>(plane_(r * cols_ + c));
  response_.spacing = scale_ * options_.cell_size;
  response_.origin = around - response_.spacing.cwiseProduct(Point2(cols_ / 2, rows_ / 2));
  return evidence_of(response_, options_.sub_pixel);
}

void Kcf::adapt(const Frame& frame, const Point2& at) {
  train(transform_patch(frame, at), options_.learning_rate);
}

void Kcf::train(double sample_norm, double rate) {
  correlate(sample_, sample_norm, sample_, sample_norm);  // U_z
  // U_z is the spectrum of a symmetric positive definite map: real and positive but for rounding.
  const Plane kernel = kernel_spectrum_.real().max(1e-12);
  // Eq. kcf_solution, A = Phi / (U_z + lambda), as a fraction whose halves are averaged apart.
  if (options_.separate_update) {
    numerator_ += rate * (label_ * kernel - numerator_);
    denominator_ += rate * (kernel * (kernel + options_.lambda) - denominator_);
    alpha_ = numerator_ / denominator_;
  } else {
    alpha_ += rate * (label_ / (kernel + options_.lambda) - alpha_);
  }
  template_ += static_cast<float>(rate) * (sample_ - template_);

  // |z|^2 by Parseval; all columns but the first (and the Nyquist one) stand for two of the full spectrum.
  const int half_cols = cols_ / 2 + 1;
  double sum = 0;
  for (Eigen::Index row = 0; row < kChannels * rows_; ++row) {
    const auto line = template_.segment(row * half_cols, half_cols);
    sum += 2.0 * line.abs2().sum() - std::norm(line(0)) -
           (cols_ % 2 == 0 ? std::norm(line(half_cols - 1)) : 0.0f);
  }
  template_norm_ = sum / (rows_ * cols_);
}

double Kcf::transform_patch(const Frame& frame, const Point2& centre) {
  const int cell = options_.cell_size;
  const Eigen::Index plane = rows_ * cols_;
  sample_patch(frame.gray(), centre, window(), {cols_ * cell, rows_ * cell}, patch_);
  fhog_.compute(patch_, features_.data());

  // The gray level of a cell is the mean of its pixels; the window's mean goes, as in Henriques' gray
  // template.
  cv::Mat gray(rows_, cols_, CV_32FC1, features_.data() + Fhog::kChannels * plane);
  cv::resize(patch_, cell_means_, {cols_, rows_}, 0, 0, cv::INTER_AREA);
  cell_means_.convertTo(gray, CV_32F, 1.0 / 255, -0.5);

  double norm = 0;
  for (int channel = 0; channel < kChannels; ++channel) {
    auto features = features_.segment(channel * plane, plane);
    features *= hann_;
    norm += static_cast<double>(features.square().sum());
  }
  feature_fft_.forward(features_.data(), sample_.data());
  return norm;
}

void Kcf::correlate(const Eigen::ArrayXcf& z, double z_norm, const Eigen::ArrayXcf& x, double x_norm) {
  const Eigen::Index half = cross_float_.size();
  const double elements = static_cast<double>(kChannels) * rows_ * cols_;
  cross_float_ = z.head(half) * x.head(half).conjugate();
  for (int channel = 1; channel < kChannels; ++channel)
    cross_float_ += z.segment(channel * half, half) * x.segment(channel * half, half).conjugate();
  kernel_spectrum_ = cross_float_.cast<std::complex<double>>();

  const Kernel& kernel = options_.kernel;
  if (kernel.type == Kernel::Type::Linear) {
    kernel_spectrum_ /= elements;
    return;
  }
  plane_fft_.inverse(kernel_spectrum_.data(), plane_.data());  // c, the circular correlation
  if (kernel.type == Kernel::Type::Gaussian)
    plane_ = (-(z_norm + x_norm - 2 * plane_).max(0.0) / (elements * kernel.sigma * kernel.sigma)).exp();
  else
    plane_ = (plane_ / elements + kernel.offset).pow(kernel.exponent);
  plane_fft_.forward(plane_.data(), kernel_spectrum_.data());
}

}  // namespace asterism::inline ASTERISM_ABI
