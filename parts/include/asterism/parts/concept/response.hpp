#pragma once

#include <Eigen/Core>
#include <asterism/parts/concept/part_model.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A similarity response over a search window, on a regular grid in the image.
struct ASTERISM_API ResponseMap {
  /// rows x cols responses; may be negative away from the peak.
  Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> values;
  /// Image position of values(0, 0) and spacing of the grid [px].
  Point2 origin = Point2::Zero();
  Size2 spacing = Size2::Ones();
  /// The window repeats, as that of a correlation filter does: beyond a border is the opposite one.
  bool periodic = true;

  /// Image position of a (sub-pixel) grid position.
  Point2 position(double row, double col) const { return origin + spacing.cwiseProduct(Point2(col, row)); }
  /// Bilinear interpolation, over the half cell around the grid its border (a sub-pixel peak at the border
  /// may lie there); 0 beyond. Negative responses count as 0: they are no similarity.
  double at(const Point2& position) const;
};

/// A PartModel that keeps the response map of its last `localize`, on which what a tracker knows from
/// elsewhere, such as color, can be multiplied: the map, or a pointer to it that may be null.
template <class P>
concept DenseModel = PartModel<P> && requires(const P& part) {
  requires std::same_as<decltype(part.response()), const ResponseMap&> ||
      std::same_as<decltype(part.response()), const ResponseMap*>;
};

/// A PartModel whose target may change its size in the image: `resize(size)` [px], finite and positive or
/// std::invalid_argument is thrown, stretches its search window alike.
template <class P>
concept ResizableModel = PartModel<P> && requires(P part, const Size2& size) {
  part.resize(size);
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

/// As above, sub-pixel, but with the covariance of the position's likelihood, a map on the same grid, where
/// the response is positive anywhere.
ASTERISM_API Evidence evidence_of(const ResponseMap& response, const ResponseMap& likelihood);

/// The similarity of a model that has no response map: peak x exp(-d' covariance^-1 d / 2) at a distance d
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
