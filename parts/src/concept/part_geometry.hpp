#pragma once

#include <algorithm>
#include <asterism/parts/concept/frame.hpp>
#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/features/patch.hpp>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

// Checks and sizes that the part models share.
namespace asterism {
inline namespace ASTERISM_ABI {

/// Longest side of a window, however thin the target is [template pixels].
inline constexpr double kMaxWindowSide = option_ranges::kLongestSide;

/// Shorter limits for costly models: 256 cells where a model keeps tens of channels per cell, 64 superpixels
/// where each is compared with every other.
inline double max_window_side(int cell_size) { return std::min(kMaxWindowSide, 256.0 * cell_size); }
inline double max_superpixel_window_side(int side) { return std::min(kMaxWindowSide, 64.0 * side); }

/// Largest side of a target [px]; the square of such a number is well within the range of float.
inline constexpr double kMaxTargetSide = 1e9;

inline void require(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(what);
}

/// Checks the range of the target's side in the template; `of` names the options.
inline void require_ordered(const TemplateWindow& window, const char* of) {
  require(window.ordered(), std::string(of).append(": template sides must satisfy min <= max").c_str());
}
/// The same for a model of cells, none of which may be larger than the target.
inline void require_ordered(const TemplateWindow& window, int cell_size, const char* of) {
  require(window.ordered() && window.min_template_side >= cell_size,
          std::string(of).append(": template sides must satisfy cell_size <= min <= max").c_str());
}

/// Checks the arguments of PartModel::resize and PartModel::init.
inline void require_size(const Size2& size) {
  require(size.allFinite() && size.minCoeff() > 0, "part: the size must be finite and positive");
}
inline void require_target(const Point2& centre, const Size2& size) {
  require(centre.allFinite(), "part: the centre must be finite");
  require_size(size);
  require(size.maxCoeff() <= kMaxTargetSide, "part: the size must be at most 1e9 px");
}

/// Geometric mean of the sides; does not overflow for any finite size.
inline double mean_side(const Size2& size) { return std::sqrt(size.x()) * std::sqrt(size.y()); }

/// Template pixels per image pixel. Brings the target's mean side into the window's range, with scale 1 if it
/// is there already, and keeps each side of the window within `longest`.
inline double template_scale(const Size2& size, const TemplateWindow& window,
                             double longest = kMaxWindowSide) {
  const double side = mean_side(size);
  return std::min(std::clamp(side, window.min_template_side, window.max_template_side) / side,
                  longest / (size.maxCoeff() + window.padding * side));
}

/// Template and search window of a model that is matched at every whole shift within `reach`.
struct MatchGeometry {
  double spacing;        ///< image pixels per template pixel
  int cols, rows;        ///< of the template
  int reach;             ///< of the search, to each side [template pixels]
  ResponseMap response;  ///< one value per shift
};
inline MatchGeometry match_geometry(const Size2& size, const TemplateWindow& window,
                                    double longest = kMaxWindowSide) {
  const double to_template = template_scale(size, window, longest);
  MatchGeometry result{
      .spacing = 1 / to_template,
      .cols = std::max(1, static_cast<int>(std::lround(size.x() * to_template))),
      .rows = std::max(1, static_cast<int>(std::lround(size.y() * to_template))),
      .reach = static_cast<int>(std::ceil(window.padding / 2 * mean_side(size) * to_template)),
      .response = {}};
  result.response.values.setZero(2 * result.reach + 1, 2 * result.reach + 1);
  result.response.spacing = Size2::Constant(result.spacing);
  result.response.periodic = false;
  return result;
}

/// Prepares the match values of all shifts: if they differ by no more than `rounding`, all become 0. Towards
/// the border of the search values are lowered, by up to 1e-4 of their size along each axis, so that of equal
/// ones the most central wins.
inline void settle_ties(decltype(ResponseMap::values)& values, float rounding) {
  if (values.maxCoeff() - values.minCoeff() <= rounding) values.setZero();
  const Eigen::ArrayXf weight = 1 - 1e-4F * Eigen::ArrayXf::LinSpaced(values.rows(), -1, 1).square();
  values.colwise() *= weight;
  values.rowwise() *= weight.transpose();
}

/// Template size of a target with its surroundings.
struct WindowGeometry {
  double to_template;  ///< template pixels per image pixel
  int cols, rows;      ///< [template pixels], at least `least`
};
inline WindowGeometry window_geometry(const Size2& size, const TemplateWindow& window, int least) {
  const double to_template = template_scale(size, window);
  const double margin = window.padding * mean_side(size);
  return {to_template, std::max(least, static_cast<int>(std::lround((size.x() + margin) * to_template))),
          std::max(least, static_cast<int>(std::lround((size.y() + margin) * to_template)))};
}

/// A window of the frame (sample_patch) in BGR; three equal channels for a gray frame.
inline void sample_bgr(const Frame& frame, const Point2& centre, const Size2& window, const cv::Size& grid,
                       cv::Mat& patch) {
  sample_patch(frame.bgr().empty() ? frame.gray() : frame.bgr(), centre, window, grid, patch);
  if (patch.channels() == 1) cv::cvtColor(patch, patch, cv::COLOR_GRAY2BGR);
}

/// Symmetric Hann window of n >= 2 samples.
inline Eigen::ArrayXf hann(int n) {
  return 0.5F - 0.5F * Eigen::ArrayXf::LinSpaced(n, 0, 2 * std::numbers::pi_v<float>).cos();
}

/// The Hann window of a plane, row after row.
inline Eigen::ArrayXf hann(int rows, int cols) {
  const Eigen::ArrayXf across = hann(cols), down = hann(rows);
  Eigen::ArrayXf result(Eigen::Index{rows} * cols);
  for (int r = 0; r < rows; ++r) result.segment(Eigen::Index{r} * cols, cols) = down(r) * across;
  return result;
}

/// Signed circular distance of index i from 0 on a period of n.
inline int wrapped(int i, int n) { return i > n / 2 ? i - n : i; }

/// The label of a correlation filter, row after row: a Gaussian of height 1 at zero shift, wrapped.
inline Eigen::ArrayXf gaussian_label(int rows, int cols, double sigma) {
  Eigen::ArrayXf result(Eigen::Index{rows} * cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const double dr = wrapped(r, rows), dc = wrapped(c, cols);
      result(r * cols + c) = static_cast<float>(std::exp(-0.5 * (dr * dr + dc * dc) / (sigma * sigma)));
    }
  return result;
}

/// A correlation of even sides, row after row, with zero shift in the middle, so that it has the layout of
/// the search window.
inline void put_in_the_middle(const Eigen::ArrayXf& plane, ResponseMap& response) {
  const Eigen::Index rows = response.values.rows(), cols = response.values.cols();
  for (Eigen::Index r = 0; r < rows; ++r) {
    const auto line = plane.segment(r * cols, cols).transpose();
    auto row = response.values.row((r + rows / 2) % rows);
    row.tail(cols / 2) = line.head(cols / 2);
    row.head(cols / 2) = line.tail(cols / 2);
  }
}

/// The multiple of 8 nearest to `wanted`, for which the FFT is fast.
inline int fast_side(double wanted) { return 8 * std::max(1, static_cast<int>(std::lround(wanted / 8))); }

/// Vertex of a Gaussian through three values, of which the middle one is the largest and positive: the vertex
/// of the parabola through their logarithms. For a label that is a Gaussian about one cell wide, a parabola
/// through the values themselves would err by up to 0.1 cells.
inline double gaussian_vertex(float before, float middle, float after) {
  const float least = 1e-3F * middle;
  const double left = std::log(std::max(before, least) / middle),
               right = std::log(std::max(after, least) / middle);
  return left + right < 0 ? std::clamp(0.5 * (left - right) / (left + right), -0.5, 0.5) : 0;
}

/// Offset (x, y) of a periodic map's maximum from the position (row, col) of its largest value [cells].
template <class Map>
Point2 offset_at(const Map& map, Eigen::Index row, Eigen::Index col) {
  const Eigen::Index rows = map.rows(), cols = map.cols();
  const float middle = map(row, col);
  if (!(middle > 0)) return Point2::Zero();
  return {gaussian_vertex(map(row, (col + cols - 1) % cols), middle, map(row, (col + 1) % cols)),
          gaussian_vertex(map((row + rows - 1) % rows, col), middle, map((row + 1) % rows, col))};
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
