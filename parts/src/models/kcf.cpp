#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/models/kcf.hpp>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "../concept/part_geometry.hpp"
#include "../kernels/filter_plan.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// What the transforms want: the multiple of four cells nearest to `wanted` that has no factor above 7, the
// smaller of two. It differs by 9 % at most from 20 cells on.
int fast_cells(double wanted) {
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

// exp(-i^2 / (2 sigma^2)) over wrapped distances, and the real spectrum of that, first n / 2 + 1 or all bins.
Eigen::ArrayXd gaussian_spectrum(int n, double sigma, int bins) {
  Eigen::ArrayXd spectrum = Eigen::ArrayXd::Zero(bins);
  for (int i = 0; i < n; ++i) {
    const double value = std::exp(-0.5 * std::pow(wrapped(i, n) / sigma, 2));
    for (int k = 0; k < bins; ++k) spectrum(k) += value * std::cos(2 * std::numbers::pi * (i * k % n) / n);
  }
  return spectrum;
}

}  // namespace

Kcf::Kcf(const KcfOptions& options)
    : options_(check_options("KcfOptions", options)), fhog_(options.cell_size) {
  const KcfFeatures& features = options.features;
  require(features.hog || features.gray || features.color, "KcfOptions: at least one feature is needed");
  channels_ = (features.hog ? Fhog::kChannels : 0) + (features.gray ? 1 : 0) + (features.color ? 2 : 0);
  constexpr int kLanes = part_kernels_v0_1::kMaxLanes;
  padded_channels_ = (channels_ + kLanes - 1) / kLanes * kLanes;
  require_ordered(options.window, options.cell_size, "KcfOptions");
  if (options.kernel.type == Kernel::Type::Gaussian) kernel_base_ = 1;
  if (options.kernel.type == Kernel::Type::Polynomial) {
    const auto [type, sigma, offset, exponent] = options.kernel;
    // c may be negative: of a fractional power that is no number.
    require(exponent == std::floor(exponent), "KcfOptions: the kernel's exponent must be a whole number");
    kernel_base_ = std::pow(offset, exponent);
    require(std::abs(kernel_base_) <= 1e6, "KcfOptions: the kernel's offset^exponent must be at most 1e6");
  }
}

void Kcf::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  prepare(size);
  train(transform_patch(frame, centre), 1);
}

void Kcf::prepare(const Size2& size) {
  const double side = std::sqrt(size.prod());
  const Size2 margin = options_.proportional_window ? Size2(options_.window.padding * size)
                                                    : Size2::Constant(options_.window.padding * side);
  const double to_template =
      std::min(std::clamp(side, options_.window.min_template_side, options_.window.max_template_side) / side,
               max_window_side(options_.cell_size) / (size + margin).maxCoeff());
  const Size2 cells = (size + margin) * to_template / options_.cell_size;
  cols_ = fast_cells(cells.x());
  rows_ = fast_cells(cells.y());
  size_ = initial_size_ = size;
  scale_ = initial_scale_ = Size2::Constant(1 / to_template);

  plan_ = Plan::shared(rows_, cols_);
  const part_kernels_v0_1::Transform& t = plan_->transform;
  const Eigen::Index plane = rows_ * cols_, half = plan_->half_floats();
  features_.reset(padded_channels_ * plane);
  sample_.reset(plan_->spectra_floats(padded_channels_));
  template_.reset(plan_->spectra_floats(padded_channels_));
  split_.reset(2 * half);
  plane_.reset(plan_->plane_floats());
  cell_work_.resize(cols_ * options_.cell_size);
  cell_sums_.resize(cols_);
  work_.reset(part_kernels_v0_1::work_floats(rows_, cols_));
  numerator_.setZero(half);
  denominator_.setZero(half);
  alpha_.setZero(half);
  alpha_float_.setZero(half);
  response_.values.setZero(rows_, cols_);

  const Eigen::ArrayXf across = hann(cols_), down = hann(rows_);
  hann_.reset(plane);
  for (int r = 0; r < rows_; ++r)
    for (int c = 0; c < cols_; ++c) hann_.data()[r * cols_ + c] = down(r) * across(c);

  // The label phi: a Gaussian at zero shift, wrapped; a product of one of each axis, as is its spectrum.
  const double sigma = options_.label_sigma * side * to_template / options_.cell_size;  // [cells]
  const Eigen::ArrayXd label_across = gaussian_spectrum(cols_, sigma, t.bins),
                       label_down = gaussian_spectrum(rows_, sigma, rows_);
  label_.setZero(half);
  for (int r = 0; r < rows_; ++r) label_.segment(r * t.padded_bins, t.bins) = label_down(r) * label_across;
}

void Kcf::visit_state(StateArchive& archive) {
  archive.begin("kcf", options_);
  if (!archive.loading() && plan_ == nullptr) throw std::logic_error("Kcf: to be saved before init");
  archive.size(initial_size_);
  Size2 size = size_;
  archive.size(size);
  if (archive.loading()) {
    prepare(initial_size_);
    resize(size);
    response_.values.setZero();
  }

  // Without the padding and in an order that does not depend on the kernels: a state may move to a machine of
  // other instructions.
  const part_kernels_v0_1::Transform& t = plan_->transform;
  const Eigen::Index lanes = plan_->kernels.lanes;
  for (Eigen::Index channel = 0; channel < channels_; ++channel)
    for (Eigen::Index row = 0; row < t.rows; ++row)
      for (Eigen::Index bin = 0; bin < t.bins; ++bin) {
        float* const real = template_.data() + ((channel / lanes * t.rows + row) * t.bins + bin) * 2 * lanes +
                            channel % lanes;
        archive(real[0]);
        archive(real[lanes]);
      }
  archive(template_norm_);
  const auto spectrum = [&](Eigen::ArrayXd& values) {
    for (int row = 0; row < t.rows; ++row) archive(values.segment(row * t.padded_bins, t.bins));
  };
  if (!options_.separate_update) {
    spectrum(alpha_);
  } else {
    if (archive.loading()) denominator_.setOnes();  // also in the padding
    spectrum(numerator_);
    spectrum(denominator_);
    alpha_ = numerator_ / denominator_;
    archive.require(alpha_.allFinite());
  }
  alpha_float_ = alpha_.cast<float>();
}

void Kcf::resize(const Size2& size) {
  require_size(size);
  size_ = size;
  scale_ = initial_scale_.cwiseProduct(size.cwiseQuotient(initial_size_));
}

Evidence Kcf::localize(const Frame& frame, const Point2& around) {
  const double norm = transform_patch(frame, around);
  const part_kernels_v0_1::Transform& t = plan_->transform;
  const part_kernels_v0_1::KernelSet& kernels = plan_->kernels;
  kernels.correlate(t, padded_channels_, sample_.data(), template_.data(), split_.data());
  map_kernel(norm + template_norm_);
  // Eq. 3: the response at all shifts is F^-1[A . U_y], that of U_y's constant a constant.
  const Eigen::Index half = alpha_.size();
  Eigen::Map<Eigen::ArrayXf>(split_.data(), half) *= alpha_float_;
  Eigen::Map<Eigen::ArrayXf>(split_.data() + half, half) *= alpha_float_;
  kernels.inverse_plane(t, split_.data(), plane_.data(), work_.data());
  const auto constant = static_cast<float>(alpha_(0) * kernel_base_);
  // Zero shift to the middle of the map, so that it is a picture of the search window.
  const int lanes = kernels.lanes, shift = cols_ / 2;
  for (int r = 0; r < rows_; ++r) {
    const float* const from = plane_.data() + plan_->plane_index(r, 0);
    float* const to = response_.values.data() + (r + rows_ / 2) % rows_ * cols_;
    for (int c = 0; c < cols_ - shift; ++c) to[c + shift] = from[c * lanes] + constant;
    for (int c = cols_ - shift; c < cols_; ++c) to[c + shift - cols_] = from[c * lanes] + constant;
  }
  response_.spacing = scale_ * options_.cell_size;
  response_.origin = around - response_.spacing.cwiseProduct(Point2(cols_ / 2, rows_ / 2));
  return evidence_of(response_, options_.sub_pixel);
}

void Kcf::adapt(const Frame& frame, const Point2& at) {
  train(transform_patch(frame, at), options_.learning_rate);
}

void Kcf::train(double sample_norm, double rate) {
  const part_kernels_v0_1::Transform& t = plan_->transform;
  const part_kernels_v0_1::KernelSet& kernels = plan_->kernels;
  template_norm_ = kernels.train(t, padded_channels_, static_cast<float>(rate), sample_.data(),
                                 template_.data(), split_.data());
  map_kernel(2 * sample_norm);  // U_z
  const double base = kernel_base_ * rows_ * cols_, lambda = options_.lambda;
  // U_z is the spectrum of a symmetric positive definite map: real and positive but for rounding.
  const auto of_kernel = [&](Eigen::Index i) {
    return std::max(static_cast<double>(split_.data()[i]) + (i == 0 ? base : 0), 1e-12);
  };
  // Eq. 2, A = Phi / (U_z + lambda), as a fraction whose halves are averaged apart.
  for (Eigen::Index i = 0; i < alpha_.size(); ++i) {
    const double kernel = of_kernel(i);
    if (options_.separate_update) {
      numerator_(i) += rate * (label_(i) * kernel - numerator_(i));
      denominator_(i) += rate * (kernel * (kernel + lambda) - denominator_(i));
      alpha_(i) = numerator_(i) / denominator_(i);
    } else {
      alpha_(i) += rate * (label_(i) / (kernel + lambda) - alpha_(i));
    }
  }
  alpha_float_ = alpha_.cast<float>();
}

double Kcf::transform_patch(const Frame& frame, const Point2& centre) {
  const int cell = options_.cell_size;
  const Eigen::Index plane = rows_ * cols_;
  const KcfFeatures& features = options_.features;
  float* planes = features_.data();
  if (features.hog || features.gray)
    sampler_.sample(frame.gray(), centre, window(), {cols_ * cell, rows_ * cell}, patch_.mat);
  if (features.hog) {
    fhog_.compute(patch_.mat, planes);
    planes += Fhog::kChannels * plane;
  }
  if (features.gray) {
    add_gray(planes);
    planes += plane;
  }
  if (features.color) add_color(frame, centre, planes);
  return plan_->kernels.forward(plan_->transform, padded_channels_, features_.data(), hann_.data(),
                                sample_.data(), work_.data());
}

// The gray level of a cell is the mean of its pixels in whole levels; the window's mean goes, as in
// Henriques' gray template.
void Kcf::add_gray(float* plane) {
  const int cell = options_.cell_size;
  for (int r = 0; r < rows_; ++r) {
    plan_->kernels.cell_sums(patch_.mat.ptr<std::uint8_t>(r * cell),
                             static_cast<std::ptrdiff_t>(patch_.mat.step), cell, cols_, cell_work_.data(),
                             cell_sums_.data());
    const float scale = 1 / static_cast<float>(cell * cell);
    for (int c = 0; c < cols_; ++c)
      *plane++ = std::rint(static_cast<float>(cell_sums_(c)) * scale) / 255 - 0.5F;
  }
}

void Kcf::add_color(const Frame& frame, const Point2& centre, float* planes) {
  float *a = planes, *b = planes + rows_ * cols_;
  if (frame.bgr().empty()) {
    std::fill(a, b + rows_ * cols_, 0.0F);
    return;
  }
  sample_patch(frame.bgr(), centre, window(), {cols_, rows_}, cells_.mat);
  cv::cvtColor(cells_.mat, cells_.mat, cv::COLOR_BGR2Lab);
  for (int r = 0; r < rows_; ++r) {
    const cv::Vec3b* const row = cells_.mat.ptr<cv::Vec3b>(r);
    for (int c = 0; c < cols_; ++c) {
      *a++ = static_cast<float>(row[c][1] - 128) / 128;
      *b++ = static_cast<float>(row[c][2] - 128) / 128;
    }
  }
}

void Kcf::map_kernel(double norms) {
  const part_kernels_v0_1::Transform& t = plan_->transform;
  const part_kernels_v0_1::KernelSet& kernels = plan_->kernels;
  const double elements = static_cast<double>(channels_) * rows_ * cols_;
  const Kernel& kernel = options_.kernel;
  if (kernel.type == Kernel::Type::Linear) {
    Eigen::Map<Eigen::ArrayXf>(split_.data(), 2 * alpha_.size()) /= static_cast<float>(elements);
    return;
  }
  kernels.inverse_plane(t, split_.data(), plane_.data(), work_.data());  // c, the circular correlation
  const std::ptrdiff_t count = plan_->plane_floats();
  if (kernel.type == Kernel::Type::Gaussian) {
    kernels.gaussian(static_cast<float>(norms),
                     static_cast<float>(1 / (elements * kernel.sigma * kernel.sigma)), count, plane_.data());
  } else {
    Eigen::Map<Eigen::ArrayXf> c(plane_.data(), count);
    c = ((c.cast<double>() / elements + kernel.offset).pow(kernel.exponent) - kernel_base_).cast<float>();
  }
  kernels.forward_plane(t, plane_.data(), split_.data(), work_.data());
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
