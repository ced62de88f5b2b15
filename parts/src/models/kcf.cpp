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

Kcf::Kcf(const KcfOptions& options)
    : options_(check_options("KcfOptions", options)),
      sample_(options.features, options.cell_size, "KcfOptions") {
  require_ordered(options.window, options.cell_size, "KcfOptions");
  if (options.kernel.type == Kernel::Type::Gaussian) kernel_base_ = 1;
  if (options.kernel.type == Kernel::Type::Polynomial) {
    const auto [type, sigma, offset, exponent] = options.kernel;
    // c may be negative, and then a fractional power is not a real number.
    require(exponent == std::floor(exponent), "KcfOptions: the kernel's exponent must be a whole number");
    kernel_base_ = std::pow(offset, exponent);
    require(std::abs(kernel_base_) <= 1e6, "KcfOptions: the kernel's offset^exponent must be at most 1e6");
  }
}

void Kcf::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  prepare(size);
  train(sample_.transform(frame, centre, window()), 1);
}

void Kcf::prepare(const Size2& size) {
  const double side = std::sqrt(size.prod());
  const Size2 margin = options_.proportional_window ? Size2(options_.window.padding * size)
                                                    : Size2::Constant(options_.window.padding * side);
  const double to_template =
      std::min(std::clamp(side, options_.window.min_template_side, options_.window.max_template_side) / side,
               max_window_side(options_.cell_size) / (size + margin).maxCoeff());
  const Size2 cells = (size + margin) * to_template / options_.cell_size;
  sample_.prepare(CellSpectra::fast_cells(cells.y()), CellSpectra::fast_cells(cells.x()));
  size_ = initial_size_ = size;
  scale_ = initial_scale_ = Size2::Constant(1 / to_template);

  const Plan& plan = *sample_.plan();
  const Eigen::Index half = plan.half_floats();
  template_.reset(plan.spectra_floats(sample_.padded_channels()));
  split_.reset(2 * half);
  plane_.reset(plan.plane_floats());
  numerator_.setZero(half);
  denominator_.setZero(half);
  alpha_.setZero(half);
  alpha_float_.setZero(half);
  response_.values.setZero(sample_.rows(), sample_.cols());
  label_ = sample_.gaussian_label(options_.label_sigma * side * to_template / options_.cell_size);
}

void Kcf::visit_state(StateArchive& archive) {
  archive.begin("kcf", options_);
  if (!archive.loading() && !sample_.prepared()) throw std::logic_error("Kcf: save before init");
  archive.size(initial_size_);
  Size2 size = size_;
  archive.size(size);
  if (archive.loading()) {
    prepare(initial_size_);
    resize(size);
    response_.values.setZero();
  }

  sample_.visit_spectra(archive, template_);
  archive(template_norm_);
  const part_kernels_v0_1::Transform& t = sample_.plan()->transform;
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
  const double norm = sample_.transform(frame, around, window());
  const part_kernels_v0_1::Transform& t = sample_.plan()->transform;
  const part_kernels_v0_1::KernelSet& kernels = sample_.plan()->kernels;
  kernels.correlate(t, sample_.padded_channels(), sample_.data(), template_.data(), split_.data());
  map_kernel(norm + template_norm_);
  // Eq. 3: the response at all shifts is F^-1[A . U_y]; the constant of U_y contributes a constant.
  const Eigen::Index half = alpha_.size();
  Eigen::Map<Eigen::ArrayXf>(split_.data(), half) *= alpha_float_;
  Eigen::Map<Eigen::ArrayXf>(split_.data() + half, half) *= alpha_float_;
  kernels.inverse_plane(t, split_.data(), plane_.data(), sample_.work());
  sample_.put_response(plane_.data(), 1, static_cast<float>(alpha_(0) * kernel_base_), response_);
  response_.spacing = scale_ * options_.cell_size;
  response_.origin = around - response_.spacing.cwiseProduct(Point2(sample_.cols() / 2, sample_.rows() / 2));
  return evidence_of(response_, options_.sub_pixel);
}

void Kcf::adapt(const Frame& frame, const Point2& at) {
  train(sample_.transform(frame, at, window()), options_.learning_rate);
}

void Kcf::train(double sample_norm, double rate) {
  const part_kernels_v0_1::Transform& t = sample_.plan()->transform;
  const part_kernels_v0_1::KernelSet& kernels = sample_.plan()->kernels;
  template_norm_ = kernels.train(t, sample_.padded_channels(), static_cast<float>(rate), sample_.data(),
                                 template_.data(), split_.data());
  map_kernel(2 * sample_norm);  // U_z
  const double base = kernel_base_ * sample_.rows() * sample_.cols(), lambda = options_.lambda;
  // U_z is the spectrum of a symmetric positive definite map: real and, up to rounding, positive.
  const auto of_kernel = [&](Eigen::Index i) {
    return std::max(static_cast<double>(split_.data()[i]) + (i == 0 ? base : 0), 1e-12);
  };
  // Eq. 2, A = Phi / (U_z + lambda), as a fraction whose numerator and denominator are averaged separately.
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

void Kcf::map_kernel(double norms) {
  const part_kernels_v0_1::Transform& t = sample_.plan()->transform;
  const part_kernels_v0_1::KernelSet& kernels = sample_.plan()->kernels;
  const double elements = static_cast<double>(sample_.channels()) * sample_.rows() * sample_.cols();
  const Kernel& kernel = options_.kernel;
  if (kernel.type == Kernel::Type::Linear) {
    Eigen::Map<Eigen::ArrayXf>(split_.data(), 2 * alpha_.size()) /= static_cast<float>(elements);
    return;
  }
  kernels.inverse_plane(t, split_.data(), plane_.data(), sample_.work());  // c, the circular correlation
  const std::ptrdiff_t count = sample_.plan()->plane_floats();
  if (kernel.type == Kernel::Type::Gaussian) {
    kernels.gaussian(static_cast<float>(norms),
                     static_cast<float>(1 / (elements * kernel.sigma * kernel.sigma)), count, plane_.data());
  } else {
    Eigen::Map<Eigen::ArrayXf> c(plane_.data(), count);
    c = ((c.cast<double>() / elements + kernel.offset).pow(kernel.exponent) - kernel_base_).cast<float>();
  }
  kernels.forward_plane(t, plane_.data(), split_.data(), sample_.work());
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
