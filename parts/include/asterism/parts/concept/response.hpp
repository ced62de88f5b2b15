#pragma once

#include <Eigen/Core>
#include <asterism/parts/concept/part_model.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A similarity response over a search window, on a regular grid in the image.
struct ASTERISM_API ResponseMap {
  /// rows x cols responses; may be negative away from the peak.
  Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> values;
  /// Image position of values(0, 0), and the spacing of the grid [px].
  Point2 origin = Point2::Zero();
  Size2 spacing = Size2::Ones();
  /// The response wraps around, like that of a correlation filter: beyond a border follows the opposite one.
  bool periodic = true;

  /// Image position of a (sub-pixel) grid position.
  Point2 position(double row, double col) const { return origin + spacing.cwiseProduct(Point2(col, row)); }
  /// Bilinear interpolation; up to half a cell outside the grid, the value at its border, because a sub-pixel
  /// peak may lie there; 0 beyond. Negative responses, which are not similarities, count as 0.
  double at(const Point2& position) const;
};

/// A PartModel that keeps the response map of its last `localize`, so that a tracker can multiply it by other
/// cues, such as color. `response()` returns the map, or a pointer to it that may be null.
template <class P>
concept DenseModel = PartModel<P> && requires(const P& part) {
  requires std::same_as<decltype(part.response()), const ResponseMap&> ||
      std::same_as<decltype(part.response()), const ResponseMap*>;
};

/// A PartModel whose target may change its size in the image: `resize(size)` [px] scales its search window by
/// as much. Throws std::invalid_argument for a size that is not finite and positive.
template <class P>
concept ResizableModel = PartModel<P> && requires(P part, const Size2& size) {
  part.resize(size);
};

/// A ResizableModel that measures its target's size: `found_size()` [px] is that in the frame of the last
/// `localize`. Both sides are finite and positive.
template <class P>
concept SizingModel = ResizableModel<P> && requires(const P& part) {
  { part.found_size() } -> std::convertible_to<Size2>;
};

/// The peak of a response and its spread.
///
/// position: the maximum, refined to sub-pixel by the vertex of a parabola in each axis (neighbours wrapped,
/// or not refined across a border where the map is not periodic) if `sub_pixel`; peak: the response there on
/// the grid; covariance: second moments about the position weighted by the response, negative responses
/// counting as 0, so that its trace is the paper's weighted variance (Sec. 2.3.3). A map without any positive
/// response, and one that is constant, have no peak: they give their centre, peak 0 and the moments of a
/// constant map.
ASTERISM_API Evidence evidence_of(const ResponseMap& response, bool sub_pixel = true);

/// As above, sub-pixel, but the covariance is that of `likelihood`, the position's likelihood on the same
/// grid, if the response is positive anywhere.
ASTERISM_API Evidence evidence_of(const ResponseMap& response, const ResponseMap& likelihood);

/// The similarity of a model without a response map: peak x exp(-d' covariance^-1 d / 2) at a distance d
/// from the position of its evidence, 0 outside its search window.
struct ASTERISM_API ResponsePeak {
  Evidence evidence;  ///< where the peak is
  /// Middle and sides of the search window [px].
  Point2 centre = Point2::Zero();
  Size2 window = Size2::Zero();

  /// At a position in the image.
  double at(const Point2& position) const;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
