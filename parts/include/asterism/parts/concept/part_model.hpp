#pragma once

#include <asterism/parts/concept/frame.hpp>
#include <concepts>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The answer of a part model for one frame: the only link between appearance and geometry.
struct Evidence {
  /// Visually most similar position x_A, sub-pixel (a pixel centre, as all Point2).
  Point2 position = Point2::Zero();
  /// Similarity at that position (the paper's w), about 1 for a perfect match, >= 0.
  double peak = 0;
  /// Spatial uncertainty around the position [px^2], symmetric positive definite. For Kcf its trace is the
  /// paper's weighted variance sigma^2 (Sec. 2.3.3): the average squared distance from the position.
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Identity();
};

/// A part's appearance model. Its axioms, tested for every model by `asterism/testing/part_axioms.hpp`:
/// shifting the frame shifts the evidence by as much; `localize` changes nothing that is learned; the same
/// calls give the same results, bit for bit.
///
/// - `init(frame, centre, size)`: forget everything, and learn the part from one frame. May be called again
/// at any time. Throws
///   std::invalid_argument for a size that is not finite and positive or a centre that is not finite.
/// - `localize(frame, around)`: search around a position; positions outside the frame see replicated borders.
/// - `similarity_at(position)`: the similarity of the last `localize` at any position [same scale as
///   Evidence::peak]; 0 outside its search window.
/// - `adapt(frame, at)`: update the model with the frame's appearance at a position.
///
/// `localize` and `adapt` need an `init` before them; for a position that is not finite they throw
/// std::invalid_argument and leave what is learned as it was. Evidence is always finite.
template <class P>
concept PartModel = std::copyable<P> &&
    requires(P part, const P& learned, const Frame& frame, const Point2& x, const Size2& size) {
  part.init(frame, x, size);
  { part.localize(frame, x) } -> std::same_as<Evidence>;
  { learned.similarity_at(x) } -> std::convertible_to<double>;
  part.adapt(frame, x);
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
