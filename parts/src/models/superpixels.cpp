#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/models/superpixels.hpp>
#include <opencv2/imgproc.hpp>

#include "../concept/part_geometry.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Density of colors that neither the target nor its surroundings have.
constexpr float kForeign = 1e-3f;
// Bound of the coordinates of CIELAB.
constexpr float kFarthestColor = 200;

}  // namespace

Superpixels::Superpixels(const SuperpixelsOptions& options)
    : options_(check_options("SuperpixelsOptions", options)) {
  require_ordered(options.window, "SuperpixelsOptions");
}

void Superpixels::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  prepare(size);
  color_ = !frame.bgr().empty();
  learn(frame, centre, 1);
}

void Superpixels::prepare(const Size2& size) {
  size_ = size;
  const auto [spacing, cols, rows, reach, response] =
      match_geometry(size, options_.window, max_superpixel_window_side(options_.slic.side));
  spacing_ = spacing, cols_ = cols, rows_ = rows, reach_ = reach;
  response_ = likelihood_ = response;
  learned_.setZero(Eigen::Index{rows_ + 2 * reach_} * (cols_ + 2 * reach_), 3);
}

void Superpixels::visit_state(StateArchive& archive) {
  archive.begin("superpixels", options_);
  if (!archive.loading() && size_.isZero()) throw std::logic_error("Superpixels: save before init");
  archive.size(size_);
  archive(color_);
  if (archive.loading()) prepare(Size2(size_));
  archive(learned_);
  archive.require((learned_.abs() <= kFarthestColor).all());
  if (archive.loading()) cut();
}

Evidence Superpixels::localize(const Frame& frame, const Point2& around) {
  sample(frame, around);
  const int width = cols_ + 2 * reach_, displacements = 2 * reach_ + 1;
  const SuperpixelMap seen = slic(pixels_, width, options_.slic);
  response_.origin = likelihood_.origin = around - spacing_ * Point2::Constant(reach_);

  // The vote that each pixel of superpixel j in the frame gives to superpixel i of the target that covers it.
  const auto beta = static_cast<float>(options_.confidence_weight);
  const Eigen::ArrayXXf votes =
      (alike(seen.colors, foreground_.colors).rowwise() * weights_.transpose()).colwise() +
      beta * confidence(seen.colors);
  // Sums over the pixels of a superpixel at every displacement, by running sums along the window's rows.
  auto& values = response_.values;
  values.setZero();
  Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> running(rows_ + 2 * reach_, width + 1);
  for (std::size_t i = 0; i < regions_.size(); ++i) {
    const std::vector<Run>& runs = regions_[i];
    const float* const vote = votes.col(static_cast<Eigen::Index>(i)).data();
    for (int y = runs.front().row; y <= runs.back().row + 2 * reach_; ++y) {
      const int* const label = seen.labels.data() + std::ptrdiff_t{y} * width;
      float* const sum = running.row(y).data();
      sum[0] = 0;
      for (int x = 0; x < width; ++x) sum[x + 1] = sum[x] + vote[label[x]];
    }
    for (const Run& run : runs)
      for (int r = 0; r < displacements; ++r)
        values.row(r) += running.row(run.row + r).segment(run.end, displacements) -
                         running.row(run.row + r).segment(run.first, displacements);
  }
  values /= whole_;
  settle_ties(values, 1e-4F);  // rounding of the sums

  // Relative to the best match, so that no likelihood underflows.
  likelihood_.values = (static_cast<float>(options_.sharpness) * (values - values.maxCoeff())).exp();
  return evidence_of(response_, likelihood_);
}

void Superpixels::adapt(const Frame& frame, const Point2& at) { learn(frame, at, options_.learning_rate); }

void Superpixels::learn(const Frame& frame, const Point2& at, double rate) {
  sample(frame, at);
  learned_ += static_cast<float>(rate) * (pixels_ - learned_);
  cut();
}

void Superpixels::cut() {
  const int width = cols_ + 2 * reach_;
  const SuperpixelMap all = slic(learned_, width, options_.slic);
  std::vector<std::vector<Run>> runs(static_cast<std::size_t>(all.areas.size()));
  Eigen::ArrayXf inside = Eigen::ArrayXf::Zero(all.areas.size());
  for (int y = 0; y < rows_; ++y) {
    const int* const label = all.labels.data() + std::ptrdiff_t{y + reach_} * width + reach_;
    for (int x = 0; x < cols_; ++x) {
      inside(label[x]) += 1;
      std::vector<Run>& region = runs[static_cast<std::size_t>(label[x])];
      if (x > 0 && label[x] == label[x - 1])
        ++region.back().end;
      else
        region.push_back({y, x, x + 1});
    }
  }

  // The superpixels on the target; those that reach beyond it count both as target and as surroundings.
  regions_.clear();
  std::vector<Eigen::Index> on_target;
  for (Eigen::Index j = 0; j < inside.size(); ++j) {
    if (inside(j) == 0) continue;
    on_target.push_back(j);
    regions_.push_back(std::move(runs[static_cast<std::size_t>(j)]));
  }
  foreground_ = {all.colors(on_target, Eigen::all), inside(on_target) / inside.sum()};
  background_ = {all.colors, (all.areas - inside) / std::max(1.0f, (all.areas - inside).sum())};

  const Eigen::ArrayXf confident = confidence(foreground_.colors);
  weights_ = (1 + confident) / 2;
  whole_ = inside.sum() * ((foreground_.shares * weights_).sum() +
                           static_cast<float>(options_.confidence_weight) *
                               std::max(0.0f, (foreground_.shares * confident).sum()));
}

// The kernel k for every pair.
Eigen::ArrayXXf Superpixels::alike(const Eigen::ArrayX3f& rows, const Eigen::ArrayX3f& cols) const {
  Eigen::ArrayXXf result = Eigen::ArrayXXf::Zero(rows.rows(), cols.rows());
  for (Eigen::Index j = 0; j < cols.rows(); ++j)
    for (Eigen::Index k = 0; k < 3; ++k) result.col(j) += (rows.col(k) - cols(j, k)).square();
  const double scale = -0.5 / (options_.color_sigma * options_.color_sigma);
  return (static_cast<float>(scale) * result).exp();
}

// (F - B) / (F + B) for the densities of colors on the target, F, and around it, B.
Eigen::ArrayXf Superpixels::confidence(const Eigen::ArrayX3f& colors) const {
  const Eigen::ArrayXf f = alike(colors, foreground_.colors).matrix() * foreground_.shares.matrix(),
                       b = alike(colors, background_.colors).matrix() * background_.shares.matrix();
  return (f - b) / (f + b + kForeign);
}

void Superpixels::sample(const Frame& frame, const Point2& centre) {
  const bool color = color_ && !frame.bgr().empty();
  const cv::Size grid(cols_ + 2 * reach_, rows_ + 2 * reach_);
  cv::Mat& patch = patch_.mat;
  sample_patch(color ? frame.bgr() : frame.gray(), centre, spacing_ * Size2(grid.width, grid.height), grid,
               patch);
  // A gray patch becomes three equal channels.
  if (!color) cv::cvtColor(patch, patch, cv::COLOR_GRAY2BGR);
  cv::cvtColor(patch, patch, cv::COLOR_BGR2Lab);

  // In 8 bits, OpenCV scales L to 0 .. 255 and adds 128 to a and b.
  const Eigen::Map<const Eigen::Array<uchar, Eigen::Dynamic, 3, Eigen::RowMajor>> lab(patch.ptr<uchar>(),
                                                                                      grid.area(), 3);
  pixels_ = lab.cast<float>();
  pixels_.col(0) *= 100.0f / 255;
  pixels_.rightCols<2>() -= 128;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
