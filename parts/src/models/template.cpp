#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/models/template.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "../concept/part_geometry.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Variance below which a template has no contrast: the variance of rounding to whole gray levels.
constexpr double kFlat = 1.0 / 12;
// Responses within a smaller range count as equal: the difference is rounding of OpenCV's correlation.
constexpr float kSame = 1e-3f;

}  // namespace

Template::Template(const TemplateOptions& options) : options_(check_options("TemplateOptions", options)) {
  require_ordered(options.window, "TemplateOptions");
}

void Template::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  prepare(size, options_.color && !frame.bgr().empty() ? 3 : 1);
  learn(frame, centre, 1);
}

void Template::prepare(const Size2& size, int channels) {
  size_ = size, channels_ = channels;
  const auto [spacing, cols, rows, reach, response] = match_geometry(size, options_.window);
  spacing_ = spacing, cols_ = cols, rows_ = rows, reach_ = reach;
  response_ = likelihood_ = response;
  template_.setZero(Eigen::Index{rows_} * cols_ * channels_);
}

void Template::visit_state(StateArchive& archive) {
  archive.begin("template", options_);
  if (!archive.loading() && size_.isZero()) throw std::logic_error("Template: save before init");
  archive.size(size_);
  archive(channels_);
  archive.require(channels_ == 1 || (channels_ == 3 && options_.color));
  if (archive.loading()) prepare(Size2(size_), channels_);
  archive(template_);
  archive(contrast_);
}

Evidence Template::localize(const Frame& frame, const Point2& around) {
  sample(frame, around, {cols_ + 2 * reach_, rows_ + 2 * reach_}, pixels_.mat);
  response_.origin = around - spacing_ * Point2::Constant(reach_);

  auto& values = response_.values;
  values.setZero();
  if (contrast_ >= kFlat * static_cast<double>(template_.size())) {
    const cv::Mat pattern(rows_, cols_, CV_32FC(channels_), template_.data());
    const bool ncc = options_.distance == TemplateOptions::Distance::Ncc;
    cv::matchTemplate(pixels_.mat, pattern, scores_.mat, ncc ? cv::TM_CCOEFF_NORMED : cv::TM_SQDIFF);
    const Eigen::Map<const decltype(response_.values)> scores(scores_.mat.ptr<float>(), values.rows(),
                                                              values.cols());
    if (ncc)
      values = scores;
    else
      values = 1 - scores / static_cast<float>(2 * contrast_);
    settle_ties(values, kSame);
  }
  // d^2 = 2 (1 - response); relative to the best one, so that no likelihood underflows.
  likelihood_.origin = response_.origin;
  likelihood_.values =
      ((values - values.maxCoeff()) / static_cast<float>(options_.sigma * options_.sigma)).exp();
  return evidence_of(response_, likelihood_);
}

void Template::adapt(const Frame& frame, const Point2& at) { learn(frame, at, options_.learning_rate); }

void Template::learn(const Frame& frame, const Point2& at, double rate) {
  sample(frame, at, {cols_, rows_}, pixels_.mat);
  const Eigen::Map<const Eigen::ArrayXf> pixels(pixels_.mat.ptr<float>(), template_.size());
  template_ += static_cast<float>(rate) * (pixels - template_);

  cv::Scalar mean, deviation;
  cv::meanStdDev(cv::Mat(rows_, cols_, CV_32FC(channels_), template_.data()), mean, deviation);
  contrast_ = deviation.dot(deviation) * rows_ * cols_;
}

void Template::sample(const Frame& frame, const Point2& centre, const cv::Size& grid, cv::Mat& pixels) {
  const Size2 window = spacing_ * Size2(grid.width, grid.height);
  if (channels_ == 3)
    sample_bgr(frame, centre, window, grid, patch_.mat);
  else
    sample_patch(frame.gray(), centre, window, grid, patch_.mat);
  patch_.mat.convertTo(pixels, CV_32F);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
