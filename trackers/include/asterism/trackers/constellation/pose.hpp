#pragma once

#include <asterism/parts/concept/frame.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/trackers/constellation/transform.hpp>
#include <cmath>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The position in the image that is nearest to `centre`: where the centre of a tracker's box may be.
ASTERISM_API Point2 kept_in_image(const Frame& frame, const Point2& centre);

/// The pose of an object, for all trackers with parts: its box, and its rotation. It is the similarity that
/// maps positions in the object (pixels of the first frame, relative to its centre) to the image.
class ASTERISM_API ObjectPose {
 public:
  /// The box stays in this range of its first size, even if the constellation collapses or bursts.
  static constexpr double kMinScale = 0.1, kMaxScale = 10;

  ObjectPose() = default;
  /// The object's place in its first frame.
  explicit ObjectPose(const cv::Rect2d& box)
      : centre_(centre_of(box)), size_(box.width, box.height), first_size_(size_) {}

  /// Sets the transform of positions in the object; the size stays in the range above.
  void move_to(const PlaneTransform& transform);
  /// Sets the centre.
  void move_to(const Point2& centre) { centre_ = centre; }
  /// The object moves by a step from the pose that it has: its centre and angle by the transform of the
  /// image, its size by the factor `growth`, which is that of the transform unless something else knows
  /// better; the size keeps to the range above.
  void move_by(const PlaneTransform& step, double growth);
  /// Sets the size [px], which may change the aspect ratio; each side keeps to the range above.
  void resize(const Size2& size);
  /// Keeps the centre in the image (kept_in_image). Returns how far outside it was [px].
  Point2 keep_in(const Frame& frame);
  /// The centre becomes that of `box()` to the last bit, so that it does not matter which of the two a model
  /// learns at.
  void settle() { centre_ = centre_of(box()); }
  void visit_state(StateArchive& archive);

  /// From positions in the object to the image.
  PlaneTransform transform() const { return {scale_, angle_, centre_}; }
  /// By how much the object has turned since its first frame [rad].
  double angle() const { return angle_; }
  /// The box now, and its size in the first frame [px].
  const Point2& centre() const { return centre_; }
  const Size2& size() const { return size_; }
  const Size2& first_size() const { return first_size_; }
  /// Geometric mean of the box's sides [px].
  double mean_side() const { return std::sqrt(size_.x()) * std::sqrt(size_.y()); }
  /// Axis-aligned: it does not turn with the object.
  cv::Rect2d box() const { return box_around(centre_, size_); }
  /// In the object's box of the first frame.
  bool covers(const Point2& in_object) const {
    return (in_object.cwiseAbs().array() <= first_size_.array() / 2).all();
  }

 private:
  Point2 centre_ = Point2::Zero();
  Size2 size_ = Size2::Ones(), first_size_ = Size2::Ones();
  double angle_ = 0;
  double scale_ = 1;  // geometric mean of size_ / first_size_
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
