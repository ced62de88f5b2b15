#include <algorithm>
#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/models/strcf.hpp>
#include <cmath>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "../concept/part_geometry.hpp"
#include "../kernels/filter_plan.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Range of the cells, out of n (even), whose middle is within half the target's side [cells] of the window's
// middle; at least two.
std::pair<int, int> target_cells(int n, double side) {
  const int half = std::clamp(static_cast<int>(std::lround(side / 2)), 1, n / 2);
  return {n / 2 - half, n / 2 + half};
}

// Cells whose share in the filter is below this fraction of the largest are left out: it is less than the
// rounding of the transforms.
constexpr double kLeastShare = 1e-8;

// Below this the filter has learned nothing that can be distinguished from rounding.
constexpr double kLeastFit = 1e-12;

// Limits when a state is loaded: products of larger numbers might become infinite.
constexpr float kLargestFilter = 1e12F;
constexpr double kLargestFit = 1e12;

}  // namespace

Strcf::Strcf(const StrcfOptions& options)
    : options_(check_options("StrcfOptions", options)),
      sample_(options.features, options.cell_size, "StrcfOptions") {
  require_ordered(options.window, options.cell_size, "StrcfOptions");
}

void Strcf::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  prepare(size);
  sample_.transform(frame, centre, window());
  if (!sample_.flat()) fit_ = regress(0);
}

void Strcf::prepare(const Size2& size) {
  const double to_template = template_scale(size, options_.window, max_window_side(options_.cell_size));
  const double margin = options_.window.padding * mean_side(size);
  const Size2 target = size * to_template / options_.cell_size,
              cells = (size.array() + margin).matrix() * to_template / options_.cell_size;
  sample_.prepare(CellSpectra::fast_cells(cells.y()), CellSpectra::fast_cells(cells.x()));
  size_ = initial_size_ = size;
  scale_ = initial_scale_ = Size2::Constant(1 / to_template);

  const Plan& plan = *sample_.plan();
  for (AlignedFloats* const spectra : {&filter_, &previous_, &constrained_, &multiplier_})
    spectra->reset(plan.spectra_floats(sample_.padded_channels()));
  split_.reset(2 * plan.half_floats());
  plane_.reset(plan.plane_floats());
  constraint_.reset(std::ptrdiff_t{sample_.rows()} * sample_.cols());
  response_.values.setZero(sample_.rows(), sample_.cols());
  std::tie(first_row_, end_row_) = target_cells(sample_.rows(), target.y());
  std::tie(first_col_, end_col_) = target_cells(sample_.cols(), target.x());
  fit_ = 0;

  label_.reset(plan.half_floats());
  const Eigen::ArrayXd label = sample_.gaussian_label(options_.label_sigma * mean_side(target));
  Eigen::Map<Eigen::ArrayXf>(label_.data(), label.size()) = label.cast<float>();
}

void Strcf::visit_state(StateArchive& archive) {
  archive.begin("strcf", options_);
  if (!archive.loading() && !sample_.prepared()) throw std::logic_error("Strcf: save before init");
  archive.size(initial_size_);
  Size2 size = size_;
  archive.size(size);
  if (archive.loading()) {
    prepare(Size2(initial_size_));
    resize(size);
  }
  sample_.visit_spectra(archive, filter_);
  const Eigen::Map<const Eigen::ArrayXf> filter(filter_.data(),
                                                sample_.plan()->spectra_floats(sample_.padded_channels()));
  archive.require(filter.abs().maxCoeff() <= kLargestFilter);
  archive(fit_);
  archive.require(std::abs(fit_) <= kLargestFit);
}

void Strcf::resize(const Size2& size) {
  require_size(size);
  size_ = size;
  scale_ = initial_scale_.cwiseProduct(size.cwiseQuotient(initial_size_));
}

Evidence Strcf::localize(const Frame& frame, const Point2& around) {
  sample_.transform(frame, around, window());
  response_.spacing = scale_ * options_.cell_size;
  response_.origin = around - response_.spacing.cwiseProduct(Point2(sample_.cols() / 2, sample_.rows() / 2));
  if (!(fit_ > kLeastFit) || sample_.flat()) {
    response_.values.setZero();
    return evidence_of(response_, false);
  }
  const part_kernels_v0_1::Transform& t = sample_.plan()->transform;
  const part_kernels_v0_1::KernelSet& kernels = sample_.plan()->kernels;
  kernels.correlate(t, sample_.padded_channels(), sample_.data(), filter_.data(), split_.data());
  kernels.inverse_plane(t, split_.data(), plane_.data(), sample_.work());
  sample_.put_response(plane_.data(), static_cast<float>(1 / fit_), 0, response_);
  Evidence evidence = evidence_of(response_, false);
  if (options_.sub_pixel && evidence.peak > 0) {
    Eigen::Index row = 0, col = 0;
    response_.values.maxCoeff(&row, &col);
    evidence.position += response_.spacing.cwiseProduct(offset_at(response_.values, row, col));
  }
  return evidence;
}

void Strcf::adapt(const Frame& frame, const Point2& at) {
  sample_.transform(frame, at, window());
  if (sample_.flat()) return;
  std::swap(filter_, previous_);
  const double response = regress(options_.temporal_weight);
  // It rises at once, as the filter does for a target that stays visible, and falls slowly, so that an
  // occlusion of some frames does not become the norm.
  fit_ = std::max(response, fit_ + (response - fit_) / (1 + options_.temporal_weight));
}

void Strcf::weigh_cells(double penalty) {
  const auto share = [penalty](double weight) { return 1 / (weight * weight + penalty); };
  const double on_target = share(options_.target_weight), elsewhere = share(options_.background_weight);
  const auto value = [least = kLeastShare * std::max(on_target, elsewhere)](double of_cells) {
    return of_cells < least ? 0.0F : static_cast<float>(of_cells);
  };
  Eigen::Map<Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> cells(
      constraint_.data(), sample_.rows(), sample_.cols());
  cells.setConstant(value(elsewhere));
  cells.block(first_row_, first_col_, end_row_ - first_row_, end_col_ - first_col_)
      .setConstant(value(on_target));
}

double Strcf::regress(double temporal) {
  const part_kernels_v0_1::Transform& t = sample_.plan()->transform;
  const part_kernels_v0_1::KernelSet& kernels = sample_.plan()->kernels;
  part_kernels_v0_1::RegressionRound round{.channels = sample_.padded_channels(),
                                           .label = label_.data(),
                                           .sample = sample_.data(),
                                           .previous = previous_.data(),
                                           .filter = filter_.data(),
                                           .multiplier = multiplier_.data(),
                                           .constrained = constrained_.data(),
                                           .last_penalty = 0,
                                           .penalty = static_cast<float>(options_.penalty),
                                           .temporal = static_cast<float>(temporal),
                                           .last = false};
  double penalty = options_.penalty;
  for (int i = 1;; ++i) {
    round.last = i == options_.admm_iterations;
    round.penalty = static_cast<float>(penalty);
    const double response = kernels.regress(t, round);
    if (round.last) return response;
    weigh_cells(penalty);
    kernels.weigh(t, round.channels, constraint_.data(), constrained_.data(), sample_.work());
    round.last_penalty = round.penalty;
    penalty = std::min(options_.penalty_growth * penalty, options_.max_penalty);
  }
}

Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> Strcf::filter(int channel) const {
  if (channel < 0 || channel >= channels() || !sample_.prepared())
    throw std::invalid_argument("Strcf::filter: no such channel");
  const Plan& plan = *sample_.plan();
  const part_kernels_v0_1::Transform& t = plan.transform;
  const int lanes = plan.kernels.lanes;
  AlignedFloats split = split_, plane = plane_, work;
  work.reset(part_kernels_v0_1::work_floats(t.rows, t.cols));
  for (int r = 0; r < t.rows; ++r)
    for (int b = 0; b < t.bins; ++b) {
      const std::ptrdiff_t element = (std::ptrdiff_t{channel / lanes} * t.rows + r) * t.bins + b;
      const float* const real = filter_.data() + 2 * lanes * element + channel % lanes;
      float* const to = split.data() + std::ptrdiff_t{r} * t.padded_bins + b;
      to[0] = real[0];
      to[plan.half_floats()] = real[lanes];
    }
  plan.kernels.inverse_plane(t, split.data(), plane.data(), work.data());
  Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> result(t.rows, t.cols);
  for (int r = 0; r < t.rows; ++r)
    for (int c = 0; c < t.cols; ++c) result(r, c) = plane.data()[plan.plane_index(r, c)];
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
