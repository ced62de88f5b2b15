#include <array>
#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/models/mosse.hpp>
#include <asterism/solver/base/split_mix.hpp>
#include <opencv2/imgproc.hpp>

#include "../concept/part_geometry.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Half the side of the square around the peak that is excluded from the sidelobe (Bolme et al., Sec. 3.5).
constexpr int kPeakReach = 5;
// -log of the smallest likelihood kept; smaller ones would become denormal numbers, which are slow.
constexpr float kUnlikely = 60;

const std::array<float, 256>& log_levels() {
  static const auto levels = [] {
    std::array<float, 256> table;
    for (std::size_t i = 0; i < table.size(); ++i) table[i] = std::log(static_cast<float>(i) + 1);
    return table;
  }();
  return levels;
}

// Mean and standard deviation of a periodic response outside the peak's square: sums over the whole map less
// those of the square.
struct Sidelobe {
  double mean = 0, deviation = 0;
  Sidelobe(const ResponseMap& response, Eigen::Index peak_row, Eigen::Index peak_col) {
    const auto& r = response.values;
    const Eigen::Index rows = r.rows(), cols = r.cols();
    double sum = r.cast<double>().sum(), squares = r.cast<double>().square().sum();
    auto count = static_cast<double>(r.size());
    // Where the window is thinner than the square, each row or column counts once.
    const Eigen::Index down = std::min<Eigen::Index>(2 * kPeakReach + 1, rows),
                       across = std::min<Eigen::Index>(2 * kPeakReach + 1, cols);
    for (Eigen::Index i = 0; i < down; ++i)
      for (Eigen::Index j = 0; j < across; ++j) {
        const double value =
            r((peak_row + i - kPeakReach + rows) % rows, (peak_col + j - kPeakReach + cols) % cols);
        sum -= value;
        squares -= value * value;
        --count;
      }
    mean = sum / count;
    deviation = std::sqrt(std::max(0.0, squares / count - mean * mean));
  }
};

}  // namespace

Mosse::Mosse(const MosseOptions& options) : options_(check_options("MosseOptions", options)) {
  require_ordered(options.window, "MosseOptions");
}

void Mosse::prepare(const Size2& size) {
  size_ = size;
  const double to_template = template_scale(size, options_.window);
  const double margin = options_.window.padding * mean_side(size);
  spacing_ = 1 / to_template;
  cols_ = fast_side((size.x() + margin) * to_template);
  rows_ = fast_side((size.y() + margin) * to_template);

  fft_ = RealFft2(rows_, cols_);
  const Eigen::Index half = Eigen::Index{rows_} * fft_.spectrum_cols();
  plane_.resize(Eigen::Index{rows_} * cols_);
  spectrum_.resize(half);
  numerator_.setZero(half);
  denominator_.setZero(half);
  response_.values.setZero(rows_, cols_);
  psr_ = 0;
  response_.spacing = Size2::Constant(spacing_);
  likelihood_ = response_;

  hann_ = hann(rows_, cols_);
  label_.resize(half);
  fft_.forward(gaussian_label(rows_, cols_, options_.label_sigma).data(), label_.data());
}

void Mosse::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  prepare(size);

  // The first filter fits the target and perturbed images of it: means over all of them.
  sample(frame, centre);
  transform(patch_.mat);
  learn(1);
  detail::SplitMix64 random(1);
  cv::Mat perturbed;
  const double x = 0.5 * (cols_ - 1), y = 0.5 * (rows_ - 1);
  for (int i = 1; i <= options_.perturbations; ++i) {
    const auto error = [&] { return options_.perturbation * random.symmetric(); };
    const double a = 1 + error(), b = error(), c = error(), d = 1 + error();
    const cv::Matx23d about_centre(a, b, x - a * x - b * y, c, d, y - c * x - d * y);
    cv::warpAffine(patch_.mat, perturbed, about_centre, patch_.mat.size(), cv::INTER_LINEAR,
                   cv::BORDER_REPLICATE);
    transform(perturbed);
    learn(1.0 / (i + 1));
  }
  update_filter();
}

void Mosse::visit_state(StateArchive& archive) {
  archive.begin("mosse", options_);
  if (!archive.loading() && size_.isZero()) throw std::logic_error("Mosse: save before init");
  archive.size(size_);
  if (archive.loading()) prepare(Size2(size_));
  archive(numerator_);
  archive(denominator_);
  archive.require((denominator_ >= 0).all());
  update_filter();
}

Evidence Mosse::localize(const Frame& frame, const Point2& around) {
  sample(frame, around);
  transform(patch_.mat);
  spectrum_ *= filter_;
  fft_.inverse(spectrum_.data(), plane_.data());
  put_in_the_middle(plane_, response_);
  response_.origin = around - spacing_ * Point2(cols_ / 2, rows_ / 2);

  Eigen::Index row = 0, col = 0;
  const float highest = response_.values.maxCoeff(&row, &col);
  const Sidelobe sidelobe(response_, row, col);
  psr_ = sidelobe.deviation > 0 ? (highest - sidelobe.mean) / sidelobe.deviation : 0;
  if (psr_ == 0) return evidence_of(response_);
  // The difference of two responses has twice the variance of one.
  const auto scale = static_cast<float>(0.5 / sidelobe.deviation);
  likelihood_.origin = response_.origin;
  likelihood_.values = (-((highest - response_.values) * scale).square().min(kUnlikely)).exp();
  return evidence_of(response_, likelihood_);
}

void Mosse::adapt(const Frame& frame, const Point2& at) {
  sample(frame, at);
  transform(patch_.mat);
  learn(options_.learning_rate);
  update_filter();
}

void Mosse::learn(double rate) {
  const auto eta = static_cast<float>(rate);
  numerator_ += eta * (label_ * spectrum_.conjugate() - numerator_);
  denominator_ += eta * (spectrum_.abs2() - denominator_);
}

void Mosse::sample(const Frame& frame, const Point2& centre) {
  sample_patch(frame.gray(), centre, spacing_ * Size2(cols_, rows_), {cols_, rows_}, patch_.mat);
}

void Mosse::transform(const cv::Mat& patch) {
  const std::array<float, 256>& levels = log_levels();
  const uchar* pixel = patch.ptr<uchar>();  // continuous: made by OpenCV at this size
  for (Eigen::Index i = 0; i < plane_.size(); ++i) plane_(i) = levels[pixel[i]];
  // In double precision the mean of a constant patch is exact, so that subtracting it leaves exactly 0.
  plane_ -= static_cast<float>(plane_.cast<double>().mean());
  const float square = plane_.square().sum();
  if (square > 0) plane_ *= hann_ / std::sqrt(square);
  fft_.forward(plane_.data(), spectrum_.data());
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
